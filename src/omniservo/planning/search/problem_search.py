"""The search of one problem, its arrays made once."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.geometry.subdivision import PROVEN
from omniservo.planning.camera_path import CameraPath
from omniservo.planning.constraints.constraints import Constraints
from omniservo.planning.planning_problem import PlanningProblem
from omniservo.planning.problem_arrays import searched_constraints
from omniservo.planning.search.path_family import Ends
from omniservo.planning.search.search import ENERGY, FLOOR, NUMBER, TRIED, WORST, search, starts_in_all

STARTS = 1000
"""Starts at the highest degree before a plan counts as not found."""

GOLDEN_ANGLE = 2.399963229728653
"""Seeds turn the detours by multiples of it [rad]."""


@dataclass(frozen=True)
class Found:
    """What a search came to: a proven path, or the best attempt."""

    proven: bool
    path: CameraPath
    number: int
    """of the start that it came from"""
    energy: float
    """bending energy over ℓ², ∫‖t″‖²/ℓ² + ‖φ″‖² dw; infinite where nothing is proven"""
    least_energy: float
    """no path between these ends has less"""
    worst: float
    """smallest dimensionless value of a constraint at the samples: tells the best of failed attempts"""
    tried: int
    """so many starts, counted from the first of all"""


@dataclass(frozen=True)
class ProblemSearch:
    """Arrays in, a path and a verdict out."""

    constraints: Constraints
    ends: Ends
    degrees: IntArray
    phase: float
    """turns the directions of the detours [rad]"""

    @classmethod
    def of(cls, problem: PlanningProblem, seed: int = 0) -> ProblemSearch:
        """Return the search of a problem.

        Raises:
            InputError: the visibility margin leaves nothing of the image.
        """
        return cls(
            searched_constraints(problem),
            ends_of(problem),
            np.array([problem.degrees.rotation, problem.degrees.translation], dtype=np.int64),
            (seed * GOLDEN_ANGLE) % (2.0 * math.pi),
        )

    @property
    def starts(self) -> int:
        """How many starts there are."""
        return int(starts_in_all(self.ends, self.degrees, STARTS))

    def kernel(
        self, begin: int, end: int, economised: int, beat: float = math.inf
    ) -> tuple[int, FloatArray, FloatArray, FloatArray]:
        """Return what `search` does for the starts begin ≤ number < end."""
        window = np.array([begin, end], dtype=np.int64)
        return search(self.constraints, self.ends, self.degrees, window, self.phase, economised, beat)

    def run(self, begin: int, end: int, economised: int, beat: float = math.inf) -> Found:
        """Try the starts begin ≤ number < end, see `search`."""
        status, rotation, translation, facts = self.kernel(begin, end, economised, beat)
        path = CameraPath(rotation, translation)
        number, tried = int(facts[NUMBER]), int(facts[TRIED])
        energy, floor, worst = float(facts[ENERGY]), float(facts[FLOOR]), float(facts[WORST])
        return Found(status == PROVEN, path, number, energy, floor, worst, tried)


def ends_of(problem: PlanningProblem) -> Ends:
    """Return φ(1), t(1) and, where the problem has a velocity (v, ω), φ′(0) and t′(0) = v.

    φ(0) is the identity, so that 2 vec(φ*⊗φ′) = ω fixes the vector part of φ′(0), ω/2. Its scalar part
    changes ‖φ‖ only; it is that of the linear interpolation.
    """
    quaternion = np.array(problem.goal_quaternion)  # a type of its own, read-only, would be compiled for
    departure = np.zeros(0)
    if problem.initial_velocity is not None:
        linear, angular = problem.initial_velocity[:3], problem.initial_velocity[3:]
        departure = np.array([*(0.5 * angular), quaternion[3] - 1.0, *linear])
    return Ends(quaternion, np.array(problem.goal_translation), departure)


def ends_like(ends: Ends, path: CameraPath) -> Ends:
    """Return the same ends, reached by that way round that a path to about there turns: φ(1) or −φ(1)."""
    sign = np.copysign(1.0, path.rotation.sum(axis=1) @ ends.quaternion)
    return ends._replace(quaternion=sign * ends.quaternion)
