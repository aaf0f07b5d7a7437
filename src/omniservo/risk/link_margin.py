"""Gaps of the whole arm that are wide enough for an uncertain mount and an uncertain estimate, jointly."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray, finite_array, finite_number
from omniservo.geometry.covariances import is_covariance
from omniservo.planning.camera_path import CameraPath
from omniservo.planning.planning_problem import PlanningProblem
from omniservo.risk.executions import Executions
from omniservo.risk.gap_slopes import gap_slopes
from omniservo.risk.risk_plan import LinkMargin
from omniservo.risk.safe_path import EACH, Draw, allowed_violations
from omniservo.risk.sample_blocks import resting_twists
from omniservo.risk.servo_response import servo_response
from omniservo.robots import ArmBodies, JointPath
from omniservo.whole_arm.arm_plan import ArmPlan
from omniservo.whole_arm.arm_setting import ArmSetting
from omniservo.whole_arm.plan_with_arm import plan_with_arm

ROUNDS = 4
"""of planning with more clearance"""

AHEAD = 1.05
"""Clearance is widened by this part of what was missing: the next path is another one."""

RARE = 10
"""At least so many samples are drawn for one expected violation,"""

LEAST_SAMPLES = 1000
"""and so many in all."""

_PLACES = 33


class Taken(NamedTuple):
    """What K samples do to the gaps along a path."""

    left: FloatArray
    """(K,) the least that any close gap keeps beyond what is required; ∞ where none is close [m]"""
    mount: FloatArray
    """(K,) the most that the mount takes of any [m]"""
    estimate: FloatArray
    """(K,) the most that the estimate takes of any [m]"""


def plan_links_at_risk(
    problem: PlanningProblem,
    setting: ArmSetting,
    risk: float,
    *,
    mount_covariance: FloatArray | None = None,
    draw: Draw | None = None,
    seed: int = 0,
    begin: float = 0.0,
) -> tuple[ArmPlan, LinkMargin]:
    """Return a plan whose gaps keep what is required but for a share ``risk`` of mounts and estimates.

    To first order, in samples of both together, at 33 places of the path (`gap_slopes`). Where more than the
    share misses anything (95% upper bound), clearance is added, and it is planned again.

    Args:
        problem: see `plan_with_arm`.
        setting: with the mount as calibrated, and a clearance.
        risk: 0 < risk < 1.
        mount_covariance: (6, 6) of flange_T_camera: translation in the flange's frame [m], rotation vector on
            the right [rad], as a hand-eye calibration states it; None: exact.
        draw: gives what points and camera may truly be; None: as the problem has them.
        seed: see `plan_with_arm`; of the mounts, too.
        begin: clearance that is added at first [m]; where nothing is found with it, none is.

    Raises:
        InputError: see `plan_with_arm`; a covariance or a risk that is not legal, too few samples for it.
    """
    finite_number("risk", risk, above=0.0, maximum=1.0)
    seed = int(finite_number("seed", seed, minimum=0))
    if mount_covariance is not None:
        mount_covariance = finite_array("mount_covariance", mount_covariance, (6, 6))
        if not is_covariance(mount_covariance):
            raise InputError("mount_covariance: a symmetric matrix without negative eigenvalues is needed")
    asked, added = setting.clearance_around, begin
    for _ in range(ROUNDS):
        found = plan_with_arm(problem, replace(setting, clearance=asked + added), seed=seed)
        if added and added == begin and not found.certified:
            added = 0.0
            continue
        if not found.certified or found.branch is None:
            return _without(found, added), LinkMargin(risk, 1.0, 0.0, 0.0, added)
        executions = None if draw is None else draw()
        margin, needed = judged_links(found, setting, risk, mount_covariance, executions, seed)
        margin = replace(margin, added=added)
        if needed <= 0.0:
            return found, margin
        added += AHEAD * needed
    reason = missing_for_links(needed, margin.added)
    return replace(found, plan=replace(found.plan, status="not_found", reason=reason)), margin


def missing_for_links(needed: float, added: float) -> str:
    """Say by how much too narrow the gaps of the best attempt are [m]."""
    return (
        "no path was found that an uncertain camera mount and estimate leave clear for the arm: "
        f"{1e3 * needed:.2f} mm are missing, {1e3 * added:.2f} mm having been added"
    )


def judged_links(
    found: ArmPlan,
    setting: ArmSetting,
    risk: float,
    mount_covariance: FloatArray | None,
    executions: Executions | None,
    seed: int,
) -> tuple[LinkMargin, float]:
    """Return what mounts and executions do to the gaps of a certified plan, and what is missing [m].

    Not above 0: the share that misses anything is within the risk (95% upper bound).

    Raises:
        InputError: too few executions for the risk.
    """
    count = max(LEAST_SAMPLES, math.ceil(RARE / risk)) if executions is None else len(executions.points)
    repeats = 1.0 if executions is None else executions.repeats
    most = allowed_violations(risk, count, repeats)
    if most < 0:
        least = math.ceil(repeats * math.log(1.0 - EACH) / math.log1p(-risk))
        raise InputError(f"executions: {count} given; a risk of {risk:g} needs at least {least} of them")
    if found.branch is None or found.plan.path is None:
        return LinkMargin(risk, 1.0, 0.0, 0.0, 0.0), math.inf
    mounts = _mounts(setting, mount_covariance, count, seed)
    bodies = setting.bodies(found.plan.problem.obstacles)
    taken = taken_by(setting, bodies, found.plan.path, found.branch, mounts, executions)
    mount, estimate = (float(np.quantile(part, 1.0 - risk)) for part in (taken.mount, taken.estimate))
    violated = float((taken.left < 0.0).mean())
    return LinkMargin(risk, violated, mount, estimate, 0.0), -float(np.sort(taken.left)[most])


def _without(found: ArmPlan, added: float) -> ArmPlan:
    if not added:
        return found
    reason = (
        f"{found.plan.reason} (with {1e3 * added:.2f} mm added for an uncertain camera mount and estimate)"
    )
    return replace(found, plan=replace(found.plan, reason=reason))


def taken_by(
    setting: ArmSetting,
    bodies: ArmBodies,
    path: CameraPath,
    branch: JointPath,
    mounts: FloatArray,
    executions: Executions | None,
) -> Taken:
    """Return what errors of the mount (K, 6), in the camera's frame, and K executions do to the gaps."""
    count = len(mounts)
    found = Taken(np.full(count, math.inf), np.zeros(count), np.zeros(count))
    places = np.linspace(0.0, 1.0, _PLACES)
    joints = branch(places)
    at = [gap_slopes(setting, bodies, path(float(w)), q) for w, q in zip(places, joints, strict=True)]
    close = [i for i, slopes in enumerate(at) if len(slopes.left)]
    moves = None if executions is None or not close else resting_moves(executions, path, places[close])
    for number, i in enumerate(close):
        by_mount = mounts @ at[i].by_mount.T
        by_estimate = np.zeros_like(by_mount) if moves is None else moves[number] @ at[i].by_move.T
        np.minimum(found.left, (at[i].left + by_mount + by_estimate).min(axis=1), out=found.left)
        np.maximum(found.mount, -by_mount.min(axis=1), out=found.mount)
        np.maximum(found.estimate, -by_estimate.min(axis=1), out=found.estimate)
    return found


def resting_moves(executions: Executions, path: CameraPath, places: FloatArray) -> FloatArray:
    """Return the twists (W, K, 6), in the camera's frame, by which the servo rests beside the path."""
    problem, camera = executions.problem, executions.camera
    response = servo_response(problem.camera, problem.points, path, places, camera.shape[1])
    moves = np.empty((len(places), len(camera), 6))
    resting_twists(response, executions.points, camera, moves)
    return moves


def _mounts(setting: ArmSetting, covariance: FloatArray | None, count: int, seed: int) -> FloatArray:
    """Return errors of the mount (count, 6) in the camera's frame."""
    if covariance is None:
        return np.zeros((count, 6))
    to_camera = np.eye(6)
    to_camera[:3, :3] = setting.flange_T_camera.as_matrix()[..., :3, :3].T
    values, vectors = np.linalg.eigh(to_camera @ covariance @ to_camera.T)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    errors: FloatArray = np.random.default_rng([20120611, seed]).standard_normal((count, 6)) @ root.T
    return errors
