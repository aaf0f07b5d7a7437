"""A rotation onto a direction."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from omniservo.geometry.arrays import FloatArray


def along(direction: FloatArray) -> Rotation:
    """Return a rotation that takes z to a direction (3,) of any length, but for a few roundings everywhere.

    The identity where it has no length. The other two axes are any across (Duff et al. 2017).
    """
    length = float(np.linalg.norm(direction))
    if length == 0.0:
        return Rotation.identity()
    x, y, z = (np.asarray(direction) / length).tolist()
    side = math.copysign(1.0, z)
    a = -1.0 / (side + z)
    b = x * y * a
    first, second = (1.0 + side * x * x * a, side * b, -side * x), (b, side + y * y * a, -y)
    return Rotation.from_matrix(np.column_stack([first, second, (x, y, z)]))
