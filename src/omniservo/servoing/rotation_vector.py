"""How a rotation vector moves with the camera's angular velocity."""

from __future__ import annotations

import math

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.quaternions import quaternion_from_matrix

_IDENTITY = np.eye(3)


def cross_matrix(vector: FloatArray) -> FloatArray:
    """Return [v]× (3, 3): [v]× x = v × x."""
    x, y, z = vector.tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def rotation_vector(rotation: FloatArray) -> FloatArray:
    """Return θu (3,) of a rotation matrix (3, 3), 0 ≤ θ ≤ π."""
    x, y, z, w = quaternion_from_matrix(np.ascontiguousarray(rotation)).tolist()
    sine = math.sqrt(x * x + y * y + z * z)
    factor = 2.0 * math.atan2(sine, w) / sine if sine > 0.0 else 2.0
    return np.array([factor * x, factor * y, factor * z])


def rotation_vector_interaction(rotation_vector: FloatArray) -> FloatArray:
    """Return J (3, 3) with d(θu)/dt = J ω for R = exp([θu]×) = goal_R_camera and the camera's ω in its frame.

    J = I + ½[θu]× + (1 − (θ/2) cot(θ/2)) [u]×²; so J⁻¹ θu = θu. Malis, Chaumette and Boudet, *2½-D visual
    servoing* (1999), L_ω there, for the inverse rotation.
    """
    angle = math.sqrt(rotation_vector @ rotation_vector)
    half = 0.5 * angle
    # (1 − x cot x)/θ² of x = θ/2, by its series where the difference would lose digits
    share = 1.0 / 12.0 + angle**2 / 720.0 if angle < 1e-2 else (1.0 - half / math.tan(half)) / angle**2
    cross = cross_matrix(rotation_vector)
    matrix: FloatArray = _IDENTITY + 0.5 * cross + share * cross @ cross
    return matrix
