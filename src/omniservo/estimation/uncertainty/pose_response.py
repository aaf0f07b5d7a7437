"""How a pose answers displaced pixels of known points: their own noise, and the camera's error in common.

With J (2n, 6) = ∂pixel/∂(translation, rotation on the right) and W the squared weights, pixels displaced by e
move the optimum by (JᵀWJ)⁻¹JᵀW e = Σ_j G_j e_j.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import brentq
from scipy.spatial.transform import RigidTransform

from omniservo.cameras import ModelError, UnifiedCamera
from omniservo.geometry.arrays import BoolArray, FloatArray

Weighted = tuple[FloatArray, FloatArray]
"""points (n, 3) [m] and weights (n,) of their residuals"""


LARGEST_EXCESS = 3.1
"""[σ] by which residuals may exceed what is stated before that is taken to be too small"""

MOST_COMPARED = 100
"""points whose residuals are checked for that"""

LARGEST_RAISE = 1e4


def pose_response(
    camera: UnifiedCamera, known: Weighted, members: BoolArray, pose: RigidTransform
) -> tuple[FloatArray, FloatArray] | None:
    """Return G (n, 6, 2) and J (n, 2, 6), 0 for points that are no members; None: the pose is free."""
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
    return np.asarray(np.einsum("ij,ncj,n->nic", inverse, J, squares)), J


def contradicted(
    error: ModelError, pixels: FloatArray, residuals: FloatArray, jacobian: FloatArray, own: FloatArray
) -> float:
    """Return by which factor points' own σ is too small, as the residuals show; 1: it is not.

    What the pose does not absorb of the residuals, y = Uᵀr with UᵀJ = 0, has the covariance Uᵀ(V + K)U, V
    of the points' own noise and K of the camera's field. Where yᵀ(…)⁻¹y exceeds its degrees of freedom by 3.1
    of its σ, V is raised to where it is as large as they are.

    Args:
        error: of the camera.
        pixels: (n, 2) [px].
        residuals: (n, 2) [px].
        jacobian: (n, 2, 6) of the residuals by the pose; points with 0 are left out.
        own: (n,) variance of each point's own noise [px²].
    """
    used = np.flatnonzero(np.abs(jacobian).max(axis=(1, 2)) > 0.0)
    used = used[:: -(-len(used) // MOST_COMPARED)] if len(used) else used
    freedom = 2 * len(used) - int(jacobian.shape[2])
    if freedom < 1 or not own[used].min() > 0.0:
        return 1.0
    left = np.linalg.qr(jacobian[used].reshape(2 * len(used), -1), mode="complete")[0][:, -freedom:]
    rows = error.rows(pixels[used])
    field, noise = np.kron(rows, np.eye(2)) @ left, np.sqrt(np.repeat(own[used], 2))[:, None] * left
    camera, alone = field.T @ field, noise.T @ noise
    seen = left.T @ residuals[used].ravel()

    def excess(log_factor: float) -> float:
        whole = camera + math.exp(2.0 * log_factor) * alone
        return float(seen @ np.linalg.solve(whole, seen)) - freedom

    if excess(0.0) <= LARGEST_EXCESS * math.sqrt(2.0 * freedom):
        return 1.0
    most = math.log(LARGEST_RAISE)
    return math.exp(float(brentq(excess, 0.0, most, xtol=1e-3))) if excess(most) < 0.0 else LARGEST_RAISE


def own_variances(total: FloatArray, error: ModelError, variance: float, stated: float | None) -> FloatArray:
    """Return σ² (n,) [px²] of each point's own noise, ``total`` (n,) being its σ with the camera's error.

    ``variance`` [px²] is that of a coordinate of weight 1. Where σ comes from residuals, or these contradict
    what is stated, they have but little of the camera's error, which the pose absorbs.
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
