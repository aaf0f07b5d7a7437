"""Robot poses as a caller gives them, checked."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray, finite_array

MOST_POSES = 2000
ROUNDED = 1e-3
"""how far robots' printed rotations may be from one; they are normalised"""


def checked_poses(base_T_flange: RigidTransform | Sequence[RigidTransform] | npt.ArrayLike) -> RigidTransform:
    """Return n poses as one RigidTransform.

    Raises:
        InputError: not poses, more than `MOST_POSES`, a matrix whose upper left is no rotation.
    """
    if isinstance(base_T_flange, RigidTransform):
        matrices = np.atleast_3d(base_T_flange.as_matrix()).reshape(-1, 4, 4)
    elif isinstance(base_T_flange, list | tuple) and all(
        isinstance(pose, RigidTransform) for pose in base_T_flange
    ):
        matrices = np.array([pose.as_matrix() for pose in base_T_flange]).reshape(-1, 4, 4)
    else:
        matrices = finite_array("base_T_flange", cast("npt.ArrayLike", base_T_flange), (None, 4, 4))
    if not 1 <= len(matrices) <= MOST_POSES:
        raise InputError(f"base_T_flange: {len(matrices)} poses given; legal: 1 to {MOST_POSES}")
    finite_array("base_T_flange", matrices, (None, 4, 4))
    return RigidTransform.concatenate(
        [pose_from_matrix(f"base_T_flange[{i}]", m) for i, m in enumerate(matrices)]
    )


def pose_from_matrix(name: str, matrix: FloatArray) -> RigidTransform:
    """Return the pose of a finite matrix (4, 4).

    Raises:
        InputError: its last row is not 0 0 0 1, or its upper left is no rotation within `ROUNDED`.
    """
    if np.abs(matrix[3] - [0.0, 0.0, 0.0, 1.0]).max() > 1e-9:
        raise InputError(f"{name}: last row {matrix[3].tolist()} given; legal: 0 0 0 1")
    R = matrix[:3, :3]
    off = float(np.abs(R @ R.T - np.eye(3)).max())
    if off > ROUNDED or np.linalg.det(R) < 0.0:
        what = f"R Rᵀ is off the identity by {off:.3g}" if off > ROUNDED else "a reflection"
        raise InputError(f"{name}: {what}; legal: a rotation, within {ROUNDED:g}")
    return RigidTransform.from_components(matrix[:3, 3], Rotation.from_matrix(R))
