"""No path exists where an end pose already violates a constraint."""

from __future__ import annotations

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.planning.certificate.certificate import UNSEEN_PX, ConstraintMargin
from omniservo.planning.certificate.margins import pose_margins
from omniservo.planning.planning_problem import PlanningProblem
from omniservo.planning.problem_arrays import Entry, constraint_table_of

_NOISE = {"m": 1e-9, "px": 1e-7, "rad": 1e-9, "1": 1e-9}
"""What rounding can make of a constraint that is just met."""


def end_margins(problem: PlanningProblem) -> dict[str, tuple[float, str]]:
    """Return the smaller margin of the two end poses, and its unit, by name of the constraint.

    The image limits of a distorted camera are not among them.
    """
    entries, at_ends = margins_at_ends(problem)
    return {e.name: (float(at_ends[:, i, 0].min()), e.unit) for i, e in enumerate(entries)}


def violation_at_end(problem: PlanningProblem) -> str:
    """Return a sentence that names the worst violated constraint at the first end pose that has one; else "".

    It names constraint, point or obstacle, w and amount.
    """
    w, violated = violations_at_end(problem)
    return _sentence(w, violated) if violated else ""


def violations_at_end(problem: PlanningProblem) -> tuple[int, list[tuple[float, str, str]]]:
    """Return the first end pose's w that violates constraints, and margin, name and unit of each; else none.

    An image limit of a distorted camera is judged by the pixel itself, not by the polygon that plans keep to.
    """
    entries, at_ends = margins_at_ends(problem)
    for w, found in enumerate(at_ends):
        violated = [
            (float(margin), _named(entry, int(point)), entry.unit)
            for entry, (margin, point) in zip(entries, found, strict=True)
            if margin < -_NOISE[entry.unit]
        ]
        if problem.camera.is_distorted:
            violated += _violated_pixels(problem, w)
        if violated:
            return w, violated
    return 0, []


def just_met_at(problem: PlanningProblem, constraint: ConstraintMargin) -> str:
    """Return "start" or "goal", where that pose leaves nothing of a constraint but for rounding; else ""."""
    entries, at_ends = margins_at_ends(problem)
    for pose, found in zip(("start", "goal"), at_ends, strict=True):
        for entry, (margin, _) in zip(entries, found, strict=True):
            if constraint.name.split(" (point")[0] == entry.name and abs(margin) <= _NOISE[entry.unit]:
                return pose
    return ""


def margins_at_ends(problem: PlanningProblem) -> tuple[list[Entry], FloatArray]:
    """Return all entries, and margin and point of each at both end poses (2, e, 2)."""
    constraints, optics, entries, table = constraint_table_of(problem)
    poses = (
        (np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(3)),
        (np.array(problem.goal_quaternion), np.array(problem.goal_translation)),
    )
    found = [pose_margins(constraints, optics, table, *pose, float(w)) for w, pose in enumerate(poses)]
    return entries, np.array(found)


def _named(entry: Entry, point: int) -> str:
    return f"{entry.name} (point {point})" if entry.about_point else entry.name


def _sentence(w: int, violated: list[tuple[float, str, str]]) -> str:
    """Name the first violated constraint in the certificate's order, and how many more there are."""
    pose = "start" if w == 0 else "goal"
    margin, name, unit = violated[0]
    by = "lies outside the model's domain" if margin <= UNSEEN_PX else f"falls short by {-margin:.6g} {unit}"
    more = f" ({len(violated) - 1} more there)" if len(violated) > 1 else ""
    return f"the {pose} pose (w = {w}) violates {name}: {by}{more}"


def _violated_pixels(problem: PlanningProblem, w: int) -> list[tuple[float, str, str]]:
    """Return the edges and the dead zone that a distorted camera's pixels violate at an end pose."""
    camera, margin = problem.camera, problem.image_margin
    points = problem.points if w == 0 else problem.initial_T_goal.inv().apply(problem.points)
    pixels, valid = camera.project(points)
    u, v = pixels[:, 0], pixels[:, 1]
    left = {
        "visibility left edge": u + 0.5,
        "visibility right edge": camera.width - 0.5 - u,
        "visibility top edge": v + 0.5,
        "visibility bottom edge": camera.height - 0.5 - v,
    }
    if camera.dead_zone is not None:
        away = np.hypot(u - camera.dead_zone.center[0], v - camera.dead_zone.center[1])
        left["dead_zone"] = away - camera.dead_zone.radius
    violated = []
    for name, values in left.items():
        beyond = np.where(valid, values - margin, np.inf)
        j = int(np.argmin(beyond))
        if beyond[j] < -_NOISE["px"]:
            violated.append((float(beyond[j]), f"{name} (point {j})", "px"))
    return violated
