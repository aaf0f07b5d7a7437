"""The straight line between two joint configurations, as a joint path."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import RigidTransform

from omniservo.geometry.arrays import finite_array, frozen
from omniservo.robots.arm import Arm
from omniservo.robots.path_following.joint_path import JointPath

_PLACES = 33


def joint_segment(
    arm: Arm, begin: npt.ArrayLike, end: npt.ArrayLike, flange_T_camera: RigidTransform
) -> JointPath:
    """Return q(w) = (1 − w) q₀ + w q₁; it needs no inverse kinematics, so singular places do not end it.

    Raises:
        InputError: wrong shape, NaN or infinity.
    """
    first, last = (finite_array(name, q, (arm.dof,)) for name, q in (("begin", begin), ("end", end)))
    w = np.linspace(0.0, 1.0, _PLACES)
    q = first + w[:, None] * (last - first)
    jacobians = np.array([arm.scaled_camera_jacobian(row, flange_T_camera) for row in q])
    return JointPath(
        w=frozen(w),
        positions=frozen(q),
        velocities=frozen(np.broadcast_to(last - first, q.shape).copy()),
        accelerations=frozen(np.zeros_like(q)),
        singular_values=frozen(np.linalg.svd(jacobians, compute_uv=False)[:, -1]),
        limit_margins=frozen(arm.limit_margins(q)),
        failures=(),
        travel=float((np.abs(last - first) / arm.joint_speed).max()),
    )
