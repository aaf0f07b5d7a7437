"""What is left of a law: no jump where it begins, at rest where it ends, and as slow as limits need it."""

import numpy as np
import pytest

from omniservo.errors import InputError
from omniservo.servoing import ExponentialLaw, PathLimits, RestOfLaw, RestToRestLaw

LAW = RestToRestLaw(3.0)
RESTS = [
    RestOfLaw(LAW, 1.1),
    RestOfLaw(LAW, 1.1, pace=0.4, ramp=0.3),
    RestOfLaw(ExponentialLaw(0.7), 0.5, pace=0.7),
    RestOfLaw(RestOfLaw(LAW, 0.8, pace=0.5), 1.4, pace=0.6),
]


def bent(size, sharp=0.0):
    """One joint that goes on as before and then farther by ``size`` [rad]; sharp: dq/dw bends at once."""

    def joints(w, order):
        values = {
            1: 0.4 + sharp * w + 2.0 * size * np.sin(np.pi * w) ** 2,
            2: sharp + 2.0 * size * np.pi * np.sin(2.0 * np.pi * w),
        }
        return values[order][:, None]

    return joints


@pytest.mark.parametrize("rest", RESTS)
def test_it_begins_at_zero_with_the_present_speed_and_ends_at_rest(rest):
    w, speed = rest.law(rest.begin)
    assert rest(rest.begin) == (0.0, pytest.approx(speed / (1.0 - w), rel=1e-12))
    times = np.linspace(rest.begin, 60.0, 4001)
    s, rates = np.array([rest(t) for t in times]).T
    assert (np.diff(s) >= 0.0).all()
    assert (rates >= 0.0).all()
    assert s[-1] == pytest.approx(1.0, abs=1e-8)
    assert rates[-1] == pytest.approx(0.0, abs=1e-8)
    assert rest.finished(60.0)
    assert not rest.finished(rest.begin)


@pytest.mark.parametrize("rest", RESTS)
def test_speed_is_the_derivative_and_has_no_jump(rest):
    for time in rest.begin + np.linspace(0.001, 3.0, 43):
        slope = (rest(time + 1e-6)[0] - rest(time - 1e-6)[0]) / 2e-6
        assert rest(time)[1] == pytest.approx(slope, abs=1e-7)


@pytest.mark.parametrize("rest", RESTS)
def test_motion_at_many_times_is_that_at_each_and_its_acceleration_the_rates_derivative(rest):
    times = rest.begin + np.linspace(0.0013, 3.0, 43)
    s, rate, growth = rest.motion(times)
    np.testing.assert_allclose(np.transpose([s, rate]), [rest(time) for time in times], atol=1e-13)
    slopes = [(rest(time + 1e-6)[1] - rest(time - 1e-6)[1]) / 2e-6 for time in times]
    np.testing.assert_allclose(growth, slopes, atol=1e-6)


def test_carried_on_it_is_the_law_itself():
    rest = RestOfLaw(LAW, 1.1)
    w, _ = LAW(1.1)
    for time in (1.1, 1.7, 2.9, 3.0):
        assert w + (1.0 - w) * rest(time)[0] == pytest.approx(LAW(time)[0], abs=1e-15)
    assert rest.finished(3.0)
    assert not rest.finished(2.99)


@pytest.mark.parametrize("begin", [0.4, 0.7, 1.1])
@pytest.mark.parametrize("size", [0.2, 0.5, 1.0])
def test_within_limits_it_keeps_them_at_every_millisecond(begin, size):
    limits = PathLimits(bent(size), [0.7], [1.0])
    rest = RestOfLaw.within(LAW, begin, limits)
    times = np.arange(begin + 1e-3, begin + 25.0, 1e-3)
    s, speed = np.array([rest(t) for t in times]).T
    change = np.gradient(speed, times)
    excess = limits.excess(np.clip(s, 0, 1), speed, change)
    carried = np.array([RestOfLaw(LAW, begin)(t) for t in times]).T
    needed = limits.excess(np.clip(carried[0], 0, 1), carried[1], np.gradient(carried[1], times))
    assert excess <= 1.005
    assert (rest.pace == 1.0) == (needed <= 1.002)


@pytest.mark.parametrize("ramp", [0.3, 0.9])
def test_how_far_a_slowed_law_exceeds_limits_is_told_where_its_clock_is_still_slowed_down(ramp):
    """A place of low path speed is met within the ramp: what is exceeded there depends on the clock then."""
    begin, pace = 1.1, 0.3
    even, rest = RestOfLaw(LAW, begin), RestOfLaw(LAW, begin, pace=pace, ramp=ramp)
    times = np.linspace(begin, begin + 12.0, 120_001)
    for share in (0.3, 0.5, 0.8):
        s, _ = rest(begin + share * ramp)
        limits = PathLimits(
            bent(0.5), [50.0], [50.0], path_speed=lambda w, s=s: np.where(np.abs(w - s) < 4e-3, 0.1, np.inf)
        )
        motion = even._motion()
        told = rest._excess(limits.at(motion.s), motion)
        assert told == pytest.approx(limits.excess(*rest.motion(times)), rel=0.06)


