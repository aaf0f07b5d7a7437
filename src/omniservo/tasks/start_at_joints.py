"""A start that is stated as the arm's joints: where that puts the camera."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.errors import InputError
from omniservo.robots import load_arm
from omniservo.tasks.quantities import Angle
from omniservo.tasks.section import Section
from omniservo.tasks.task import ArmMount, Pose, StartSection


class StartJoints(Section):
    """The joints at the beginning, from the base outwards."""

    joints: tuple[Angle, ...]
    """one number a joint [rad]"""


class ArmAtStart(Section):
    """What of a task's file says where the camera is at the beginning."""

    arm: ArmMount
    start: StartJoints


def start_at_joints(fields: dict[str, Any], context: dict[str, float], source: str) -> StartSection:
    """Return the start of a task's file that has ``start.joints``.

    Args:
        fields: the file's ``arm`` and ``start``.
        context: the file's units.
        source: stands first in messages.

    Raises:
        InputError: no such arm, another number of joints, or joints out of their range.
        ValidationError: a wrong field.
    """
    stated = ArmAtStart.model_validate({name: fields[name] for name in ("arm", "start")}, context=context)
    mount, joints = stated.arm, np.array(stated.start.joints)
    arm = load_arm(mount.model, flange=mount.flange, packages=mount.packages)
    if len(joints) != arm.dof:
        raise InputError(
            f"{source}: start.joints: {len(joints)} numbers given; {arm.name} has {arm.dof} joints: "
            f"{', '.join(arm.joint_names)}"
        )
    margins = arm.limit_margins(joints)
    if margins.min() < 0.0:
        worst = int(margins.argmin())
        low, high = np.rad2deg(arm.joint_range[worst])
        degrees = arm.limit_margins(np.deg2rad(joints)).min() >= 0.0
        hint = "; if they are in degrees, state units: {angle: deg}" if degrees else ""
        raise InputError(
            f"{source}: start.joints: {arm.joint_names[worst]} at {np.rad2deg(joints[worst]):.1f} deg; "
            f"legal: {low:.1f} … {high:.1f} deg{hint}"
        )
    world_T_base = RigidTransform.from_translation(np.asarray(mount.foot))
    world_T_camera = world_T_base * arm.base_T_flange(joints) * mount.flange_T_camera.transform
    pose = Pose(
        translation=tuple(world_T_camera.translation.tolist()),
        quaternion=tuple(world_T_camera.rotation.as_quat().tolist()),
    )
    return StartSection(world_T_camera=pose, joints_near=stated.start.joints)
