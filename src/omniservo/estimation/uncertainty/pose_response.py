"""How a pose answers displaced pixels of known points: their own noise, and the camera's error in common.

With J (2n, 6) = ∂pixel/∂(translation, rotation on the right) and W the squared weights, pixels displaced by e
move the optimum by (JᵀWJ)⁻¹JᵀW e = Σ_j G_j e_j.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.cameras import ModelError, UnifiedCamera
from omniservo.geometry.arrays import BoolArray, FloatArray

Weighted = tuple[FloatArray, FloatArray]
"""points (n, 3) [m] and weights (n,) of their residuals"""


def pose_response(
    camera: UnifiedCamera, known: Weighted, members: BoolArray, pose: RigidTransform
) -> FloatArray | None:
    """Return G (n, 6, 2), 0 for points that are no members; None where they do not determine the pose."""
    points, weights = known
    rotation = pose.rotation.as_matrix()
    seen = (points - pose.translation) @ rotation
    _, slopes, valid = camera.project_jacobian(seen)
    squares = np.where(members & valid, np.square(weights), 0.0)
    by_turn = np.cross(slopes, seen[:, None, :])
    J = np.concatenate((-slopes @ rotation.T, by_turn), axis=2)
    J = np.where((squares > 0.0)[:, None, None], J, 0.0)
    try:
        inverse = np.linalg.inv(np.einsum("n,nci,ncj->ij", squares, J, J))
    except np.linalg.LinAlgError:
        return None
    return np.asarray(np.einsum("ij,ncj,n->nic", inverse, J, squares))


def own_variances(total: FloatArray, error: ModelError, variance: float, stated: float | None) -> FloatArray:
    """Return σ² (n,) [px²] of each point's own noise, ``total`` (n,) being its σ with the camera's error.

    ``variance`` [px²] is that of a coordinate of weight 1. Where σ comes from residuals, or these contradict
    what is stated, they have but little of the camera's error, which the pose takes up.
    """
    if stated is None or variance > stated**2:
        return np.square(total)
    return np.maximum(np.square(total) - error.sigma_px**2, 0.0)


def own_spread(response: FloatArray, variances: FloatArray) -> FloatArray:
    """Return the covariance (6, 6) of a pose whose points' own noise has these variances (n,) [px²]."""
    return np.asarray(np.einsum("n,nic,njc->ij", variances, response, response))


def shared_moves(error: ModelError, pixels: FloatArray, responses: FloatArray) -> FloatArray:
    """Return what independent errors of the camera do to poses (f, p), of all points' G (n, p, 2) in them."""
    rows = error.rows(pixels)
    return np.concatenate([rows @ responses[:, :, c] for c in range(2)])
