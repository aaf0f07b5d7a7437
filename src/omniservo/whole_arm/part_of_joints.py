"""A part of a joint path as a joint path of its own."""

from __future__ import annotations

import numpy as np

from omniservo.geometry.arrays import frozen
from omniservo.robots import JointPath
from omniservo.whole_arm.arm_setting import ArmSetting


def part_of_joints(setting: ArmSetting, joints: JointPath, begin: float, end: float) -> JointPath:
    """Return the joints between two places, 0 ≤ begin < end ≤ 1, over a parameter from 0 to 1.

    Args:
        setting: the arm, and how it holds the camera.
        joints: a branch that does not fail.
        begin: where the part begins.
        end: where it ends.
    """
    arm, length = setting.arm, end - begin
    inside = joints.w[(joints.w > begin) & (joints.w < end)]
    w = np.concatenate([[begin], inside, [end]])
    q = joints(w)
    ends = np.linalg.svd(
        np.array([arm.scaled_camera_jacobian(q[i], setting.flange_T_camera) for i in (0, -1)]),
        compute_uv=False,
    )[:, -1]
    between = joints.singular_values[(joints.w > begin) & (joints.w < end)]
    return JointPath(
        w=frozen((w - begin) / length),
        positions=frozen(q),
        velocities=frozen(length * joints(w, 1)),
        accelerations=frozen(length**2 * joints(w, 2)),
        singular_values=frozen(np.concatenate([ends[:1], between, ends[1:]])),
        limit_margins=frozen(arm.limit_margins(q)),
        failures=(),
        travel=float((np.abs(np.diff(q, axis=0)).sum(axis=0) / arm.joint_speed).max()),
    )
