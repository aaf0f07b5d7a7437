"""First-order law of goal and points at the optimum of an arm's views.

Σ = H⁻¹ (Jᵀ N J + P) H⁻¹, H the Hessian with the pixels weighted by w, N the share of pixel noise in w², P the
priors' part of H. What the camera's model error does, which no number of points reduces, comes on top.
"""

from __future__ import annotations

import numpy as np

from omniservo.estimation.arm_views import GOAL, ArmViewsOptimum, lens_directions, weights_of
from omniservo.estimation.refinement.arm_views_system import columns_of, system_of, unit_scale
from omniservo.estimation.uncertainty.joint_uncertainty import JointUncertainty
from omniservo.estimation.uncertainty.shared_errors import shared_error_factor

_NEGLIGIBLE = 1e-14


def law_of(at: ArmViewsOptimum) -> JointUncertainty | None:
    """Return the first-order law of the goal's pose and the points at an optimum; None: none."""
    views, jacobian = at.views, system_of(at, None)[1]
    v, n = views.seen.shape
    pixels = 2 * v * n
    share = np.where(views.seen, views.noise / weights_of(views), 0.0).repeat(2)
    noisy = share[:, None] * jacobian[:pixels]
    hessian, scaled = jacobian.T @ jacobian, unit_scale(jacobian)
    if not np.isfinite(hessian).all() or scaled is None:
        return None
    try:
        inverse = np.linalg.inv(hessian / np.outer(scaled, scaled)) / np.outer(scaled, scaled)
    except np.linalg.LinAlgError:
        return None
    of_pixels = noisy.T @ noisy
    if views.windows is not None:
        gain = inverse[:6] @ noisy.T
        by_match = np.moveaxis(gain.reshape(6, v, n, 2)[:, [0, GOAL]], 2, 0).reshape(n, 6, 4)
        pair = np.concatenate((views.pixels[0], views.pixels[GOAL]), axis=1)
        of_pixels = of_pixels * max(1.0, shared_error_factor(by_match, pair, views.windows))
    rest = jacobian[pixels:]
    spread = inverse @ (of_pixels + rest.T @ rest) @ inverse
    where, q = columns_of(v, n, at), len(at.lens)
    chosen = np.concatenate((where.pose(GOAL), where.points.ravel()))
    joint, camera = spread[np.ix_(chosen, chosen)], np.empty((0, 0))
    shared = np.empty((0, len(chosen)))
    if q:
        own = spread[np.ix_(where.lens, where.lens)]
        values, vectors = np.linalg.eigh(own)
        root = vectors * np.sqrt(np.maximum(values, 0.0))
        across = spread[np.ix_(chosen, where.lens)]
        shared = np.linalg.lstsq(root, across.T, rcond=None)[0]
        joint = joint - shared.T @ shared
        camera = root.T @ lens_directions(views.known)
    values, vectors = np.linalg.eigh(0.5 * (joint + joint.T))
    if not np.isfinite(values).all() or values[-1] <= 0.0:
        return None
    kept = values > _NEGLIGIBLE * values[-1]
    if (error := views.camera.model_error) is not None:
        moves = error.moves(np.swapaxes(np.nan_to_num(views.pixels), 0, 1).reshape(n, 2 * v))
        moves = np.moveaxis(moves.reshape(-1, n, v, 2), 2, 1) / weights_of(views)[None, :, :, None]
        pulls = np.where(views.seen[None, :, :, None], moves, 0.0).reshape(len(moves), -1)
        field = (pulls @ jacobian[:pixels] @ inverse)[:, chosen]
        shared = np.concatenate((shared, field))
        camera = np.concatenate((camera, np.zeros((len(field), camera.shape[1]))))
    return JointUncertainty(
        noise=np.ascontiguousarray((vectors[:, kept] * np.sqrt(values[kept])).T),
        own=np.zeros((n, 3, 3)),
        freedom=at.freedom,
        calibration=np.ascontiguousarray(shared),
        camera=np.ascontiguousarray(camera) if camera.size else np.empty((len(shared), 0)),
    )
