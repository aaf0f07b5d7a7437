"""The sets of problems: the paper's examples, and random sets from a fixed generator (`random_problems`)."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np
from benchmarks.comparisons.planning.neutral import neutral_of
from benchmarks.comparisons.planning.path_space import PathSpace
from benchmarks.comparisons.planning.pose_check import least_values
from benchmarks.comparisons.planning.random_problems import random_problem
from benchmarks.comparisons.planning.samples import Samples
from benchmarks.planning_speed import shipped_problem

from omniservo.planning import PlanningProblem

PAPER = "paper"

SIZES = MappingProxyType(
    {
        PAPER: 3,
        "fisheye": 500,
        "perspective": 500,
        "catadioptric": 500,
        "occlusion": 500,
        "past-90": 300,
        "boxes": 200,
        "wall": 100,
    }
)
"""Name → number of problems."""

FIRST = 10
"""So many problems of every set have a checksum of their own, which the tests look at."""

CHECKSUMS = MappingProxyType(
    {
        PAPER: ("c89cbf651c64", "c89cbf651c64"),
        "fisheye": ("586a63eefed9", "2ee026cf38f4"),
        "perspective": ("61cfc03a4acf", "ac998dc1c4ff"),
        "catadioptric": ("d8cc3b4f8b26", "93566a2e0c31"),
        "occlusion": ("5cb3bf29ac01", "0b9731c61098"),
        "past-90": ("e42f36898675", "c1e9ba027dd2"),
        "boxes": ("ff9b9822f929", "315528ffc02e"),
        "wall": ("9d51e7b5eeef", "3e76e36719b3"),
    }
)
"""Name → checksums of the first ten problems, and of all."""

DECIMALS = 8
"""Numbers are rounded to so many for the checksum: what the last bits of sin and cos make of them."""


def problem(name: str, index: int) -> PlanningProblem:
    """Return one problem of a set."""
    return _paper(index) if name == PAPER else random_problem(name, index)


def problems(name: str, count: int | None = None) -> list[PlanningProblem]:
    """Return the first ``count`` problems of a set, or all."""
    return [problem(name, i) for i in range(SIZES[name] if count is None else min(count, SIZES[name]))]


def _paper(index: int) -> PlanningProblem:
    """Example 1; example 2; example 2 with the paper's obstacle point alone and nothing that hides."""
    if index == 0:
        return shipped_problem("paper-example-1")
    second = shipped_problem("paper-example-2")
    return second if index == 1 else replace(second, obstacles=second.obstacles[:1], occlusion=False)


def checksum(found: Sequence[PlanningProblem]) -> str:
    """Return 12 hexadecimal digits that change when any number of any problem does."""
    digest = hashlib.sha256()
    for one in found:
        for part in neutral_of(one):
            digest.update((np.round(np.asarray(part, dtype=np.float64), DECIMALS) + 0.0).tobytes())
    return digest.hexdigest()[:12]


def straight_is_good(one: PlanningProblem) -> bool:
    """Tell whether the straight path keeps everything at 2001 samples."""
    neutral = neutral_of(one)
    space = PathSpace(neutral, 1, 1)
    poses = Samples(space, np.linspace(0.0, 1.0, 2001)).poses(np.zeros(0))
    return bool(least_values(neutral, poses.phi, poses.t)[0].min() >= 0.0)
