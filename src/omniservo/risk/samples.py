"""The samples that a plan at a stated risk is searched and judged with, drawn when they are first needed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial

import numpy as np

from omniservo.estimation import TwoViewEstimate
from omniservo.estimation.uncertainty.joint_uncertainty import SOURCES, Source
from omniservo.geometry.arrays import IntArray
from omniservo.planning.planning_problem import PlanningProblem
from omniservo.risk.executions import Executions
from omniservo.risk.safe_path import Draw, allowed_violations

LEAST_COUNT = 2000
RARE = 20
"""At least so many samples are drawn for one expected violation."""

FEWER = 4
"""A plan is checked first with this part of them."""

ALONE = 400
"""for the part that each source has"""


@dataclass(frozen=True, eq=False)
class RiskSamples:
    """Executions of the estimate's problem: ``few`` and ``every`` to search with, ``check`` to judge by."""

    problem: PlanningProblem
    """of the estimate"""
    estimate: TwoViewEstimate
    rows: IntArray
    """(m,) of the estimate's points that are followed"""
    risk: float
    seed: int

    @property
    def count(self) -> int:
        """How many ``every`` and ``check`` have."""
        return max(LEAST_COUNT, math.ceil(RARE / self.risk))

    @cached_property
    def few(self) -> Executions:
        """A part, drawn for itself."""
        return self._searched(self.count // FEWER, (self.seed, 3))

    @cached_property
    def every(self) -> Executions:
        """All to search with."""
        return self._searched(self.count, self.seed)

    @cached_property
    def check(self) -> Executions:
        """Those that have no part in any search."""
        return self._drawn(self.count, self.seed + 1, SOURCES)

    @property
    def too_alike(self) -> str:
        """Why those to judge by cannot show so small a risk of any plan; "": they can."""
        count, repeats = self.count, self.check.repeats
        if allowed_violations(self.risk, count, repeats) >= 0:
            return ""
        return (
            f"the estimate's {count} samples repeat few motions: an effective sample size of "
            f"{count / repeats:.0f}, which cannot show a risk of {self.risk:g}"
        )

    @property
    def draws(self) -> tuple[Draw, ...]:
        """The few and all, to search with."""
        return lambda: self.few, lambda: self.every

    def draws_of(self, sources: tuple[Source, ...]) -> tuple[Draw, ...]:
        """Return half as many of only these sources."""
        half = self.count // 2
        few = cache(partial(self._drawn, half // FEWER, (self.seed, 3), sources))
        return few, cache(partial(self._drawn, half, self.seed, sources))

    def alone(self, source: Source) -> Executions:
        """Return a few of one source."""
        return self._drawn(ALONE, self.seed + 2, (source,))

    def _searched(self, count: int, seed: int | Sequence[int]) -> Executions:
        """Return samples of all sources that are taken for independent: others judge what is found."""
        return replace(self._drawn(count, seed, SOURCES), repeats=1.0)

    def _drawn(self, count: int, seed: int | Sequence[int], sources: tuple[Source, ...]) -> Executions:
        random, camera = np.random.default_rng(seed), self.estimate.camera or self.problem.camera
        return Executions.of(self.problem, self.estimate.sample(random, count, sources, camera, self.rows))
