"""Old frames are dropped until their age settles; exposures are known as well as is said."""

import numpy as np
import pytest

from omniservo.errors import ClockFault
from omniservo.hardware.camera_sources.frame_reader import StampClock
from omniservo.hardware.camera_sources.frame_times import FrameTimes, is_own_clock
from omniservo.hardware.camera_sources.settling import MOST, Settling


def first_used(frames):
    """Return how many (arrival, stamp) are dropped, and the Settling."""
    settling = Settling()
    for k, (arrival, stamp) in enumerate(frames):
        if settling.add(arrival, stamp):
            return k, settling
    return len(frames), settling


def after_a_burst(rate, burst, spacing=0.001, stamped=True, count=400):
    """Return frames of which the first come out of a buffer, all at once."""
    exposed = np.arange(count) / rate
    arrivals = np.maximum(exposed, exposed[burst]) + 0.02
    arrivals[:burst] += spacing * np.arange(burst) - spacing * burst
    return [
        (a, e + 77.0 if stamped else None) for a, e in zip(arrivals.tolist(), exposed.tolist(), strict=True)
    ]


@pytest.mark.parametrize("stamped", [True, False])
@pytest.mark.parametrize("rate", [5.0, 30.0, 120.0])
@pytest.mark.parametrize("burst", [0, 3, 10])
def test_frames_out_of_a_buffer_are_dropped_and_then_no_more(rate, burst, stamped):
    frames = after_a_burst(rate, burst, stamped=stamped)
    dropped, settling = first_used(frames)
    assert dropped >= burst
    assert settling.is_settled
    assert not settling.gave_up
    assert settling.stamps_are_times == stamped
    assert frames[dropped][0] - frames[burst][0] <= 1.6
    assert all(settling.add(*frame) for frame in frames[dropped:])


def test_a_buffer_that_is_emptied_slowly_is_waited_for():
    exposed = np.arange(300) / 30.0
    arrivals = np.maximum(
        1.2 + 0.4 * exposed, exposed
    )  # twice and a half as fast as they were exposed, until 2 s
    dropped, settling = first_used(list(zip(arrivals.tolist(), exposed.tolist(), strict=True)))
    assert not settling.gave_up
    assert arrivals[dropped] - exposed[dropped] < 0.15


@pytest.mark.parametrize("seed", range(5))
def test_jitter_is_no_buffer(seed):
    exposed = np.arange(100) / 30.0
    arrivals = np.sort(exposed + 0.06 + np.random.default_rng(seed).uniform(-0.03, 0.03, 100))
    dropped, settling = first_used(list(zip(arrivals.tolist(), exposed.tolist(), strict=True)))
    assert dropped < 30
    assert settling.stamps_are_times


@pytest.mark.parametrize(
    "stamps",
    [np.zeros(200), 3.0 * np.arange(200) / 30.0, 0.3 * np.arange(200) / 30.0, -np.arange(200) / 30.0],
)
def test_numbers_that_keep_no_time_are_no_stamps_and_hold_up_nothing_for_long(stamps):
    arrivals = np.arange(200) / 30.0
    dropped, settling = first_used(list(zip(arrivals.tolist(), stamps.tolist(), strict=True)))
    assert arrivals[dropped] <= MOST + 0.1
    assert not settling.stamps_are_times


def test_the_senders_clock_is_mapped_within_what_is_said():
    random = np.random.default_rng(1)
    true = np.arange(0.0, 20.0, 1 / 30.0)
    arrivals = true + random.uniform(0.0, 0.04, len(true))
    stamps = true * (1.0 - 1e-4) - 500.0
    times = FrameTimes(
        StampClock.SENDER, list(zip(stamps[:20].tolist(), arrivals[:20].tolist(), strict=True))
    )
    found = [times.exposure(s, a) for s, a in zip(stamps[20:].tolist(), arrivals[20:].tolist(), strict=True)]
    off = np.array([t for t, _ in found]) - true[20:]
    sigma = np.array([s for _, s in found])
    assert np.all(np.abs(off) < 3.0 * sigma)
    assert sigma[-1] < 0.003
    assert "sender's time stamp, as if the least delay were none" in times.notice
    with pytest.raises(ClockFault):
        times.exposure(stamps[-1] + 5.0, arrivals[-1] + 0.01)


@pytest.mark.parametrize("jitter", [0.0, 0.01])
def test_arrivals_are_as_sure_as_their_beat_frames_left_out_or_not(jitter):
    random = np.random.default_rng(2)
    times, sigma = FrameTimes(None), np.nan
    for k in range(200):
        if random.random() > 0.1:
            _, sigma = times.exposure(None, k / 30.0 + random.normal(0.0, jitter))
    assert max(jitter, 0.002) * 0.7 < sigma < max(jitter, 0.002) * 1.5


def test_a_frame_without_a_stamp_among_others_with_one_has_no_time():
    assert FrameTimes(StampClock.SENDER).exposure(None, 1.0) is None


@pytest.mark.parametrize(
    ("stamp", "own"), [(10.0, True), (9.9, True), (8.1, True), (7.9, False), (10.1, False), (None, False)]
)
def test_a_stamp_of_this_machines_clock_is_a_little_older_than_its_arrival(stamp, own):
    assert is_own_clock(stamp, 10.0) == own
