"""Camera paths that curves in joint space suggest, where none that the camera finds by itself will do.

From where the arm stands to configurations that are free at the goal: straight in the joints, then bent. The
camera may turn the long way round on them, which detours of a straight camera path never do.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.interpolate import BPoly
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.polynomial import power_from_bernstein
from omniservo.geometry.quick_poses import inverse
from omniservo.planning.camera_path import CameraPath
from omniservo.planning.planning_problem import PlanningProblem
from omniservo.whole_arm.arm_setting import ArmSetting

BENT = 7
"""Curves to each configuration beside the straight one"""

_BEND = 0.3
"""[rad] how far a joint is bent aside half way, one standard deviation"""


class JointCurve(NamedTuple):
    """A curve, and the camera path of the problem's degrees that is near it."""

    joints: FloatArray
    """(m, n) at even places of w, ends included [rad]"""
    path: CameraPath


def joint_curves(
    problem: PlanningProblem,
    setting: ArmSetting,
    start: FloatArray,
    ends: FloatArray,
    count: int,
    seed: int,
) -> Iterator[JointCurve]:
    """Yield q(w) = (1 − w) q₀ + w q₁ + 4 w (1 − w) b at ``count`` places, b = 0 first, then random.

    Args:
        problem: whose degrees the paths have.
        setting: the arm.
        start: (n,) q₀ [rad].
        ends: (k, n) configurations q₁ at the goal, those first that are to be tried first [rad].
        count: of places.
        seed: of the bends.
    """
    random, w = np.random.default_rng([seed, 5]), np.linspace(0.0, 1.0, count)[:, None]
    for bent in range(1 + BENT):
        for end in ends:
            bend = _BEND * random.standard_normal(len(end)) if bent else 0.0
            joints = (1.0 - w) * start + w * end + 4.0 * w * (1.0 - w) * bend
            yield JointCurve(joints, path_near(problem, setting, joints))


def path_near(problem: PlanningProblem, setting: ArmSetting, joints: FloatArray) -> CameraPath:
    """Return the path from the identity to the goal that misses the joints least, φ and t by themselves."""
    poses = camera_poses(setting, joints)
    phi, t = _steady(poses.rotation), np.array(poses.translation)
    phi[0], t[0] = [0.0, 0.0, 0.0, 1.0], 0.0
    phi[-1] = np.copysign(1.0, phi[-1] @ problem.goal_quaternion) * problem.goal_quaternion
    t[-1] = problem.goal_translation
    degrees = problem.degrees
    return CameraPath(_fitted(phi, degrees.rotation), _fitted(t, degrees.translation))


def camera_poses(setting: ArmSetting, joints: FloatArray) -> RigidTransform:
    """Return initial_T_camera (m,) at joints (m, n) [rad]."""
    base_T_flange = np.tile(np.eye(4), (len(joints), 1, 1))
    base_T_flange[:, :3] = [setting.arm.locate(q)[0] for q in joints]
    initial_T_base, flange_T_camera = inverse(setting.base_T_initial), setting.flange_T_camera.as_matrix()
    return RigidTransform(initial_T_base @ base_T_flange @ flange_T_camera, normalize=False)


def _steady(rotations: Rotation) -> FloatArray:
    """Return quaternions (m, 4), each of the sign that is near the one before, the first with w ≥ 0."""
    phi: FloatArray = rotations.as_quat(canonical=True)
    same = np.sum(phi[1:] * phi[:-1], axis=1) >= 0.0
    phi[1:] *= np.cumprod(np.where(same, 1.0, -1.0))[:, None]
    return phi


def _fitted(values: FloatArray, degree: int) -> FloatArray:
    """Return the polynomials (r, degree+1) nearest to values (m, r) and exact at both ends, by powers."""
    w = np.linspace(0.0, 1.0, len(values))
    basis = BPoly(np.eye(degree + 1)[:, None], [0.0, 1.0])(w)
    controls = np.empty((degree + 1, values.shape[1]))
    controls[[0, -1]] = values[[0, -1]]
    inside = values - basis[:, [0, -1]] @ controls[[0, -1]]
    controls[1:-1] = np.linalg.lstsq(basis[:, 1:-1], inside)[0]
    powers: FloatArray = power_from_bernstein(np.ascontiguousarray(controls.T))
    return powers
