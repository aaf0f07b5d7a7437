"""The rotation nearest to a matrix, which also turns one set of directions best onto another."""

from __future__ import annotations

import numpy as np

from omniservo.geometry.arrays import FloatArray


def nearest_rotation(matrices: FloatArray) -> FloatArray:
    """Return R (..., 3, 3) of the least ‖R − M‖ (Frobenius) for each M (..., 3, 3).

    With M = Σ a bᵀ it is the rotation of the least Σ ‖a − R b‖²: Kabsch, Acta Cryst. A32, 1976. R = U Vᵀ of
    the singular value decomposition, its last column turned where that would be a reflection.
    """
    u, _, vt = np.linalg.svd(matrices)
    u[..., 2] *= np.sign(np.linalg.det(u @ vt))[..., None]
    rotations: FloatArray = u @ vt
    return rotations
