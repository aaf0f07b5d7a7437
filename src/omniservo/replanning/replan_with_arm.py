"""A new plan on the way for camera and arm."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import chain

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray, finite_number
from omniservo.geometry.quick_poses import composed, inverse
from omniservo.planning.camera_path import CameraPath
from omniservo.planning.constraints.body_gap import REACH
from omniservo.planning.constraints.constraints import CLOUD_REACH, SPHERE_REACH, Constraints
from omniservo.planning.end_poses import violation_at_end
from omniservo.planning.judged_plan import infeasible_plan
from omniservo.planning.obstacles.half_space import HalfSpace
from omniservo.planning.plan import Plan
from omniservo.planning.planning_problem import PlanningProblem
from omniservo.planning.search.problem_search import ProblemSearch
from omniservo.planning.time_budget import TimeBudget
from omniservo.replanning.replan import path_near_rest, rest_of_plan
from omniservo.robots import Arm, ArmBodies, JointPath
from omniservo.robots.path_following.step_kernels import settle
from omniservo.whole_arm.arm_ends import violation_at_goal, violation_at_start
from omniservo.whole_arm.arm_plan import ArmPlan
from omniservo.whole_arm.arm_planner import NEAR, ArmPlanner
from omniservo.whole_arm.arm_setting import ArmSetting

ROOMS = (0.015, 0.03, 0.05, 0.08)
"""[m] more than is required from camera centre to obstacles: so bent a path is found in a fraction of the
time that moving it for the arm takes"""

_BETWEEN = 1e-2
"""[m] over `LENGTH_SCALE`, [rad] farther from the camera's pose than rounding and quintics leave joints"""


def replan_with_arm(
    plan: Plan,
    joints: JointPath,
    w: float,
    problem: PlanningProblem,
    setting: ArmSetting,
    *,
    pose: RigidTransform | None = None,
    bodies: ArmBodies | None = None,
    time_budget: float | None = None,
    seed: int = 0,
) -> ArmPlan:
    """Return a plan for the rest of the way that the arm can follow from where it is; see `replan`.

    Tried first is the proven camera path nearest to the rest of the old one, then some with more room: those
    that the arm is seen to follow at a few places, led there from the old joints, are followed. If that does
    not do, the first is moved until the arm can follow it, from these joints on; after it come other starts,
    as by `plan_with_arm`. The plan stands in the present camera frame; joints go on from where they are, with
    their present speeds.

    Args:
        plan: the plan that is followed; any that has a path.
        joints: that follow it, over the same w.
        w: where on it the camera is, 0 ≤ w < 1.
        problem: what is known now, in the frame of the plan's path.
        setting: the arm, with that frame as its initial one.
        pose: the camera's there, in that frame, where it is known; None: it is looked up.
        bodies: the setting's among the problem's obstacles, where they are known; None: made here.
        time_budget: [s], checked between starts and descents; None: without end.
        seed: as for `plan_with_arm`.

    Raises:
        InputError: as `replan`; or an obstacle that cannot be judged for the whole arm.
    """
    budget = TimeBudget(time_budget)
    finite_number("seed", seed, minimum=0)
    old, pose, rest = rest_of_plan(plan, w, problem, pose)
    here = _standing(setting, composed(setting.base_T_initial, pose), joints(w))
    if isinstance(here, str):
        return _nothing(rest, budget, here)
    bodies = here.bodies(rest.obstacles) if bodies is None else bodies
    aims = [None if plan.aim is None else joints.positions[-1]]  # self-motion goes on to where it was led
    velocity = (1.0 - w) * joints(w, 1) if setting.arm.dof > 6 else None
    planner = ArmPlanner(rest, here, bodies, int(seed), budget, aims=aims, velocity=velocity)
    near = path_near_rest(planner.search, old, w, pose)
    if near is not None:
        found, is_hopeless = _near_old(planner, near, old, joints, w, pose)
        if found is not None:
            return found
        near = None if is_hopeless else near
    # What is proven is so at its ends, too: they are looked at where nothing was found.
    reason = violation_at_end(rest) or violation_at_start(rest, here, bodies)
    if reason:
        return _nothing(rest, budget, reason)
    if here.arm.has_closed_form and (near is None or not planner.stands_at_end(near)):
        reason = violation_at_goal(rest, here, bodies)
        if reason:
            return _nothing(rest, budget, reason)
    return planner.plan(near)


