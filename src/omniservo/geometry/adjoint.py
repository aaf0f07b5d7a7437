"""Twists seen from another frame of the same body."""

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.geometry.arrays import FloatArray


def adjoint(a_T_b: RigidTransform) -> FloatArray:
    """Return Ad (6, 6): a twist (linear, angular) of frame b in frame a."""
    rotation = a_T_b.as_matrix()[..., :3, :3]
    x, y, z = a_T_b.translation
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.block([[rotation, cross @ rotation], [np.zeros((3, 3)), rotation]])
