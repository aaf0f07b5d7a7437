"""Stamps of another clock, by their arrivals alone: offset, drift, jitter, loss, steps."""

import contextlib
import math

import numpy as np
import pytest

from omniservo.errors import ClockFault, InputError, NotFinite
from omniservo.hardware import ClockMap, FaultyLine, LinkFaults

RATES = (500.0, 125.0, 30.0)


def messages(faults, rate, seconds, begin=1000.0):
    """(true time, stamp, arrival) of what a server sends, as it arrives."""
    line, sent = FaultyLine(faults, begin), begin + np.arange(int(rate * seconds)) / rate
    for true in sent:
        line.put((true, line.stamp(true)), true)
    while (arrival := line.next_due()) is not None:
        for true, stamp in line.due(arrival):
            yield true, stamp, arrival


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize(("offset", "drift"), [(-1.0, -100.0), (0.0, 100.0), (1.0, -100.0)])
def test_stamps_become_this_machines_time(rate, offset, drift):
    faults = LinkFaults(0.04, 0.03, 0.05, offset, drift, seed=3, reordered=True)
    clocks, errors = ClockMap(), []
    for true, stamp, arrival in messages(faults, rate, 60.0):
        mapped = clocks.monotonic(stamp, arrival)
        assert mapped <= arrival
        errors.append(mapped - true - 0.01)  # 10 ms is the least delay, which cannot be seen
    late = np.abs(errors[int(5 * rate) :])
    assert late.max() < (1.5e-3 if rate > 100 else 4e-3)
    assert np.abs(errors[int(rate) :]).max() < 0.02
    assert clocks.drift * 1e6 == pytest.approx(-drift, abs=60 if rate > 100 else 150)
    assert clocks.offset == pytest.approx(-offset - drift * 60e-6 + 0.01, abs=4e-3)
    assert 0.03 < clocks.spread < 0.06  # of 60 ms, evenly


def test_in_a_stream_that_waits_for_its_late_messages_only_the_least_delay_is_more():
    faults, clocks, errors = LinkFaults(0.04, 0.03, 0.05, 1.0, 100.0, seed=3), ClockMap(), []
    for true, stamp, arrival in messages(faults, 125.0, 40.0):
        errors.append(clocks.monotonic(stamp, arrival) - true)
    assert np.ptp(errors[1000:]) < 0.012
    assert 0.01 <= errors[-1] < 0.035


def test_later_stamps_never_map_to_earlier_times():
    faults, clocks, last = LinkFaults(0.2, 0.2, seed=1), ClockMap(), -math.inf
    for _, stamp, arrival in messages(faults, 125.0, 5.0):
        mapped = clocks.monotonic(stamp, arrival)
        assert mapped >= last
        last = mapped


def test_what_waited_until_the_connection_stood_is_no_step():
    clocks = ClockMap()
    for k in range(30):  # a second of frames at once
        clocks.monotonic(k / 30, 101.0 + 1e-3 * k)
    for k in range(30, 200):
        mapped = clocks.monotonic(k / 30, 100.0 + k / 30 + 5e-3)
    assert mapped == pytest.approx(100.0 + 199 / 30 + 5e-3, abs=1e-3)


@pytest.mark.parametrize("step", [-100.0, -3.0, -0.3, -0.15, 0.15, 0.3, 3.0])
@pytest.mark.parametrize("rate", RATES)
def test_a_step_either_way_is_a_fault_within_a_second_and_stays_one(step, rate):
    faults, clocks, seen = LinkFaults(0.04, 0.03, 0.05, seed=5), ClockMap(), None
    for true, stamp, arrival in messages(faults, rate, 20.0):
        stepped = true > 1010.0
        try:
            mapped = clocks.monotonic(stamp + step * stepped, arrival)
        except ClockFault:
            seen = true - 1010.0
            break
        assert mapped <= arrival
        if stepped and step < 0.0:  # until it is noticed data look old, never fresh
            assert mapped < true + 0.01
    assert seen is not None
    assert 0.0 < seen < (0.1 if step > 0 else 0.9)
    with pytest.raises(ClockFault, match="ahead" if step > 0 else "back"):
        clocks.monotonic(2000.0, 2000.0)


def slower(faults, rate, by, since, seconds):
    """What arrives of a line that is slower by ``by`` for so long, from ``since`` on."""
    due = []
    for true, stamp, arrival in messages(faults, rate, seconds):
        held = since[0] <= true - 1000.0 < since[1]
        due.append((true, stamp, arrival + by * held))
    last = -math.inf
    for true, stamp, arrival in due:  # in order
        last = max(last, arrival)
        yield true, stamp, last


@pytest.mark.parametrize(("by", "loss"), [(0.09, 0.05), (0.6, 0.0), (1.5, 0.05)])
@pytest.mark.parametrize("rate", [125.0, 30.0, 5.0])
def test_a_line_that_becomes_slower_is_no_step_and_moves_no_stamp(by, rate, loss):
    faults, clocks, off, later = LinkFaults(0.02, 0.005, loss, 1.0, 50.0, seed=7), ClockMap(), [], []
    for true, stamp, arrival in slower(faults, rate, by, (10.0, 60.0), 80.0):
        off.append((true - 1000.0, clocks.monotonic(stamp, arrival) - true))
        later.append((true - 1000.0, clocks.later))
    times, off = np.array(off).T
    before = np.median(off[(times > 5.0) & (times < 10.0)])
    assert np.abs(off[times > 5.0] - before).max() < 0.025
    late = np.array(later)[:, 1]
    assert late[times < 10.0].max() == 0.0
    assert np.abs(late[(times > 12.5) & (times < 59.0)] - by).max() < 0.03
    assert late[times > 62.0].max() < 0.02
    assert clocks.spread < 0.06


