"""The planning problem that follows from an estimate, and from a file of obstacles."""

from __future__ import annotations

from pathlib import Path

from omniservo.errors import InputError, spelled
from omniservo.estimation import TwoViewEstimate
from omniservo.files import read_document
from omniservo.geometry.pose_fields import pose_fields
from omniservo.planning.obstacles.obstacle_fields import only_fields
from omniservo.planning.planning_problem import PlanningProblem
from omniservo.planning.problem_file import FORMAT as PROBLEM_FORMAT
from omniservo.planning.problem_file import OPTIONAL, read_problem

FORMAT = "omniservo.obstacles/1"
"""A problem file without camera, points and goal."""


def problem_around(
    estimate: TwoViewEstimate, obstacles: str | Path, *, clearance: float | None = None
) -> PlanningProblem:
    """Return the problem of an estimate's camera, points and goal among a file's obstacles.

    Args:
        estimate: metric, of status "ok", with the camera that took its images.
        obstacles: a JSON or YAML file: ``format``, and any field of a problem file but ``camera``, ``points``
            and ``goal``; in the initial camera frame.
        clearance: replaces the file's [m].

    Raises:
        InputError: the estimate has no pose, no scale or no camera; or what the file's fields must be.
    """
    pose = estimate.initial_T_goal
    if pose is None:
        raise InputError(f"estimate: status {estimate.status!r}: no pose to plan to; {estimate.message}")
    if not estimate.is_metric:
        raise InputError(NOT_METRIC)
    if estimate.camera is None:
        raise InputError("estimate: camera: missing (an older version's file?); estimate again")
    source = str(obstacles)
    try:
        given = dict(only_fields(read_document(obstacles), ("format",), OPTIONAL))
    except InputError as error:
        raise InputError(str(error) if str(error).startswith(source) else f"{source}: {error}") from None
    if given.pop("format") != FORMAT:
        raise InputError(f"{source}: format: not a file of obstacles; legal: {spelled(FORMAT)}")
    own = {
        "format": PROBLEM_FORMAT,
        "camera": estimate.camera.to_dict(),
        "points": estimate.points[estimate.inliers].tolist(),
        "goal": pose_fields(pose),
    }
    kept = {} if clearance is None else {"clearance": clearance}
    return read_problem(PlanningProblem, {**own, **given, **kept}, Path(obstacles).parent, source)


NOT_METRIC = (
    "estimate: is_metric: false given; obstacles are in metres: estimate with a scale (--displacement or "
    "--target; scale=…)"
)