@pytest.mark.parametrize("duration", [20.0, 60.0, 100.0])
def test_a_long_law_is_slowed_down_no_harder_than_the_joints_may_brake(duration):
    law, speed = RestToRestLaw(duration), 3.75 / duration
    limits = PathLimits(
        lambda w, order: np.full((len(w), 1), float(order == 1)),
        np.array([1.1 * speed]),
        np.array([2.0 * speed]),
        path_speed=lambda w: np.where(w < 0.2, np.inf, 0.5 * speed),
    )
    rest = RestOfLaw.within(law, 0.5 * duration, limits)
    assert rest.pace < 1.0
    assert limits.excess(*rest.motion(0.5 * duration + np.arange(0.0, 3.0 * duration, 1e-3))) <= 1.002


def test_a_path_too_sharp_for_the_speed_at_which_it_is_entered_has_no_law():
    """Whatever the clock does later, q″ṡ² at the beginning is beyond the limit."""
    assert RestOfLaw.within(LAW, 1.5, PathLimits(bent(0.0, sharp=20.0), [5.0], [3.0])) is None
    assert RestOfLaw.within(LAW, 1.5, None) == RestOfLaw(LAW, 1.5)


def test_rests_of_rests_that_go_on_do_not_pile_up():
    rest = LAW
    for begin in np.linspace(0.2, 2.0, 30):
        rest = RestOfLaw.within(rest, float(begin), None)
    assert rest == RestOfLaw(LAW, 2.0)


def test_the_rest_of_a_slowed_rest_is_as_slow():
    slowed = RestOfLaw(LAW, 0.8, pace=0.5)
    rest = RestOfLaw.within(slowed, 1.4, None)
    assert rest.law is slowed
    done, speed = slowed(2.0)
    begun = slowed(1.4)[0]
    assert rest(2.0) == pytest.approx(((done - begun) / (1.0 - begun), speed / (1.0 - begun)))


def test_a_law_that_is_over_and_numbers_that_are_none_are_refused():
    with pytest.raises(InputError, match="begin: 3 s given; the law has reached w = 1"):
        RestOfLaw(LAW, 3.0)
    for bad in ({"begin": np.nan}, {"begin": 1.0, "pace": 0.0}, {"begin": 1.0, "pace": 1.5}):
        with pytest.raises(InputError):
            RestOfLaw(LAW, **bad)
    with pytest.raises(InputError):
        RestOfLaw(LAW, 1.0)(np.nan)


def even_path(top_speed):
    """One joint that goes on evenly, at most as fast as told."""
    return PathLimits(lambda w, order: np.full((len(w), 1), float(order == 1)), [top_speed], [1e3])


def test_a_limit_counts_as_kept_up_to_two_thousandths_beyond_it():
    top = RestOfLaw(LAW, 0.4).motion(np.linspace(0.4, 3.0, 100_001))[1].max()
    for beyond, kept in ((1.001, True), (1.004, False)):
        limits = even_path(top / beyond)
        assert (RestOfLaw.within(LAW, 0.4, limits).pace == 1.0) == kept
        assert RestOfLaw(LAW, 0.4).keeps(limits) == kept


@pytest.mark.parametrize(("share", "is_slow_enough"), [(0.2, True), (0.05, False)])
def test_a_clock_is_slowed_down_to_a_tenth_and_no_farther(share, is_slow_enough):
    top = RestOfLaw(LAW, 0.4).motion(np.linspace(1.4, 3.0, 10_001))[1].max()
    limits = even_path(1e3)
    slow = PathLimits(
        limits.joints,
        limits.speeds,
        limits.accelerations,
        path_speed=lambda w: np.where(w < 0.4, np.inf, share * top),
    )
    rest = RestOfLaw.within(LAW, 0.4, slow)
    assert (rest is not None) == is_slow_enough
    if rest is not None:
        assert 0.6 * share < rest.pace <= share * 1.1


def test_a_rest_is_not_finished_before_it_begins_and_asks_for_numbers():
    late = RestOfLaw(ExponentialLaw(1.0), 8.0)  # that law counts as finished from 6.9 s on
    assert not late.finished(7.5)
    assert late.finished(8.1)
    with pytest.raises(InputError, match="time"):
        RestOfLaw(LAW, 1.0)(-np.inf)
    with pytest.raises(InputError, match="ramp"):
        RestOfLaw(LAW, 1.0, ramp=0.0)