@pytest.mark.parametrize("rate", [10.0, 5.0])
@pytest.mark.parametrize("step", [-0.07, -0.09, -0.13, -0.25])
def test_a_clock_that_is_set_back_by_less_than_a_period_breaks_the_beat(rate, step):
    faults, clocks = LinkFaults(0.02, 0.003, 0.0, seed=2), ClockMap()
    with pytest.raises(ClockFault, match="went back by 0."):
        for true, stamp, arrival in messages(faults, rate, 20.0):
            clocks.monotonic(stamp + step * (true > 1010.0), arrival)


@pytest.mark.parametrize("seed", range(12))
def test_a_line_of_stamps_that_keep_no_beat_may_become_slower(seed):
    clocks, rng, true = ClockMap(), np.random.default_rng(seed), 0.0
    for _ in range(300):
        true += rng.uniform(0.06, 0.14)
        clocks.monotonic(true, 100.0 + true + 0.15 * (true > 20.0))
    assert clocks.later == pytest.approx(0.15, abs=1e-3)


@pytest.mark.parametrize("step", [0.0, -0.15])
def test_messages_that_were_held_up_before_say_nothing_of_what_comes_later(step):
    clocks, last = ClockMap(), 0.0
    with pytest.raises(ClockFault, match="went back") if step else contextlib.nullcontext():
        for k in range(900):
            slower = 0.1 * (k >= 600 and not step)
            last = max(last, 100.0 + k / 30 + 0.2 * (k in (100, 300)) + slower)
            clocks.monotonic(k / 30 + step * (k >= 600), last)
    assert clocks.later == pytest.approx(0.0 if step else 0.1, abs=1e-3)


def test_a_clock_that_is_set_back_in_a_slower_line_is_a_fault_too():
    clocks, faults = ClockMap(), LinkFaults(0.02, 0.005, seed=4)
    with pytest.raises(ClockFault, match="went back"):
        for true, stamp, arrival in slower(faults, 30.0, 0.2, (10.0, 99.0), 30.0):
            clocks.monotonic(stamp - 0.3 * (true > 1020.0), arrival)
    assert clocks.later == pytest.approx(0.2, abs=0.02)


def test_a_clock_that_is_set_ahead_in_a_slower_line_is_a_fault_beyond_what_the_line_may_regain():
    clocks, faults = ClockMap(), LinkFaults(0.02, 0.005, seed=4)
    with pytest.raises(ClockFault, match="ahead by 0.2"):
        for true, stamp, arrival in slower(faults, 30.0, 0.1, (10.0, 99.0), 30.0):
            clocks.monotonic(stamp + 0.35 * (true > 1020.0), arrival)


def test_a_line_that_is_slower_twice_and_half_as_slow_again_is_followed():
    clocks = ClockMap()
    for k in range(3000):
        true = k / 30
        by = 0.1 * (true >= 20.0) + 0.2 * (true >= 40.0) - 0.25 * (true >= 60.0)
        mapped = clocks.monotonic(true, 100.0 + true + by)
        assert mapped == pytest.approx(100.0 + true, abs=1e-3 if by == 0.0 else 0.011)
        if true == 59.0:
            assert clocks.later == pytest.approx(0.3, abs=1e-3)
    assert clocks.later == pytest.approx(0.05, abs=1e-3)


def test_a_spread_that_grows_is_reported_as_such():
    clocks, rng = ClockMap(), np.random.default_rng(0)
    for k in range(3000):
        true = k / 30
        mapped = clocks.monotonic(true, 100.0 + true + rng.uniform(0.0, 0.01 if true < 30.0 else 0.2))
        assert mapped == pytest.approx(100.0 + true, abs=0.02)
        if true == 29.0:
            assert clocks.spread < 0.012
    assert 0.1 < clocks.spread < 0.25
    assert clocks.later == 0.0


def test_messages_that_were_held_up_are_no_step():
    clocks = ClockMap()
    for k in range(2000):
        true = 100.0 + k / 125
        held = 12.0 < true - 100.0 <= 13.5
        mapped = clocks.monotonic(true, 113.5 + 1e-5 * k if held else true + 0.002)
        assert mapped == pytest.approx(true + 0.002, abs=2e-3)


def test_a_stamp_that_stands_still_is_no_step_but_grows_old():
    clocks = ClockMap()
    for k in range(500):
        mapped = clocks.monotonic(k / 100, 50.0 + k / 100)
    for k in range(300):
        assert clocks.monotonic(4.99, 55.0 + k / 100) == pytest.approx(mapped, abs=1e-9)


@pytest.mark.parametrize(
    ("stamp", "arrival"), [(math.nan, 1.0), (1.0, math.nan), (math.inf, 1.0), (1.0, -math.inf)]
)
def test_what_is_no_time_is_refused_and_changes_nothing(stamp, arrival):
    clocks = ClockMap()
    clocks.monotonic(0.0, 5.0)
    with pytest.raises(NotFinite, match="stamp"):
        clocks.monotonic(stamp, arrival)
    assert clocks.monotonic(1.0, 6.0) == 6.0


def test_nothing_is_known_before_the_first():
    clocks = ClockMap()
    assert math.isnan(clocks.offset)
    assert math.isnan(clocks.spread)
    with pytest.raises(InputError, match="window"):
        ClockMap(0.0)


def test_a_clock_that_is_set_back_right_after_the_first_stamp_is_a_fault():
    clock = ClockMap()
    clock.monotonic(100.0, 1000.0)
    with pytest.raises(ClockFault, match=r"went back by 1\.(499|500) s"):
        for k in range(1, 150):
            clock.monotonic(98.5 + 0.01 * k, 1000.0 + 0.01 * k)