def _near_old(
    planner: ArmPlanner, near: CameraPath, old: CameraPath, joints: JointPath, w: float, pose: RigidTransform
) -> tuple[ArmPlan | None, bool]:
    """Return a plan near the old one, None if there is none; and whether moving ``near`` has failed.

    ``near`` is the proven camera path nearest to the rest of the old one. It is moved from joints led onto
    it, or where they cannot be led there, the old way itself is, from the old joints.
    """
    planes = sum(isinstance(obstacle, HalfSpace) for obstacle in planner.problem.obstacles)
    old_joints = joints(w + (1.0 - w) * np.linspace(0.0, 1.0, NEAR))
    candidates = chain([near], _with_room(planner.search, planes, old, w, pose))
    found = planner.as_they_are(candidates, old_joints)
    if found is not None or not planner.rules_out(near, old_joints):
        return found, False
    led = planner.led_onto(near, old_joints)
    if led is not None:
        return planner.moved_from(near, led), True
    return planner.moved_from(old.part(w, 1.0).seen_in(pose.inv()), old_joints), False


def _nothing(rest: PlanningProblem, budget: TimeBudget, reason: str) -> ArmPlan:
    plan = infeasible_plan(rest, budget.begin, "certified", reason)
    return ArmPlan(plan, None, None, None, plan.seconds, 0)


def _with_room(
    search: ProblemSearch, planes: int, old: CameraPath, w: float, pose: RigidTransform
) -> Iterator[CameraPath]:
    """Yield camera paths near the old one that leave the bodies behind the camera more and more room.

    ``planes``: so many of the half-spaces in the search are obstacles.
    """
    for room in ROOMS:
        farther = replace(search, constraints=with_room(search.constraints, planes, room))
        path = path_near_rest(farther, old, w, pose)
        if path is None:
            return
        yield path


def with_room(constraints: Constraints, planes: int, room: float) -> Constraints:
    """Return constraints that ask for so much more clearance [m] to every obstacle.

    ``planes``: so many of the half-spaces, the first ones, are obstacles.
    """
    obstacles, bodies, clouds, sides = (
        rows.copy()
        for rows in (constraints.obstacles, constraints.bodies, constraints.clouds, constraints.planes)
    )
    obstacles[:, SPHERE_REACH] += room
    bodies[:, REACH] += room
    clouds[:, CLOUD_REACH] += room
    sides[:planes, 3:5] += room
    return constraints._replace(obstacles=obstacles, bodies=bodies, clouds=clouds, planes=sides)


def _standing(setting: ArmSetting, base_T_here: RigidTransform, q: FloatArray) -> ArmSetting | str:
    """Return the arm on its way, or why it cannot begin there: by a way that kept less of its ranges."""
    start = _on_pose(setting.arm, q, base_T_here.as_matrix() @ inverse(setting.flange_T_camera))
    try:
        return replace(setting, base_T_initial=base_T_here, start=start)
    except InputError as error:
        return str(error)


def _on_pose(arm: Arm, q: FloatArray, base_T_flange: FloatArray) -> FloatArray:
    """Return the joints next to ``q`` that put the flange on a pose (4, 4)."""
    stand, goal = np.array(q), np.ascontiguousarray(base_T_flange)
    twist, _ = arm.miss(stand, goal)
    near = float(np.abs(twist).max()) < _BETWEEN
    if not near or not settle(arm.chain, goal, stand, np.empty((6, arm.dof))):
        raise InputError("joints: they do not put the camera where the plan's path has it at w")
    return stand
