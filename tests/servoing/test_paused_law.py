"""A law with pauses: the same places in the same order, no jump, at rest in between."""

import math

import numpy as np
import pytest

from omniservo.errors import InputError
from omniservo.servoing import ExponentialLaw, Pause, PausedLaw, RestOfLaw, RestToRestLaw

LAW = RestToRestLaw(3.0)
LAWS = [
    PausedLaw(LAW, (Pause(1.0, 0.2, 2.5, 0.3),)),
    PausedLaw(LAW, (Pause(1.0, 0.2, 1.05, 0.3),)),  # resumed while it slows down
    PausedLaw(LAW, (Pause(0.7, 0.2, 1.7, 0.5), Pause(1.8, 0.1, 2.6, 0.2))),  # again while it rises
    PausedLaw(ExponentialLaw(0.7), (Pause(0.5, 0.3, 1.5, 0.2),)),
    PausedLaw(RestOfLaw(LAW, 0.8, pace=0.5), (Pause(1.2, 0.2, 2.0, 0.2),)),
]


@pytest.mark.parametrize("law", LAWS)
def test_before_the_first_pause_it_is_the_law_itself(law):
    for time in np.linspace(0.0, law.pauses[0].begin, 7):
        assert law(time) == law.law(time)


@pytest.mark.parametrize("law", LAWS)
def test_speed_is_the_derivative_and_acceleration_that_of_speed(law):
    times = np.linspace(law.pauses[0].begin - 0.3, 8.0, 1201) + 1.3e-5
    step = 1e-6
    s, speed, change = law.motion(times)
    before, after = law.motion(times - step), law.motion(times + step)
    np.testing.assert_allclose(speed, (after[0] - before[0]) / (2 * step), atol=1e-7)
    np.testing.assert_allclose(change, (after[1] - before[1]) / (2 * step), atol=1e-5)
    np.testing.assert_allclose(np.array([law(t) for t in times]).T, [s, speed], atol=1e-14)


@pytest.mark.parametrize("law", LAWS)
def test_neither_place_nor_speed_jumps_and_none_is_faster_than_the_law(law):
    s, speed, _ = law.motion(np.linspace(0.81, 20.0, 40001))
    assert (np.diff(s) >= 0.0).all()
    assert np.abs(np.diff(s)).max() < 1e-3
    assert np.abs(np.diff(speed)).max() < 2e-2
    own = law.law.motion(np.linspace(1e-6, 20.0, 20001))[1].max()
    assert speed.max() <= own * (1 + 1e-9)
    end = law.law(200.0)[0]
    assert law(250.0)[0] == pytest.approx(end, abs=1e-12)


def test_it_stands_from_the_end_of_slowing_until_it_is_resumed_and_is_right_again_after_rising():
    law = LAWS[0]
    assert law(1.2)[1] == 0.0
    assert law(1.2)[0] == law(2.5)[0] == LAW(1.1)[0]  # half of what slowing takes is gone
    clock, rate, _ = law.pauses[0].clock(2.8)
    assert rate == 1.0
    lag = 2.8 - clock
    assert lag == pytest.approx(0.1 + 1.3 + 0.15)
    assert law(4.0)[0] == pytest.approx(LAW(4.0 - lag)[0])
    assert not law.finished(3.0 + lag - 1e-6)
    assert law.finished(3.0 + lag + 1e-6)


def test_a_pause_begins_and_ends_at_its_own_times_whatever_was_lost_in_one_before():
    law = LAWS[2]
    for begin, end in ((0.9, 1.7), (1.9, 2.6)):
        assert law(begin)[1] == law(end)[1] == 0.0
        assert law(begin)[0] == law(end)[0]
        assert law(begin - 0.01)[1] > 0.0
        assert law(end + 0.01)[1] > 0.0


def test_a_pause_that_no_one_ends_is_the_end():
    law = PausedLaw(LAW, (Pause(1.0, 0.2),))
    assert not law.finished(1.19)
    assert law.finished(1.2)
    assert law(1e6) == (LAW(1.1)[0], 0.0)


def test_when_a_clock_comes_to_a_time():
    pause = Pause(1.0, 0.2, 2.5, 0.3)
    for clock in (0.2, 0.9, 1.05, 1.3, 2.0, 5.0):
        assert pause.clock(pause.when(clock))[0] == pytest.approx(clock, abs=1e-7)
    assert pause.when(0.9) == 0.9
    for_good = Pause(1.0, 0.2)
    assert for_good.clock(for_good.when(1.05))[0] == pytest.approx(1.05, abs=1e-7)
    assert for_good.when(1.2) == math.inf


def test_one_more_pause_is_one_of_the_same_law():
    law = PausedLaw.of(PausedLaw.of(LAW, Pause(1.0, 0.2, 2.0)), Pause(3.0, 0.2))
    assert law == PausedLaw(LAW, (Pause(1.0, 0.2, 2.0), Pause(3.0, 0.2)))


def test_what_is_no_pause_is_refused():
    with pytest.raises(InputError, match="resumed"):
        Pause(1.0, 0.2, 0.9)
    with pytest.raises(InputError, match="slowing"):
        Pause(1.0, 0.0)
    with pytest.raises(InputError, match="rising"):
        Pause(1.0, 0.1, 2.0, 0.0)


def test_at_the_time_at_which_a_clock_comes_to_a_time_it_has_come_to_it():
    pause = Pause(1.0, 0.2, 2.5, 0.3)
    assert all(pause.clock(pause.when(clock))[0] >= clock for clock in np.linspace(0.0, 5.0, 101))


@pytest.mark.parametrize(("begin", "resumed", "name"), [(math.nan, 2.0, "begin"), (1.0, math.nan, "resumed")])
def test_times_of_a_pause_that_are_none_are_refused(begin, resumed, name):
    with pytest.raises(InputError, match=name):
        Pause(begin, 0.2, resumed)
