"""What was sent and measured, over any length of time: against sums over all of it."""

import numpy as np
import pytest

from omniservo.robots import RobotState
from omniservo.safety.motion_history import SPACING, MotionHistory

STILL = np.zeros(2)


def reading(time, positions):
    return RobotState(time, np.asarray(positions, dtype=float), STILL)


@pytest.mark.parametrize("step", [1e-3, 5e-3, 0.033])
def test_positions_and_what_was_sent_are_known_for_two_seconds_back_however_long_it_runs(step):
    random, history = np.random.default_rng(1), MotionHistory(reading(0.0, [0, 0]), np.full(2, 1e9))
    times, sums, places = [0.0], [STILL], [STILL]
    commands = max(1, round(0.033 / step))
    for k in range(1, round(12.0 / step)):
        if k % commands == 1 % commands:
            velocities = random.normal(size=2)
            history.sent(velocities, times[-1])
        sums.append(sums[-1] + step * velocities)
        places.append(np.array([np.sin(k * step), np.cos(k * step)]))
        times.append(k * step)
        history.measured(reading(times[-1], places[-1]))
    asked = times[-1] - random.uniform(0.0, 2.0, 50)
    q, sent, slowest = history.at(asked)
    between = [np.interp(asked, times, column) for column in np.array(sums).T]
    np.testing.assert_allclose(sent - sent[0], np.transpose(between) - np.transpose(between)[0], atol=0.02)
    np.testing.assert_allclose(q, np.column_stack([np.sin(asked), np.cos(asked)]), atol=1e-3)
    np.testing.assert_allclose(slowest, sent, atol=1e-9)


@pytest.mark.parametrize("age", [0.0, 0.012])
def test_what_is_sent_counts_from_its_own_time_on_between_readings_that_are_rare_and_old(age):
    random, history = np.random.default_rng(2), MotionHistory(reading(0.0, [0, 0]), np.full(2, 1e9))
    sending, velocities = np.arange(1, 200) * 7e-3, random.normal(size=(199, 2))
    readings = np.arange(1, 70) * 0.02
    news = [(t, v) for t, v in zip(sending, velocities, strict=True)] + [(t + age, None) for t in readings]
    for time, sent in sorted(news, key=lambda one: one[0]):
        if sent is None:
            history.measured(reading(time - age, [0, 0]))
        else:
            history.sent(sent, time)
    sums = np.concatenate([np.zeros((1, 2)), np.cumsum(7e-3 * velocities[:-1], axis=0)])
    asked = random.uniform(0.1, history.time, 60)
    wanted = np.column_stack([np.interp(asked, sending, column) for column in sums.T])
    np.testing.assert_allclose(history.at(asked)[1], wanted, atol=1e-6)


def test_readings_and_what_was_sent_are_known_from_one_time_on_however_often_each_came():
    history, velocity = MotionHistory(reading(0.0, [0, 0]), np.full(2, 1e9)), np.array([0.3, -0.2])
    for k in range(3000):
        history.sent(velocity, 0.0051 * k)
        history.measured(reading(0.0051 * k + 0.0002, (0.0051 * k + 0.0002) * velocity))
    q, sent, _ = history.at(history.time - np.array([0.0, 1.0, 2.0, 4.0, 8.0]))
    np.testing.assert_allclose(q - q[0], sent - sent[0], atol=1e-9)
    assert abs(q[0, 0] - q[2, 0]) == pytest.approx(0.6)


def test_the_slowest_drive_goes_after_what_is_sent_with_its_acceleration():
    history = MotionHistory(reading(0.0, [0, 0]), np.array([2.0, 1e9]))
    history.sent(np.array([1.0, 1.0]), 0.0)
    for time in np.arange(1, 201) * 5e-3:
        history.measured(reading(time, [0, 0]))
    _, sent, slowest = history.at(np.array([0.25, 1.0]))
    np.testing.assert_allclose(sent, [[0.25, 0.25], [1.0, 1.0]], atol=1e-9)
    np.testing.assert_allclose(slowest, [[0.0625, 0.25], [0.75, 1.0]], atol=5e-3)


def test_before_the_first_reading_the_robot_stands_and_after_the_last_what_was_sent_leads_on():
    history = MotionHistory(reading(1.0, [0.3, 0.4]), np.full(2, 1e9))
    history.sent(np.array([1.0, -1.0]), 1.0)
    for time in 1.0 + np.arange(1, 101) * 5e-3:
        history.measured(reading(time, [0.3, 0.4]))  # late readings: they do not show it yet
    np.testing.assert_allclose(history.at(np.array(0.2))[0], [0.3, 0.4])
    np.testing.assert_allclose(history.at(np.array(9.0))[0], [0.3, 0.4])
    ahead = history.expected(np.array([1.3, 1.5, 1.6, 1.7]))
    np.testing.assert_allclose(ahead, [[0.3, 0.4], [0.3, 0.4], [0.4, 0.3], [0.5, 0.2]], atol=1e-9)


def test_a_clock_set_back_begins_anew():
    history = MotionHistory(reading(5.0, [0, 0]), np.ones(2))
    history.measured(reading(5.1, [1, 1]))
    history.measured(reading(4.0, [2, 2]))
    history.measured(reading(4.0 + 2 * SPACING, [3, 3]))
    np.testing.assert_allclose(history.at(np.array([4.0, 5.1]))[0], [[2, 2], [3, 3]])
