"""From a frame's stamp or arrival to the instant of its exposure, and how sure that is."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable

import numpy as np

from omniservo.hardware.camera_sources.frame_reader import StampClock
from omniservo.hardware.clock_map import ClockMap

LEAST_SIGMA = 5e-4
"""No mapped stamp is taken to be surer [s]."""

LEAST_ARRIVAL_SIGMA = 2e-3
"""No arrival tells an exposure more surely, once the constant part of the delay is known [s]."""

UNKNOWN_SPREAD = 0.01
"""Delays are taken to differ by so much at least, whatever few of them say [s]."""

MOST_AGE = 2.0
"""A stamp of this machine's clock is one if it is older than its arrival by no more [s]."""

_ARRIVALS = 60

MEASURE = "`omniservo robot delay` measures what is missing"


class FrameTimes:
    """Says when frames were exposed.

    Args:
        clock: which clock their stamps are of; None: they have no usable ones, and arrivals count.
        before: stamps and arrivals of the frames before, which also tell of the clock [s].
    """

    def __init__(self, clock: StampClock | None, before: Iterable[tuple[float | None, float]] = ()) -> None:
        self._clock = clock
        self._map = ClockMap()
        self._mapped = 0
        self._arrivals: deque[float] = deque(maxlen=_ARRIVALS)
        for stamp, arrival in before:
            self.exposure(stamp, arrival)

    @property
    def notice(self) -> str | None:
        """What is assumed of the frames' times, in a sentence; None where nothing is."""
        if self._clock is None:
            return f"frames carry no usable time stamp: exposure is taken to be their arrival; {MEASURE}"
        if self._clock == StampClock.SENDER:
            return f"exposure is the sender's time stamp, as if the least delay were none; {MEASURE}"
        return None

    @property
    def clock(self) -> ClockMap | None:
        """From the sender's stamps to this machine's time; None: stamps of this machine, or none usable."""
        return self._map if self._clock == StampClock.SENDER else None

    def exposure(self, stamp: float | None, arrival: float) -> tuple[float, float] | None:
        """Return the instant of exposure on this machine's clock and its standard deviation [s].

        Args:
            stamp: of the frame, on its clock [s]; None: it has none.
            arrival: of the frame, by `time.monotonic()` [s].

        Returns:
            None where this frame has no stamp, though the others have.

        Raises:
            ClockFault: the sender's clock was set.
            NotFinite: a stamp is not finite.
        """
        if self._clock is None:
            self._arrivals.append(arrival)
            return arrival, self._jitter()
        if stamp is None:
            return None
        if self._clock == StampClock.OWN:
            return stamp, 0.0
        mapped = self._map.monotonic(stamp, arrival)
        self._mapped += 1
        sigma = max(self._map.spread, UNKNOWN_SPREAD) / np.sqrt(self._mapped)
        return mapped, max(float(sigma), LEAST_SIGMA)

    def _jitter(self) -> float:
        """Return the standard deviation of arrivals about an even beat, frames left out or not [s]."""
        gaps = np.diff(self._arrivals)
        if len(gaps) < 4:
            return float(gaps.max(initial=LEAST_ARRIVAL_SIGMA))
        period = float(np.median(gaps))
        off = gaps - period * np.maximum(np.round(gaps / max(period, 1e-6)), 1.0)
        return max(float(np.sqrt((off**2).mean() / 2.0)), LEAST_ARRIVAL_SIGMA)


def is_own_clock(stamp: float | None, arrival: float) -> bool:
    """Tell whether a frame's stamp can be one of this machine's clock."""
    return stamp is not None and 0.0 <= arrival - stamp <= MOST_AGE
