"""What an uncertain camera mount may take from the gaps between the arm and what stands around.

Obstacles are stated in the initial camera's frame, and the servo keeps the camera on its path there. So an
error ξ of the mount, flange_T_camera · exp(ξ), moves the obstacles in the base frame, and makes the arm carry
the camera with other joints than planned.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import RigidTransform
from scipy.stats import chi2

from omniservo.geometry.arrays import FloatArray, finite_array, finite_number
from omniservo.planning.camera_path import CameraPath
from omniservo.planning.planning_problem import PlanningProblem
from omniservo.planning.with_arm.arm_plan import ArmPlan
from omniservo.planning.with_arm.arm_setting import ArmSetting
from omniservo.planning.with_arm.plan_with_arm import plan_with_arm
from omniservo.robots import ArmBodies, JointPath

ROUNDS = 4
"""of planning with more clearance"""

_PLACES = 33
_NEAR = 0.1
"""[m] beyond what is asked: pairs that are farther apart are not looked at"""


def plan_with_mount(
    problem: PlanningProblem, setting: ArmSetting, covariance: FloatArray, risk: float, *, seed: int = 0
) -> tuple[ArmPlan, float]:
    """Return a plan whose gaps keep what is asked for all mounts but a share ``risk``, and what that took.

    Clearance [m] is added until it covers `mount_margin` of the path that is found with it.

    Args:
        problem: see `plan_with_arm`.
        setting: with the mount as calibrated, and a clearance.
        covariance: (6, 6) of flange_T_camera: translation in the flange's frame [m], rotation vector on the
            right [rad], as a hand-eye calibration states it.
        risk: 0 < risk < 1.
        seed: see `plan_with_arm`.

    Raises:
        InputError: see `plan_with_arm`; a covariance or a risk that is not legal.
    """
    finite_array("covariance", covariance, (6, 6))
    finite_number("risk", risk, above=0.0, maximum=1.0)
    asked, added = setting.clearance_around, 0.0
    for _ in range(ROUNDS):
        wider = replace(setting, clearance=asked + added)
        found = plan_with_arm(problem, wider, seed=seed)
        if not found.certified or found.branch is None or found.plan.path is None:
            return found, added
        bodies = wider.bodies(problem.obstacles)
        needed = mount_margin(wider, bodies, found.plan.path, found.branch, covariance, risk)
        if needed <= added:
            return found, added
        added = 1.05 * needed  # the next path is another one
    reason = (
        f"no path was found that an uncertain camera mount leaves clear: {1e3 * needed:.2f} mm are needed"
    )
    return replace(found, plan=replace(found.plan, status="not_found", reason=reason)), added


def mount_margin(
    setting: ArmSetting,
    bodies: ArmBodies,
    path: CameraPath,
    branch: JointPath,
    covariance: FloatArray,
    risk: float,
) -> float:
    """Return the most that the mount's error takes from any gap [m], but for a share ``risk`` of errors.

    To first order, of all gaps at once: √(χ²₆(risk) gᵀΣg) with g = ∂gap/∂ξ, largest over pairs that are close
    and 33 places of the path.
    """
    to_camera = np.eye(6)
    to_camera[:3, :3] = setting.flange_T_camera.rotation.as_matrix().T
    spread = to_camera @ covariance @ to_camera.T
    largest = 0.0
    for w in np.linspace(0.0, 1.0, _PLACES):
        slopes = gap_slopes(setting, bodies, path(float(w)), branch(float(w)))
        largest = max(largest, float(np.einsum("ki,ij,kj->k", slopes, spread, slopes).max(initial=0.0)))
    return math.sqrt(float(chi2.isf(risk, 6)) * largest)


def gap_slopes(
    setting: ArmSetting, bodies: ArmBodies, initial_T_camera: RigidTransform, q: FloatArray
) -> FloatArray:
    """Return ∂gap/∂ξ (k, 6) of the close pairs of the arm and what stands around, ξ in the camera's frame.

    The camera stays on its path P in its initial frame, so that the flange moves with the twist
    Ad(P⁻¹) ξ − ξ, seen in the camera's frame; an obstacle's point x, in the initial frame, by ξ_t + ξ_r × x.
    """
    flange = setting.arm.camera_jacobian(q, setting.flange_T_camera)
    joints = np.linalg.pinv(flange) @ (_adjoint(initial_T_camera.inv()) - np.eye(6))
    bodies.place(q)
    rows = [np.zeros((0, 6))]
    base_R_initial, fixed = (
        setting.base_T_initial.rotation.as_matrix(),
        {s.name for s in setting.surroundings},
    )
    for near in bodies.near(setting.clearance_around + _NEAR):
        if bodies.is_around(near.pair):
            x = setting.base_T_initial.inv().apply(near.place)
            direction = base_R_initial.T @ near.direction
            moved = np.concatenate([direction, np.cross(x, direction)])
            stands = (
                bodies.names(near.pair)[1] in fixed
            )  # known in the base frame, whatever the camera's mount
            rows.append((near.slope @ joints - (0.0 if stands else moved))[None])
    slopes: FloatArray = np.concatenate(rows)
    return slopes


def _adjoint(a_T_b: RigidTransform) -> FloatArray:
    """Return Ad (6, 6): a twist (linear, angular) of frame b in frame a."""
    rotation = a_T_b.rotation.as_matrix()
    x, y, z = a_T_b.translation
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.block([[rotation, cross @ rotation], [np.zeros((3, 3)), rotation]])
