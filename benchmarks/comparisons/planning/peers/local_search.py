"""What the peers that descend have in common: their settings, and several starts one after the other."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter

import numpy as np
from benchmarks.comparisons.planning.attempt import Attempt
from benchmarks.comparisons.planning.neutral import Neutral
from benchmarks.comparisons.planning.path_space import PathSpace
from benchmarks.comparisons.planning.samples import Samples

from omniservo.geometry.arrays import FloatArray

STARTS = 8
"""The straight line, then detours, at each degree from 2 to the highest."""


@dataclass(frozen=True)
class Settings:
    """What a local solver is asked for."""

    samples: int = 25
    """of w, evenly inside (0, 1)"""
    effort: bool = True
    """least bending energy; False: any path that keeps the constraints"""
    margin: float = 0.0
    """every g is kept above it, or above half of what the end poses leave where that is less"""
    all_starts: bool = False
    """the best of all starts, not the first success"""


FIRST = Settings(effort=False)
FIRST_WITH_MARGIN = Settings(effort=False, margin=0.005)
EFFORT = Settings()
EFFORT_WITH_MARGIN = Settings(margin=0.005)
DENSE = Settings(samples=100)
DENSE_BEST = Settings(samples=100, all_starts=True)

Descent = Callable[[FloatArray, float], tuple[FloatArray, bool]]
"""(start x, seconds left) → x and whether the solver calls it a success."""


def sample_places(settings: Settings) -> FloatArray:
    """Return the samples (s,)."""
    return np.arange(1, settings.samples + 1) / (settings.samples + 1.0)


def floors(space: PathSpace, margin: float) -> FloatArray:
    """Return what each of a sample's rows is kept above (m,)."""
    ends = Samples(space, np.array([0.0, 1.0])).values(np.zeros(space.size)).min(axis=0)
    return np.minimum(margin, 0.5 * np.maximum(ends, 0.0))


def multistart(
    neutral: Neutral, descent_in: Callable[[PathSpace], Descent], settings: Settings, budget: float
) -> Attempt:
    """Return the first success over degrees and starts, or the best of all of them.

    ``descent_in`` makes a solver for the paths of given degrees; its time is in ``build_seconds`` only.
    """
    taken, building, starts = 0.0, 0.0, 0
    best: tuple[float, PathSpace, FloatArray] | None = None
    last: tuple[PathSpace, FloatArray] | None = None
    for degree in range(2, max(neutral.sigma, neutral.tau) + 1):
        if best is not None:
            break
        space = PathSpace(neutral, min(degree, neutral.sigma), min(degree, neutral.tau))
        begin = perf_counter()
        descent = descent_in(space)
        building += perf_counter() - begin
        for start in space.starts(STARTS):
            if taken > budget:
                break
            begin = perf_counter()
            x, good = descent(start, budget - taken)
            taken += perf_counter() - begin
            starts, last = starts + 1, (space, x)
            if good and (best is None or space.energy(x) < best[0]):
                best = space.energy(x), space, x
            if best is not None and not settings.all_starts:
                break
    facts = {"build_seconds": building, "starts": float(starts)}
    if best is not None:
        return Attempt(True, best[1].path(best[2]), taken, facts=facts)
    note = "time limit" if taken > budget else f"no success in {starts} starts"
    return Attempt(False, None if last is None else last[0].path(last[1]), taken, note, facts)
