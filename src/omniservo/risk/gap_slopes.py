"""How an error of the camera's mount, and one of the camera's own way, change the gaps of the whole arm.

Obstacles are stated in the initial camera's frame, and the servo keeps the camera on its path there. So an
error ξ of the mount, flange_T_camera · exp(ξ), moves the obstacles in the base frame, and makes the arm carry
the camera with other joints than planned. A camera that the servo leads beside its path by a twist δ takes
the arm with it, and leaves the obstacles where they are.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.geometry.adjoint import adjoint
from omniservo.geometry.arrays import FloatArray
from omniservo.robots import ArmBodies
from omniservo.whole_arm.arm_setting import ArmSetting

NEAR = 0.1
"""[m] beyond what is required: pairs that are farther apart are not checked"""


class GapSlopes(NamedTuple):
    """The pairs of the arm and what stands around that are close in one configuration."""

    left: FloatArray
    """(k,) gap beyond what is required [m]"""
    by_mount: FloatArray
    """(k, 6) ∂gap/∂ξ, ξ in the camera's frame (linear [m], angular [rad])"""
    by_move: FloatArray
    """(k, 6) ∂gap/∂δ, likewise"""


def gap_slopes(
    setting: ArmSetting, bodies: ArmBodies, initial_T_camera: RigidTransform, q: FloatArray
) -> GapSlopes:
    """Return the slopes of all gaps that are close.

    With ξ the camera stays on its path P in its initial frame, so that the flange moves with the twist
    Ad(P⁻¹) ξ − ξ, seen in the camera's frame; an obstacle's point x, in the initial frame, by ξ_t + ξ_r × x.
    With δ the joints move by J⁺δ.
    """
    to_joints = np.linalg.pinv(setting.arm.camera_jacobian(q, setting.flange_T_camera))
    with_mount = to_joints @ (adjoint(initial_T_camera.inv()) - np.eye(6))
    bodies.place(q)
    asked = bodies.asked(setting.clearance_around, setting.self_clearance)
    base_R_initial = setting.base_T_initial.as_matrix()[..., :3, :3]
    fixed = {s.name for s in setting.surroundings}
    left, by_mount, by_move = [], [np.zeros((0, 6))], [np.zeros((0, 6))]
    for near in bodies.near(float(asked.max(initial=0.0)) + NEAR):
        if not bodies.is_around(near.pair):
            continue
        x = setting.base_T_initial.inv().apply(near.place)
        direction = base_R_initial.T @ near.direction
        moved = np.concatenate([direction, np.cross(x, direction)])
        if bodies.names(near.pair)[1] in fixed:
            moved *= 0.0  # known in the base frame, whatever the camera's mount
        left.append(near.gap - float(asked[near.pair]))
        by_mount.append((near.slope @ with_mount - moved)[None])
        by_move.append((near.slope @ to_joints)[None])
    return GapSlopes(np.array(left), np.concatenate(by_mount), np.concatenate(by_move))
