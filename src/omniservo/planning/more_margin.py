"""Paths that keep more than the problem asks for.

The problem is tightened: every constraint is to keep min(μ, nine tenths of what the end poses leave of it),
as an angle (m over the target's mean distance, px over the focal length), and never less than the smallest
margin of the plan in hand. μ is bisected between that margin and the most that any end pose leaves; where the
tightened problem has a proven path, the path of least effort there is the better one. Without the cap nothing
could be gained wherever an end pose leaves little. Not tightened are the domain, ‖φ‖ and the image of a
distorted camera.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np

from omniservo.errors import InputError
from omniservo.planning.camera_path import CameraPath
from omniservo.planning.end_poses import end_margins
from omniservo.planning.plan import Plan
from omniservo.planning.planning_problem import PlanningProblem
from omniservo.planning.search.problem_search import ProblemSearch
from omniservo.planning.search.search import FEW
from omniservo.planning.time_budget import TimeBudget
from omniservo.planning.widened import widened

CAP = 0.9
"""The part of what the end poses leave that a path is required to keep on its whole way."""

BISECTIONS = 10
"""of μ; the last interval is 1/1024 of the first"""

UNTIGHTENED = ("domain", "rotation")
"""Constraints that no one asks more of: the image's own limits and the ends keep them."""

TINY = 1e-6
"""A path may keep so much less than what it is compared with, as an angle: what rounding makes of it."""


def paths_of_more_margin(plan: Plan, budget: TimeBudget, seed: int) -> Iterator[CameraPath]:
    """Yield proven paths that keep more and more than those of a certified plan."""
    problem, units, kept = plan.problem, angle_units(plan.problem), max(0.0, smallest_margin(plan))
    ends = {
        name: margin / units[unit]
        for name, (margin, unit) in end_margins(problem).items()
        if not name.startswith(UNTIGHTENED)
    }
    low, high = kept, CAP * max(ends.values())
    for _ in range(BISECTIONS):
        if budget.is_used_up or high - low <= TINY:
            return
        middle = 0.5 * (low + high)
        asked = {name: max(min(middle, CAP * end), min(kept, end) - TINY, 0.0) for name, end in ends.items()}
        try:
            search = ProblemSearch.of(tightened(problem, asked), seed)
        except InputError:  # the image, or the workspace, has nothing left
            high = middle
            continue
        found = search.run(0, min(1 + FEW, search.starts), 1)
        if found.proven:
            low = middle
            yield found.path
        else:
            high = middle


def smallest_margin(plan: Plan) -> float:
    """Return the smallest margin of a plan's certificate as an angle; −∞ where there is none."""
    if plan.certificate is None:
        return -math.inf
    units, found = angle_units(plan.problem), plan.certificate.constraints
    return min(c.margin / units[c.unit] for c in found if not c.name.startswith(UNTIGHTENED))


def angle_units(problem: PlanningProblem) -> dict[str, float]:
    """Return what a margin is divided by to be an angle: m by ℓ, px by the focal length."""
    distance = float(np.linalg.norm(problem.points, axis=1).mean())
    focal = min(abs(problem.camera.fx), abs(problem.camera.fy))
    return {"m": max(distance, 1e-6), "px": focal, "rad": 1.0, "1": 1.0}


def tightened(problem: PlanningProblem, asked: Mapping[str, float]) -> PlanningProblem:
    """Return the problem with so much more required, as an angle, by name of the constraint.

    Raises:
        InputError: nothing is left of the workspace.
    """
    units = angle_units(problem)
    image = [value for name, value in asked.items() if name.startswith(("visibility", "dead_zone"))]
    metres = {name: value * units["m"] for name, value in asked.items()}
    return widened(problem, metres, units["px"] * min(image, default=0.0))
