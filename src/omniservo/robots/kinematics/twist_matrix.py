"""A twist seen from another point of the same body."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.geometry.arrays import FloatArray, frozen
from omniservo.geometry.single_pose import single_pose


def twist_matrix(flange_T_camera: RigidTransform, length: float = 1.0) -> FloatArray:
    """Return A (6, 6): camera twist = A · flange twist, each (linear, angular) in its own frame.

    With flange_T_camera = (R, t): v_c = Rᵀ(v_f + ω_f × t), ω_c = Rᵀ ω_f. Linear parts of both are in units of
    ``length`` [m]. Read-only.

    Raises:
        InputError: what is given is not one RigidTransform.
    """
    if not isinstance(flange_T_camera, RigidTransform):  # an array cannot be looked up
        single_pose("flange_T_camera", flange_T_camera)
    return _matrix(flange_T_camera, length)


@lru_cache(maxsize=16)  # of one and the same object: reading a RigidTransform takes longer than all the rest
def _matrix(flange_T_camera: RigidTransform, length: float) -> FloatArray:
    single_pose("flange_T_camera", flange_T_camera)
    camera_R_flange = flange_T_camera.rotation.as_matrix().T
    x, y, z = flange_T_camera.translation / length
    cross = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])  # ω × t = cross @ ω
    A = np.zeros((6, 6))
    A[:3, :3] = A[3:, 3:] = camera_R_flange
    A[:3, 3:] = camera_R_flange @ cross
    return frozen(A)
