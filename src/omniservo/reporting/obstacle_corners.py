"""Bodies of obstacles as drawings need them."""

from __future__ import annotations

from itertools import product

import numpy as np
from scipy.spatial.transform import Rotation

from omniservo.geometry.arrays import FloatArray
from omniservo.planning import Box, Capsule, Mesh, Sphere


def obstacle_corners(obstacle: Sphere | Box | Capsule | Mesh) -> tuple[FloatArray, float]:
    """Return points (k, 3) whose hull, wider by a radius, is the body [m]."""
    if isinstance(obstacle, Sphere):
        return obstacle.center[None], obstacle.radius
    if isinstance(obstacle, Capsule):
        return np.stack([obstacle.start, obstacle.end]), obstacle.radius
    if isinstance(obstacle, Mesh):
        return obstacle.vertices, 0.0
    half = obstacle.half_extents * (np.array(list(product((-1.0, 1.0), repeat=3))))
    return obstacle.center + Rotation.from_quat(obstacle.quaternion).apply(half), 0.0
