"""A new plan on the way: from the present pose and velocity, near the rest of the old path."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import RigidTransform

from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray, finite_number
from omniservo.geometry.quick_poses import quaternion_of
from omniservo.geometry.single_pose import single_pose
from omniservo.geometry.subdivision import PROVEN
from omniservo.planning.camera_path import CameraPath
from omniservo.planning.checks import bounded_array
from omniservo.planning.constraints.constraints import Constraints
from omniservo.planning.end_poses import violation_at_end
from omniservo.planning.improving_plans import first_proven, looked
from omniservo.planning.judged_plan import infeasible_plan, judged_plan
from omniservo.planning.plan import Plan
from omniservo.planning.planning_problem import PlanningProblem
from omniservo.planning.search.path_family import Ends
from omniservo.planning.search.problem_search import ProblemSearch
from omniservo.planning.time_budget import TimeBudget
from omniservo.replanning.frame_change import problem_from
from omniservo.replanning.rest_of_path import settle_rest


def replan(
    plan: Plan,
    w: float = 0.0,
    problem: PlanningProblem | None = None,
    *,
    pose: RigidTransform | None = None,
    velocity: npt.ArrayLike | None = None,
    time_budget: float | None = None,
    seed: int = 0,
) -> Plan:
    """Return a plan for the rest of the way, in the present camera frame: pose and velocity go on.

    Its parameter s runs over the rest of the old one, w + (1 − w)s: with the time law carried on so,
    twist and pose have no jump. Tried first is the rest of the old path, pushed off what is in its way; it
    stays as it is where nothing is. If nothing is proven near it, everything is searched as by `plan_path`.

    Args:
        plan: the plan that is followed; any that has a path.
        w: where on it the camera is, 0 ≤ w < 1.
        problem: what is known now, in the frame and the parameter of the old plan: its problem with
            obstacles, points or goal changed (`dataclasses.replace`). None: as it was.
        pose: the present pose in the old plan's initial frame; None: that of the old path at w.
        velocity: the present twist (6,), (linear [m], angular [rad]) per unit of the old w, in the camera
            frame. None: that of the old path at w; at w = 0 what the problem asks for, so that a camera that
            rests may leave in any direction.
        time_budget: [s], checked between starts; None: without end.
        seed: as for `plan_path`.

    Raises:
        InputError: an argument that is not legal, or a plan without a path.
    """
    budget = TimeBudget(time_budget)
    finite_number("seed", seed, minimum=0)
    old, pose, rest = rest_of_plan(plan, w, problem, pose, velocity)
    reason = violation_at_end(rest)
    if reason:
        return infeasible_plan(rest, budget.begin, "certified", reason)
    search = ProblemSearch.of(rest, int(seed))
    near = path_near_rest(search, old, w, pose)
    if near is not None:
        return judged_plan(rest, near, budget.begin, "certified", "")
    found, tried = first_proven(search, budget, 1)
    return judged_plan(rest, found.path, budget.begin, "certified", "", looked(tried, budget))


def rest_of_plan(
    plan: Plan,
    w: float,
    problem: PlanningProblem | None,
    pose: RigidTransform | None = None,
    velocity: npt.ArrayLike | None = None,
) -> tuple[CameraPath, RigidTransform, PlanningProblem]:
    """Return the old path, the present pose on it, and the problem of the rest seen from there.

    Raises:
        InputError: as `replan`.
    """
    w = _place(w)
    if plan.path is None:
        raise InputError(f"plan: status {plan.status!r} without a path; a plan with a path is needed")
    problem = plan.problem if problem is None else problem
    if not isinstance(problem, PlanningProblem):
        raise InputError(f"problem: {type(problem).__name__} given; a PlanningProblem or None is needed")
    pose = _pose(plan.path, w, pose)
    return plan.path, pose, problem_from(problem, pose, w, _velocity(plan.path, w, problem, velocity))


def path_near_rest(
    search: ProblemSearch, old: CameraPath, w: float, pose: RigidTransform
) -> CameraPath | None:
    """Return a proven path near the rest of an old one, None where there is none; see `settle_rest`."""
    if old.degrees[0] > search.degrees[0] or old.degrees[1] > search.degrees[1]:
        return None
    status, rotation, translation = settle_rest(*rest_arguments(search, old, w, pose))
    return CameraPath(rotation, translation) if status == PROVEN else None


def rest_arguments(
    search: ProblemSearch, old: CameraPath, w: float, pose: RigidTransform
) -> tuple[Constraints, Ends, FloatArray, FloatArray, float, FloatArray, FloatArray, tuple[int, int]]:
    """Return the arguments of `settle_rest`: of the old degrees, or the least that leave freedom."""
    free = 2 if search.ends.departure.shape[0] == 0 else 3
    sigma, tau = (
        max(own, min(free, int(highest))) for own, highest in zip(old.degrees, search.degrees, strict=True)
    )
    return (
        search.constraints,
        search.ends,
        *old.powers,
        w,
        quaternion_of(pose),
        np.array(pose.translation),
        (sigma, tau),
    )


def _place(w: float) -> float:
    place = finite_number("w", w, minimum=0.0)
    if not place < 1.0:
        raise InputError(f"w: {place:g} given; legal: 0 ≤ w < 1")
    return place


def _pose(path: CameraPath, w: float, given: RigidTransform | None) -> RigidTransform:
    if given is None:
        return path(w)
    bounded_array("pose.translation", single_pose("pose", given).translation, (3,))
    return given


def _velocity(
    path: CameraPath, w: float, problem: PlanningProblem, given: npt.ArrayLike | None
) -> FloatArray | None:
    if given is not None:
        return bounded_array("velocity", given, (6,))
    return problem.initial_velocity if w == 0.0 else path(w, 1)
