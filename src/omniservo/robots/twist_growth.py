"""How a Jacobian of twists changes while the joints move."""

from __future__ import annotations

import numpy as np

from omniservo.geometry.arrays import FloatArray


def twist_growth(J: FloatArray, slope: FloatArray) -> FloatArray:
    """Return dJ/dw (6, n) along q′ = slope (n,), of a Jacobian in the frame of the body that it moves.

    By column, J̇ᵢ = [Jᵢ, Σ_{k>i} q′ₖ Jₖ]: the bracket of twists (linear, angular) in the moving frame.
    """
    moved = J * slope
    after = np.cumsum(moved[:, ::-1], axis=1)[:, ::-1] - moved
    linear = _cross(J[3:], after[:3]) + _cross(J[:3], after[3:])
    return np.concatenate([linear, _cross(J[3:], after[3:])])


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
