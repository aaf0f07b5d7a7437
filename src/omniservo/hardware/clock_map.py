"""From a sender's clock to this machine's: offset and drift, as far as arrivals tell them."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import deque
from operator import itemgetter
from statistics import fmean

import numpy as np

from omniservo.errors import ClockFault, NotFinite, ServoStop
from omniservo.geometry.arrays import FloatArray, finite_number

MOST_DRIFT = 5e-4
"""No clock is faster or slower than another by more [s/s]; bad quartz is off by 1e-4."""

SETTLING = 1.0
"""So long after the first arrival [s] the least delay may still fall by any amount: what was sent before a
connection stood arrives late, and all at once."""

STEP = 0.05
"""An arrival earlier by this than the least delay allows is a clock that was set ahead [s]."""

LATER = 0.5
"""Arrivals that for so long [s] are all later by `STEP`, and by the spread, are a clock that was set back, or
a line that became slower; see `ClockMap`."""

LEAST_LATER = 10
"""and so many of them"""

SET_BACK = 2.0
"""A single stamp older by this than explained [s] is no late message."""

OFF_BEAT = 0.25
"""A stamp that is off the others' beat by this share of a period, and by four times as much as they are, is
of a clock that was set."""

SMOOTHING = 0.1
"""share by which the spread of one bin counts"""

_STEPS = 64

_BIN = 0.1
"""Of the arrivals in so much time the earliest one counts [s]."""


class ClockMap:
    """Maps the stamps of one sender to `time.monotonic()` of this machine [s].

    arrival − stamp is the clocks' offset, its drift, and a delay that is never negative. The line below all
    these differences of the last ``window``, as near to them as can be (the edge of their lower hull under
    the mean), is offset and drift with the least delay: what every message needed at least is not seen here.
    So a mapped stamp is never later than its arrival, and later stamps never map to earlier times.

    A clock that is set ahead brings arrivals that are too early for any delay: a fault at once. One that is
    set back, and a line that becomes slower, both make all arrivals later. What distinguishes them are the
    stamps: those that a slower line brings are newer than all before, at the sender's beat; of a clock that
    was set back they begin before the last one that came in time, or off the beat. The first is a fault; the
    other is not, and moves no stamp: `later` says by how much all arrivals are late, until some are not.

    Three things cannot be distinguished. A clock that is set back by whole periods while at least as many
    messages are lost, or one whose stamps keep no beat, set back by less than the time between two of them,
    looks like a slower line: its data look too old by that. A clock that is set ahead by no more than `later`
    looks like a line that is fast again: its data look too fresh by that. Steps below `STEP` and the spread
    look like jitter.

    Args:
        window: how long arrivals count [s].

    Raises:
        InputError: a window that is not positive.
    """

    def __init__(self, window: float = 30.0) -> None:
        self._window = finite_number("window", window, above=0.0)
        self._bins: list[tuple[float, float]] = []
        """the earliest arrival of each `_BIN`: stamp since the first [s], arrival − stamp less the first's"""
        self._bin_end = -math.inf
        self._delays: list[float] = []
        """above the line, of the last bin [s]"""
        self._least: deque[tuple[float, float, int]] = deque()
        """of the last bins: when one ended, its least delay [s], number of arrivals"""
        self._first: tuple[float, float] | None = None
        self._newest = -math.inf
        self._mapped = -math.inf
        self._level, self._slope = math.nan, 0.0
        self._spread = math.nan
        self._later = 0.0
        self._steps: deque[float] = deque(maxlen=_STEPS)
        """from each newest stamp to the next [s]"""
        self._in_time, self._late = -math.inf, math.inf
        """the newest stamp that came in time, and the oldest late one since, both since the first [s]"""
        self._fault: ServoStop | None = None

    @property
    def offset(self) -> float:
        """This machine's clock less the sender's, now, with the least delay [s]; NaN before the first."""
        if self._first is None:
            return math.nan
        return self._first[1] - self._first[0] + self._line(self._newest - self._first[0])

    @property
    def drift(self) -> float:
        """How much faster this machine's clock runs than the sender's [s/s]; 1e-4 is 100 ppm."""
        return self._slope

    @property
    def spread(self) -> float:
        """Nine tenths of the last arrivals are no later than the least delay by more [s]; NaN before."""
        return self._spread

    @property
    def later(self) -> float:
        """All arrivals are so much later than they were [s]: the line is slower; 0: it is not."""
        return self._later

    def monotonic(self, stamp: float, arrival: float) -> float:
        """Return the sender's ``stamp`` [s] on this machine's clock.

        Args:
            stamp: of the sender's clock [s].
            arrival: when it came, by `time.monotonic()` [s].

        Raises:
            ClockFault: the sender's clock was set ahead or back; from then on every call raises it.
            NotFinite: a number is not finite.
        """
        if self._fault is not None:
            raise type(self._fault)(str(self._fault))
        if not (math.isfinite(stamp) and math.isfinite(arrival)):
            raise NotFinite(f"a stamp of {stamp} s that arrived at {arrival} s")
        if self._first is None:
            self._first = stamp, arrival
            self._level, self._spread = 0.0, 0.0
        x = stamp - self._first[0]
        y = self._of_faster_line(x, arrival - self._first[1] - x)
        if stamp != self._newest:  # a state that is read twice says nothing new
            settled = arrival - self._first[1] > SETTLING
            self._refuse_steps(x, y, settled)
            self._note(x, y)
            if arrival >= self._bin_end:
                self._refuse_later(arrival, settled)
            self._take_in(x, y, arrival)
        mapped = min(self._first[1] + x + self._line(x), arrival)
        if stamp < self._newest:
            return mapped
        self._newest, self._mapped = stamp, max(mapped, self._mapped)
        return self._mapped

    @property
    def _first_stamp(self) -> float:
        return math.nan if self._first is None else self._first[0]

    def _line(self, x: float) -> float:
        return self._level + self._slope * x

    def _of_faster_line(self, x: float, y: float) -> float:
        """Return what arrival − stamp were had the line not become slower; it may be fast again by now."""
        y -= self._later
        regained = min(max(self._line(x) - y, 0.0), self._later)
        self._later -= regained
        return y + regained

    def _note(self, x: float, y: float) -> None:
        """Keep in mind what tells a clock that was set back from a slower line."""
        if x + self._first_stamp > self._newest > -math.inf:
            self._steps.append(x + self._first_stamp - self._newest)
        if y - self._line(x) > STEP + self._spread:
            self._late = min(self._late, x)
        else:
            self._in_time, self._late = max(self._in_time, x), math.inf

    def _was_set_back(self, step: float) -> bool:
        """Return whether stamps say that the sender's clock was set back by ``step`` [s]."""
        if not self._steps:  # none was newer than the very first
            return True
        since = self._late - self._in_time
        steps = np.array(self._steps)
        period = float(np.median(steps))
        own = float(np.median(_off_beat(steps, period)))
        if_slower, if_set = _off_beat(np.array([since, since + step]), period)
        return bool(if_slower > max(OFF_BEAT * period, 4.0 * own) and if_slower > 2.0 * if_set)

    def _refuse_steps(self, x: float, y: float, settled: bool) -> None:
        excess = y - self._line(x)
        if settled and excess < -STEP:
            self._fail(f"the sender's clock went ahead by {-excess:.3f} s")
        if excess > SET_BACK and x < self._newest - self._first_stamp - SET_BACK:
            self._fail(f"the sender's clock went back by {excess:.3f} s")
        self._delays.append(excess)

    def _refuse_later(self, arrival: float, settled: bool) -> None:
        """Judge the arrivals of the last bin, and of those before it."""
        least = min(self._delays)
        if least <= STEP + self._spread:  # what is all later says nothing of the spread
            now = float(np.quantile(self._delays, 0.9)) - min(least, 0.0)
            self._spread += SMOOTHING * (now - self._spread) if self._spread > 0.0 else now
        self._least.append((arrival, least, len(self._delays)))
        self._delays.clear()
        while self._least[0][0] <= arrival - LATER - _BIN and self._enough(1):
            self._least.popleft()
        seconds = arrival - self._least[0][0]
        early = min(least for _, least, _ in self._least)
        if settled and early > STEP + self._spread and seconds >= LATER and self._enough(0):
            if self._was_set_back(early):
                self._fail(f"the sender's clock went back by {early:.3f} s, {seconds:.1f} s ago")
            self._later += early

    def _enough(self, without: int) -> bool:
        """Return whether the bins, but for the oldest, hold `LEAST_LATER` arrivals."""
        return sum(count for _, _, count in list(self._least)[without:]) >= LEAST_LATER

    def _fail(self, words: str) -> None:
        self._fault = ClockFault(words)
        raise ClockFault(words)

    def _take_in(self, x: float, y: float, arrival: float) -> None:
        """Add a point, and lay the line anew where that can change it."""
        below = y < self._line(x)
        if arrival >= self._bin_end:
            self._bin_end = arrival + _BIN
            self._bins.append((x, y))
            self._bins = [each for each in self._bins if each[0] >= self._bins[-1][0] - self._window]
            self._lay()
        elif y - self._slope * x < self._bins[-1][1] - self._slope * self._bins[-1][0]:
            self._bins[-1] = x, y
            if below:
                self._lay()

    def _lay(self) -> None:
        """Lay the line under all points: the edge of their lower hull under the mean, its drift bounded."""
        points = sorted(self._bins)
        hull, middle = _lower_hull(points), fmean(x for x, _ in points)
        slope = 0.0
        if len(hull) > 1:
            k = min(max(bisect_left(hull, middle, key=itemgetter(0)), 1), len(hull) - 1)
            (x0, y0), (x1, y1) = hull[k - 1], hull[k]
            slope = (y1 - y0) / (x1 - x0) if x1 > x0 else 0.0
        self._slope = slope = min(max(slope, -MOST_DRIFT), MOST_DRIFT)
        self._level = min(y - slope * x for x, y in points)


def _off_beat(steps: FloatArray, period: float) -> FloatArray:
    """Return how far steps are off a positive whole number of periods [s]."""
    return np.asarray(np.abs(steps - period * np.maximum(np.round(steps / period), 1.0)))


def _lower_hull(points: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the lower hull of points (x, y) that are sorted, from left to right: plain numbers."""
    hull: list[tuple[float, float]] = []
    for x, y in points:
        while len(hull) > 1:
            (ax, ay), (bx, by) = hull[-2], hull[-1]
            if (bx - ax) * (y - ay) > (by - ay) * (x - ax):
                break
            hull.pop()
        hull.append((x, y))
    return hull
