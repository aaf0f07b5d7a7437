"""How a pose answers displaced pixels of known points: their own noise, and the camera's error in common.

With J (2n, 6) = ∂pixel/∂(translation, rotation on the right) and W the squared weights, pixels displaced by e
move the optimum by (JᵀWJ)⁻¹JᵀW e = Σ_j G_j e_j.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import brentq
from scipy.spatial.transform import RigidTransform

from omniservo.cameras import UnifiedCamera
from omniservo.estimation.uncertainty.shared_camera_error import LARGEST_EXCESS
from omniservo.geometry.arrays import BoolArray, FloatArray

Weighted = tuple[FloatArray, FloatArray]
"""points (n, 3) [m] and weights (n,) of their residuals"""


MOST_COMPARED = 100
"""points whose residuals are checked for that"""

LARGEST_RAISE = 1e4

ENOUGH_FREEDOM = 15
"""of residuals, to tell single points' noise from the camera's errors: fewer say too little of σ"""

LEAST_SHARE = 0.1
"""of σ in residuals is that of single points, however much the camera's errors explain"""


def pose_response(
    camera: UnifiedCamera, known: Weighted, members: BoolArray, pose: RigidTransform
) -> tuple[FloatArray, FloatArray] | None:
    """Return G (n, 6, 2) and J (n, 2, 6), 0 for points that are no members; None: the pose is free."""
    points, weights = known
    rotation = pose.as_matrix()[:3, :3]
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


def noise_factor(
    moves: FloatArray, residuals: FloatArray, jacobian: FloatArray, own: FloatArray, *, stated: bool
) -> float:
    """Return by which factor points' own σ differs from √``own``, as the residuals show.

    What the pose does not absorb of the residuals, y = Uᵀr with UᵀJ = 0, has the covariance Uᵀ(V + K)U, V
    of the points' own noise and K of the camera's errors. V is made as large as to make yᵀ(…)⁻¹y equal to its
    degrees of freedom. What is stated is not made smaller, nor larger (1) unless that exceeds them by 3.1 of
    its σ.

    Args:
        moves: (f, n, 2) [px] independent errors of the camera.
        residuals: (n, 2) [px].
        jacobian: (n, 2, 6) of the residuals by the pose; points with 0 are left out.
        own: (n,) variance of each point's own noise [px²].
        stated: whether ``own`` was; else it comes from the same residuals and is at most so large.
    """
    used = np.flatnonzero(np.abs(jacobian).max(axis=(1, 2)) > 0.0)
    used = used[:: -(-len(used) // MOST_COMPARED)] if len(used) else used
    freedom = 2 * len(used) - int(jacobian.shape[2])
    if freedom < (1 if stated else ENOUGH_FREEDOM) or not own[used].min() > 0.0:
        return 1.0
    left = np.linalg.qr(jacobian[used].reshape(2 * len(used), -1), mode="complete")[0][:, -freedom:]
    field = moves[:, used].reshape(len(moves), 2 * len(used)) @ left
    noise = np.sqrt(np.repeat(own[used], 2))[:, None] * left
    camera, alone = field.T @ field, noise.T @ noise
    seen = left.T @ residuals[used].ravel()

    def excess(log_factor: float) -> float:
        whole = camera + math.exp(2.0 * log_factor) * alone
        return float(seen @ np.linalg.solve(whole, seen)) - freedom

    if stated and excess(0.0) <= LARGEST_EXCESS * math.sqrt(2.0 * freedom):
        return 1.0
    least, most = (0.0, math.log(LARGEST_RAISE)) if stated else (math.log(LEAST_SHARE), 0.0)
    if excess(least) <= 0.0:
        return math.exp(least)
    return math.exp(float(brentq(excess, least, most, xtol=1e-3))) if excess(most) < 0.0 else math.exp(most)


def own_spread(response: FloatArray, variances: FloatArray) -> FloatArray:
    """Return the covariance (6, 6) of a pose whose points' own noise has these variances (n,) [px²]."""
    return np.asarray(np.einsum("n,nic,njc->ij", variances, response, response))
