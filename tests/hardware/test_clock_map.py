"""Stamps of another clock, by their arrivals alone: offset, drift, jitter, loss, steps."""

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
@pytest.mark.parametrize("offset", [-1.0, 0.0, 1.0])
@pytest.mark.parametrize("drift", [-100.0, 100.0])
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
            assert mapped <= arrival
            if stepped and step < 0.0:  # until it is noticed data look old, never fresh
                assert mapped < true + 0.01
        except ClockFault as fault:
            assert stepped
            assert ("ahead" if step > 0 else "back") in str(fault)
            seen = true - 1010.0 if seen is None else seen
    assert seen is not None
    assert seen < (0.1 if step > 0 else 0.9)
    with pytest.raises(ClockFault):
        clocks.monotonic(2000.0, 2000.0)


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
    "stamp, arrival", [(math.nan, 1.0), (1.0, math.nan), (math.inf, 1.0), (1.0, -math.inf)]
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
