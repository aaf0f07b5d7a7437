"""Joints between their readings."""

from threading import Thread

import numpy as np
import pytest

from omniservo.errors import ClockFault, InputError, NotFinite
from omniservo.hardware import JointHistory
from omniservo.robots import RobotState

PHASES = np.array([0.0, 0.7, 1.4])


def state(time, **changes):
    values = {"joint_positions": np.sin(2 * time + PHASES), "joint_velocities": 2 * np.cos(2 * time + PHASES)}
    return RobotState(time, **(values | changes))


def filled(seconds=3.0, rate=50.0):
    history = JointHistory(3)
    for k in range(int(seconds * rate) + 1):
        history.add(state(k / rate))
    return history


def test_between_readings_joints_are_known_to_a_microradian():
    times = np.linspace(1.0, 3.0, 997).reshape(1, 997)
    found = filled().at(times)
    assert found.shape == (1, 997, 3)
    np.testing.assert_allclose(found, np.sin(2 * times[..., None] + PHASES), rtol=0, atol=2e-7)
    assert filled().at(2.5).shape == (3,)


def test_a_reading_itself_is_given_back():
    np.testing.assert_allclose(filled().at(2.0), np.sin(4.0 + PHASES), atol=1e-12)


def test_beyond_both_ends():
    history = filled()
    newest, speed = np.sin(6.0 + PHASES), 2 * np.cos(6.0 + PHASES)
    np.testing.assert_allclose(history.at(3.05), newest + 0.05 * speed)
    np.testing.assert_allclose(history.at(9.0), newest + 0.1 * speed)
    np.testing.assert_allclose(history.at(0.2), np.sin(2.0 + PHASES), atol=1e-12)  # two seconds are kept


def test_one_reading_is_enough_and_none_is_not():
    history = JointHistory(3)
    with pytest.raises(InputError, match="before the first"):
        history.at(1.0)
    history.add(state(1.0))
    np.testing.assert_allclose(history.at([0.0, 1.0]), np.tile(np.sin(2.0 + PHASES), (2, 1)))


def test_long_and_fast_streams_keep_their_two_seconds():
    history = filled(9.0, 1000.0)
    assert 2000 <= len(history) <= 2002
    np.testing.assert_allclose(history.at(8.5), np.sin(17.0 + PHASES), atol=1e-9)


def test_an_old_or_repeated_reading_changes_nothing_and_a_clock_set_back_is_told():
    history = filled()
    history.add(state(2.5, joint_positions=np.ones(3)))
    history.add(state(3.0, joint_positions=np.ones(3)))
    np.testing.assert_allclose(history.at(3.0), np.sin(6.0 + PHASES), atol=1e-12)
    with pytest.raises(ClockFault):
        history.add(state(-5.0))


@pytest.mark.parametrize(
    "bad, kind",
    [
        ({"joint_positions": np.array([0.0, np.nan, 0.0])}, NotFinite),
        ({"joint_velocities": np.array([0.0, 0.0, np.inf])}, NotFinite),
        ({"joint_positions": np.zeros(2), "joint_velocities": np.zeros(2)}, InputError),
    ],
)
def test_what_is_no_reading_is_refused(bad, kind):
    history = filled()
    with pytest.raises(kind):
        history.add(state(3.1, **bad))
    with pytest.raises(NotFinite):
        history.add(state(np.nan))
    with pytest.raises(InputError, match="times"):
        history.at(np.nan)
    assert len(history) == len(filled())


def test_one_thread_may_add_while_another_looks_up():
    history, wrong = filled(0.1), []

    def look():
        while len(history) and not done:
            wrong.append(np.abs(history.at(0.05) - np.sin(0.1 + PHASES)).max() > 1e-6)

    done = []
    thread = Thread(target=look)
    thread.start()
    for k in range(2000):
        history.add(state(0.1 + (k + 1) * 1e-4))
    done.append(True)
    thread.join()
    assert wrong
    assert not any(wrong)
