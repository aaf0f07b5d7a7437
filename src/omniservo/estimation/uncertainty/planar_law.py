"""First-order law of motion and structure before a plane."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from omniservo.estimation.matches import Matches
from omniservo.estimation.refinement.planar_motion import UNKNOWNS, PlanarBlocks, PlanarMotion
from omniservo.estimation.uncertainty.joint_uncertainty import JointUncertainty
from omniservo.estimation.uncertainty.planar_region import planar_stretches
from omniservo.estimation.uncertainty.two_view_uncertainty import Lens, Noise, ScaleLength, Solution
from omniservo.geometry.arrays import FloatArray


def planar_law(
    members: Matches,
    solution: tuple[PlanarMotion, FloatArray, PlanarBlocks],
    others: Sequence[PlanarMotion] | None,
    noise: Noise,
    windows: FloatArray | None,
    length: ScaleLength,
    lens: Lens,
) -> JointUncertainty | None:
    """Return the law of x = (t, δ, h₁ … hₙ) in metres; None where the motion is not determined.

    With the ``others``, motions that pixels do not distinguish from the solution's, it is stretched
    (`planar_stretches`); with None it is that of first order.

    y = (δ, τ, dm) has the covariance σ²N⁻¹, N the reduced normal matrix, and a ray's own step V⁻¹, apart from
    y; x follows both linearly.
    """
    motion, rays, blocks = solution
    n = len(rays)
    inverse, follow, reduced = blocks.eliminated()
    try:
        spread = np.linalg.inv(reduced)
        rows = np.linalg.cholesky(spread).T
    except np.linalg.LinAlgError:
        return None
    pulls = np.swapaxes(blocks.to_motion - blocks.to_ray @ follow, 1, 2)
    together = noise.shared_by(spread @ pulls, members, windows)
    to_motion, to_ray = _structure_slopes(motion, rays, blocks)
    shared = _joined(motion, rows, blocks, to_motion - to_ray @ follow)
    if others is not None:
        whole = np.asarray(together.variance * spread)
        far = planar_stretches(motion, others, rays, blocks.across, whole, noise.freedom)
        shared = np.concatenate((shared, far / math.sqrt(max(together.variance, 1e-300))))
    own = to_ray @ inverse @ np.swapaxes(to_ray, 1, 2)
    calibration = np.empty((0, 6 + 3 * n))
    points = motion.points(rays)
    moves, directions = lens.all_moves(members, Solution(motion.rotation, motion.translation, points))
    if len(moves):
        moved = -moves * np.repeat(members.weights, 2, axis=1)
        gradient = np.einsum("nji,qni->qj", pulls, moved)
        calibration = _joined(motion, gradient @ spread, blocks, to_motion - to_ray @ follow)
        turns = np.einsum("nij,qnj->qni", inverse @ np.swapaxes(blocks.to_ray, 1, 2), moved)
        calibration[:, 6:] += np.einsum("nij,qnj->qni", to_ray, turns).reshape(len(moved), -1)
    metres = length.of_translation(points)
    if length.between is not None:
        shared, own, calibration = _held(motion, points, length.between, shared, own, calibration)
    unit = np.full(6 + 3 * n, metres)
    unit[3:6] = 1.0
    return JointUncertainty(
        math.sqrt(together.variance) * unit * shared,
        noise.variance * metres**2 * own,
        noise.freedom,
        unit * calibration,
        directions,
    )


def _structure_slopes(
    motion: PlanarMotion, rays: FloatArray, blocks: PlanarBlocks
) -> tuple[FloatArray, FloatArray]:
    """Return ∂h/∂y (n, 3, 8) and ∂h/∂(ray's step) (n, 3, 2) of h = R b*/(m·b*) + t."""
    heights = rays @ motion.normal
    seen = (rays @ motion.rotation.T) / heights[:, None]
    to_motion = np.empty((len(rays), 3, UNKNOWNS))
    to_motion[:, :, :3] = np.cross(rays[:, None, :], motion.rotation[None]) / heights[:, None, None]
    to_motion[:, :, 3:5] = blocks.across
    to_motion[:, :, 5:] = -seen[:, :, None] * rays[:, None, :] / heights[:, None, None]
    slopes = motion.rotation - seen[:, :, None] * motion.normal
    return to_motion, slopes @ blocks.tangents / heights[:, None, None]


def _joined(motion: PlanarMotion, rows: FloatArray, blocks: PlanarBlocks, points: FloatArray) -> FloatArray:
    """Return what steps y (k, 8) do to x (k, 6 + 3n)."""
    follow = np.einsum("nij,kj->kni", points, rows).reshape(len(rows), -1)
    return np.concatenate((rows[:, 3:5] @ blocks.across.T, rows[:, :3], follow), axis=1)


def _held(
    motion: PlanarMotion,
    points: FloatArray,
    between: tuple[int, int],
    shared: FloatArray,
    own: FloatArray,
    calibration: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the law with the distance of two points held: their own parts move the scale of all."""
    i, k = between
    extra = np.zeros((6, shared.shape[1]))
    own = own.copy()
    for row, j in ((0, i), (3, k)):
        values, vectors = np.linalg.eigh(own[j])
        extra[row : row + 3, 6 + 3 * j : 9 + 3 * j] = (vectors * np.sqrt(np.maximum(values, 0.0))).T
        own[j] = 0.0
    link = points[i] - points[k]
    link = link / (link @ link)
    x = np.concatenate((motion.translation, np.zeros(3), points.ravel()))
    held = []
    for rows in (np.concatenate((shared, extra)), calibration):
        ratio = (rows[:, 6 + 3 * i : 9 + 3 * i] - rows[:, 6 + 3 * k : 9 + 3 * k]) @ link
        held.append(rows - ratio[:, None] * x)
    return held[0], own, held[1]
