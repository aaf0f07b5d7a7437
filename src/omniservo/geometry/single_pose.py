"""The check of every pose that a caller gives."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.errors import InputError, spelled
from omniservo.geometry.arrays import finite_array


def single_pose(name: str, value: object) -> RigidTransform:
    """Return a value that is one finite pose, or say what it is in its place; ``name`` stands first.

    Raises:
        InputError: a matrix or another thing, several poses, NaN or infinity.
    """
    if isinstance(value, RigidTransform) and value.single:
        finite_array(name, value.as_matrix(), (4, 4))
        return value
    if isinstance(value, RigidTransform):
        given = f"{len(value)} poses"
    else:
        given = f"an array {value.shape}" if isinstance(value, np.ndarray) else spelled(value)
    raise InputError(
        f"{name}: {given} given; one RigidTransform is needed, as RigidTransform.from_matrix makes"
    )
