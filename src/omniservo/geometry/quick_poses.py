"""Poses read and joined on the way, where SciPy's own checks take longer than all that is done with them."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.quaternions import quaternion_from_matrix


def composed(a_T_b: RigidTransform, b_T_c: RigidTransform) -> RigidTransform:
    """Return a_T_c of two single poses: to rounding a rotation, not made one again."""
    return RigidTransform(a_T_b.as_matrix() @ b_T_c.as_matrix(), normalize=False)


def inverse(a_T_b: RigidTransform) -> FloatArray:
    """Return b_T_a (4, 4) of a single pose."""
    matrix: FloatArray = np.linalg.inv(np.asarray(a_T_b.as_matrix(), dtype=np.float64))
    return matrix


def moved(a_T_b: RigidTransform, points: FloatArray) -> FloatArray:
    """Return points (3,) or (m, 3) of frame b in frame a [m]."""
    matrix = a_T_b.as_matrix()
    there: FloatArray = points @ matrix[:3, :3].T + matrix[:3, 3]
    return there


def quaternion_of(a_T_b: RigidTransform) -> FloatArray:
    """Return the unit quaternion (4,) of a single pose, (x, y, z, w) with w ≥ 0."""
    return quaternion_from_matrix(np.ascontiguousarray(a_T_b.as_matrix()[:3, :3]))
