"""The planner's own certificate of a path."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.subdivision import PROVEN, REFUTED
from omniservo.planning.camera_path import CameraPath
from omniservo.planning.certificate import margins
from omniservo.planning.certificate.certificate import Certificate, ConstraintMargin
from omniservo.planning.certificate.distorted_margins import distorted_margins
from omniservo.planning.certificate.path_ends import ends_off
from omniservo.planning.certificate.separators import separators_of
from omniservo.planning.planning_problem import PlanningProblem
from omniservo.planning.problem_arrays import constraint_table_of

ENDS_MEET = 1e-9
"""A path starts at the identity and ends at the goal within this, in m and in the unit quaternion; so does an
initial velocity, in m and rad per unit of w."""

Verdict = Literal["certified", "refuted", "undecided"]


def certify(problem: PlanningProblem, path: CameraPath) -> tuple[Verdict, Certificate]:
    """Judge a path: "certified" (proven for all w), "refuted" (a w shows it) or "undecided".

    Raises:
        InputError: the path does not start at the identity, with the initial velocity where there is one, or
            end at the goal, or its degrees exceed the problem's: it is no path of this problem.
    """
    return certified_but_for(problem, path)[:2]


def certified_but_for(
    problem: PlanningProblem, path: CameraPath
) -> tuple[Verdict, Certificate, ConstraintMargin | None]:
    """Return what `certify` does, and the worst constraint that is not proven; None: all are."""
    _check_path(problem, path)
    constraints, optics, entries, asked = constraint_table_of(problem)
    rotation, translation = path.powers
    table = margins.path_margins(constraints, optics, asked, rotation, translation)
    found = [
        ConstraintMargin(
            f"{e.name} (point {int(row[margins.POINT])})" if e.about_point else e.name,
            float(row[margins.MARGIN]),
            e.unit,
            float(row[margins.AT_W]),
        )
        for e, row in zip(entries, table, strict=True)
    ]
    statuses = [int(status) for status in table[:, margins.STATUS]]
    polygon: FloatArray | None = None
    if problem.camera.is_distorted:
        more, more_statuses, polygon = distorted_margins(problem, constraints, rotation, translation)
        found += more
        statuses += more_statuses
    refuted, proven = REFUTED in statuses, all(s == PROVEN for s in statuses)
    verdict: Verdict = "refuted" if refuted else "certified" if proven else "undecided"
    worst = worst_of(problem, found, constraints.ell)
    open_ones = [c for c, status in zip(found, statuses, strict=True) if status != PROVEN]
    missing = worst_of(problem, open_ones, constraints.ell) if open_ones else None
    separators = separators_of(constraints, entries, table, translation)
    return verdict, Certificate(tuple(found), worst, polygon, separators), missing


def worst_of(problem: PlanningProblem, found: list[ConstraintMargin], ell: float) -> ConstraintMargin:
    """Return the smallest margin as an angle: m over the mean distance ℓ, px over the focal length.

    Of two that are one angle but for rounding the smaller margin: no line of its unit has less left.
    """
    focal = min(abs(problem.camera.fx), abs(problem.camera.fy))
    unit = {"m": ell, "px": focal, "rad": 1.0, "1": 1.0}
    return min(found, key=lambda c: (c.margin / unit[c.unit], c.margin))


def _check_path(problem: PlanningProblem, path: CameraPath) -> None:
    sigma, tau = path.degrees
    highest = problem.degrees.rotation, problem.degrees.translation
    if not (1 <= sigma <= highest[0] and 1 <= tau <= highest[1]):
        raise InputError(
            f"path: degrees {sigma} and {tau} given; legal: 1 to {highest[0]} and 1 to {highest[1]}"
        )
    ends = np.array(problem.goal_quaternion), np.array(problem.goal_translation)
    start, goal = ends_off(*path.powers, *ends)
    if math.isnan(start):
        raise InputError("path: the quaternion is 0 at an end")
    for place, error, pose in (("start", start, "the identity"), ("end", goal, "the goal")):
        if error > ENDS_MEET:
            raise InputError(f"path: its {place} misses {pose} by {error:.3g}; legal: {ENDS_MEET:g}")
    if problem.initial_velocity is not None:
        error = float(np.abs(path.sampled(np.zeros(1))[1][0, 0] - problem.initial_velocity).max())
        if error > ENDS_MEET:
            raise InputError(
                f"path: its velocity at w = 0 misses initial_velocity by {error:.3g}; legal: {ENDS_MEET:g}"
            )
