"""The fastest time law within joint limits."""

from __future__ import annotations

import math
from bisect import bisect_right
from typing import TypeGuard

import numpy as np

from omniservo.errors import InputError, NoSolutionError
from omniservo.geometry.arrays import FloatArray
from omniservo.servoing.path_limits import PathLimits
from omniservo.servoing.time_law import RestToRestLaw

_STEPS = (400, 1600, 6400)
"""of constant ẅ; 400 cost a few tenths of a percent of time, more are for paths with sharp bends"""

_SMALL = 1.005
"""A stretch by no more than this ends the search for steps that are fine enough."""

_BETWEEN = 8
"""places in each step at which the limits are checked"""

_RESERVE = 1e-4
"""of the duration, for what may lie between those places"""


class TimeOptimalLaw:
    """w(t) from rest to rest in the least time: at every moment a limit is met, ẅ constant in short steps.

    The steps are those of a reachability analysis (`reachable_speeds`), which keeps the limits at its grid;
    what is missing between is looked for densely, and time is stretched by it as a whole. Acceleration jumps
    at both ends and wherever another limit takes over.
    """

    def __init__(self, limits: PathLimits) -> None:
        """Find the law.

        Args:
            limits: along the joint path.

        Raises:
            InputError: nothing moves, or as `PathLimits` says.
            NoSolutionError: the library finds no law; its numbers failed.
        """
        for steps in _STEPS:
            w = np.linspace(0.0, 1.0, steps + 1)
            speeds = _fastest(limits, w)
            self.stretched = _stretch(limits, w, speeds)
            """by this factor the law takes longer than those steps, so that limits hold between them, too"""
            if self.stretched <= _SMALL:
                break
        speeds = speeds / self.stretched
        times = np.concatenate([[0.0], np.cumsum(2.0 * np.diff(w) / (speeds[:-1] + speeds[1:]))])
        self.duration = float(times[-1])
        """[s]"""
        self._known = times, speeds, w
        self._times, self._speeds, self._w = times.tolist(), speeds.tolist(), w.tolist()

    def __call__(self, time: float) -> tuple[float, float]:
        """Return (w, ẇ [1/s]) at ``time`` [s]; (0, 0) before 0 and (1, 0) after the duration.

        Raises:
            InputError: the time is not finite.
        """
        if not math.isfinite(time):
            raise InputError(f"time: {time} given; a finite number of seconds is needed")
        if time <= 0.0:
            return 0.0, 0.0
        if time >= self.duration:
            return 1.0, 0.0
        step = bisect_right(self._times, time) - 1
        begin, end = self._times[step], self._times[step + 1]
        before, after = self._speeds[step], self._speeds[step + 1]
        share = (time - begin) / (end - begin)
        speed = before + share * (after - before)
        if share <= 0.5:
            return self._w[step] + 0.5 * (before + speed) * (time - begin), speed
        # From its own end: w never exceeds the next step's beginning, nor 1.
        return self._w[step + 1] - 0.5 * (speed + after) * (end - time), speed

    def finished(self, time: float) -> bool:
        """Return whether ``time`` [s] has reached the duration."""
        return time >= self.duration

    def motion(self, times: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return w, ẇ [1/s] and ẅ [1/s²] at times (m,) [s], finite and ≥ 0; ẅ 0 after the duration."""
        known, speeds, places = self._known
        step = np.clip(np.searchsorted(known, times, side="right") - 1, 0, len(known) - 2)
        begin, end, before, after = known[step], known[step + 1], speeds[step], speeds[step + 1]
        share = np.clip((times - begin) / (end - begin), 0.0, 1.0)
        speed = before + share * (after - before)
        first = places[step] + 0.5 * (before + speed) * share * (end - begin)
        last = places[step + 1] - 0.5 * (speed + after) * (1.0 - share) * (end - begin)
        growth = np.where(times < self.duration, (after - before) / (end - begin), 0.0)
        return np.where(share <= 0.5, first, last), speed, growth


def _fastest(limits: PathLimits, w: FloatArray) -> FloatArray:
    """Return the greatest ẇ (m,) [1/s] at w (m,) from rest to rest."""
    from omniservo.servoing.reachable_speeds import reachable_speeds  # loads pyplot

    angle = float(np.abs(limits.rates(w)[0]).max())
    if angle == 0.0:
        raise InputError("limits.joints: nothing moves, so no time is least")
    speeds = reachable_speeds(limits, w)
    if not _moves(speeds):
        # The library's tolerances are absolute: again in units of the motion, nowhere in a great hurry.
        time = limits.excess(*RestToRestLaw(1.0).motion(np.linspace(0.0, 1.0, len(w))))
        scaled = reachable_speeds(limits.in_units(angle, time), w)
        speeds = None if scaled is None else scaled / time
    if not _moves(speeds):
        raise NoSolutionError(
            "no time-optimal law found: joint speeds or accelerations out of all proportion"
        )
    return speeds


def _moves(speeds: FloatArray | None) -> TypeGuard[FloatArray]:
    """Tell whether there are speeds (m,) that come to the end."""
    return speeds is not None and bool((speeds[:-1] + speeds[1:]).min() > 0.0)


def _stretch(limits: PathLimits, w: FloatArray, speeds: FloatArray) -> float:
    """Return the factor on time with which the limits hold between the places w (m,), too."""
    squares, step = speeds**2, np.diff(w)
    share = np.linspace(0.0, 1.0, _BETWEEN + 1)
    places = w[:-1, None] + step[:, None] * share
    here = np.sqrt(squares[:-1, None] + np.diff(squares)[:, None] * share)
    acceleration = np.repeat(0.5 * np.diff(squares) / step, len(share))
    needed = limits.excess(np.clip(places.ravel(), 0.0, 1.0), here.ravel(), acceleration)
    return max(needed, 1.0) * (1.0 + _RESERVE)
