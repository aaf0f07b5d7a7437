"""A problem that asks for more of what it asks for already."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from omniservo.planning.checks import LARGEST
from omniservo.planning.obstacles.half_space import HalfSpace
from omniservo.planning.obstacles.obstacle import Obstacle, hides_points
from omniservo.planning.planning_problem import PlanningProblem
from omniservo.planning.workspace import Workspace


def widened(problem: PlanningProblem, metres: Mapping[str, float], px: float) -> PlanningProblem:
    """Return the problem with more required: ``metres`` by name of the constraint, ``px`` of all limits.

    A line of sight keeps more from an obstacle that is made larger, its clearance that much smaller, if
    it has so much; the domain and ‖φ‖ stay as they are.

    Raises:
        InputError: nothing is left of the workspace.
    """
    changes: dict[str, Any] = {
        "obstacles": tuple(_larger(problem, o, i, metres) for i, o in enumerate(problem.obstacles)),
        "least_distance": problem.least_distance + metres.get("least_distance", 0.0),
        "visibility_margin": problem.visibility_margin + px,
    }
    if problem.workspace is not None:
        changes["workspace"] = _smaller(problem.workspace, metres)
    return replace(problem, **changes)


def widened_evenly(problem: PlanningProblem, metres: float, px: float) -> PlanningProblem:
    """Return the problem for a camera that may be ``metres`` off its path and see points ``px`` off theirs.

    A camera's centre that deviates by d comes nearer to anything by no more, and neither does a line of
    sight.

    Raises:
        InputError: nothing is left of the workspace.
    """
    names = ["least_distance", *(f"workspace {axis} {end}" for axis in "xyz" for end in ("min", "max"))]
    sides = () if problem.workspace is None else problem.workspace.half_spaces
    names += [f"workspace half-space {i}" for i in range(len(sides))]
    for i, obstacle in enumerate(problem.obstacles):
        names += [] if obstacle.clearance is None else [f"clearance obstacle {i}"]
        names += [f"occlusion obstacle {i}"] if problem.occlusion else []
    farther = replace(problem, clearance=problem.clearance + metres)
    return widened(farther, dict.fromkeys(names, metres), px)


def _larger(problem: PlanningProblem, obstacle: Obstacle, i: int, metres: Mapping[str, float]) -> Obstacle:
    """Return it with a larger clearance and, where it hides points, larger itself."""
    own = problem.clearance if obstacle.clearance is None else obstacle.clearance
    clearance = own + metres.get(f"clearance obstacle {i}", 0.0)
    grown = metres.get(f"occlusion obstacle {i}", 0.0)
    if isinstance(obstacle, HalfSpace) or not hides_points(obstacle):
        grown = 0.0
    elif grown > 0.0:
        obstacle = obstacle.grown(grown)
    return replace(obstacle, clearance=min(max(clearance - grown, 0.0), LARGEST))


def _smaller(workspace: Workspace, metres: Mapping[str, float]) -> Workspace:
    """Return the workspace with every wall moved inward."""
    sides = tuple(
        HalfSpace(side.normal, side.offset + metres.get(f"workspace half-space {i}", 0.0))
        for i, side in enumerate(workspace.half_spaces)
    )
    if workspace.min is None or workspace.max is None:
        return Workspace(half_spaces=sides)
    low = workspace.min + [metres.get(f"workspace {axis} min", 0.0) for axis in "xyz"]
    high = workspace.max - [metres.get(f"workspace {axis} max", 0.0) for axis in "xyz"]
    return Workspace(low, high, sides)
