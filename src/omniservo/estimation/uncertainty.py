"""First-order uncertainty of motion and structure, in the gauge that the scale fixes."""

import math

import numpy as np

from omniservo.estimation.normal_blocks import (
    NormalBlocks,
    eliminate_point,
    invert_point_block,
    linearise,
    linearise_point,
)
from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel
from omniservo.geometry.linear_systems import factor_cholesky, solve_factored

FAR_POINT_DAMPING = 1e-10
"""Relative weight that keeps the block of a point without parallax regular; its variance stays huge."""


def two_view_covariance(
    parameters: FloatArray,
    pixels: FloatArray,
    weights: FloatArray,
    noise: FloatArray,
    rotation: FloatArray,
    translation: FloatArray,
    points: FloatArray,
    between: tuple[int, int] | None,
) -> tuple[FloatArray, FloatArray] | None:
    """Return the covariances of (t, δ) (6, 6) and of each point (n, 3, 3) for noise of 1 px over the weight.

    The estimate answers pixel noise ε linearly: dm = Σ Mⱼεⱼ for the motion m = (t, δ), dhⱼ = Pⱼεⱼ − Kⱼdm. The
    scale is fixed by ‖t‖ or, where ``between`` = (i, k) is given, by ‖hᵢ − hₖ‖: its relative error then
    joins dm as a seventh entry ρ, dt becomes dt − ρt and dh becomes dh − ρh.

    Args:
        parameters: of the camera whose pixels the cost is measured in.
        pixels: (n, 4) in that camera.
        weights: (n, 2) of the residuals in either image, inverse to the pixels' noise.
        noise: (n, 8) the derivative of those pixels, times their weights, to pixel noise of 1 px over the
            weight: two 2×2 blocks row by row, the identity in the real image.
        rotation: (3, 3) the optimum.
        translation: (3,) the optimum, length 1.
        points: (n, 3) the optimum.
        between: indices of the points whose distance is known.

    Returns:
        None where the normal equations are singular: the data do not determine the motion.
    """
    n = len(points)
    motion, own, follow = np.empty((n, 6, 4)), np.empty((n, 3, 4)), np.empty((n, 3, 6))
    if not _responses(parameters, pixels, weights, noise, rotation, translation, points, motion, own, follow):
        return None
    if between is not None:
        i, k = between
        link = points[i] - points[k]
        link = link / (link @ link)
        ratio = -(link @ (follow[i] - follow[k])) @ motion
        ratio[i] += link @ own[i]
        ratio[k] -= link @ own[k]
        gauge = np.concatenate((translation, np.zeros(3)))
        whole = np.concatenate((motion, ratio[:, None, :]), axis=1)
        motion = motion - gauge[:, None] * ratio[:, None, :]
        follow = np.concatenate((follow, points[:, :, None]), axis=2)
    else:
        whole = motion
    flat = np.ascontiguousarray(np.swapaxes(motion, 0, 1)).reshape(6, -1)
    flat_whole = np.ascontiguousarray(np.swapaxes(whole, 0, 1)).reshape(whole.shape[1], -1)
    mixed = own @ np.swapaxes(whole, 1, 2) @ np.swapaxes(follow, 1, 2)
    spread = follow @ (flat_whole @ flat_whole.T) @ np.swapaxes(follow, 1, 2)
    points_covariance = own @ np.swapaxes(own, 1, 2) - mixed - np.swapaxes(mixed, 1, 2) + spread
    return flat @ flat.T, points_covariance


@kernel
def _responses(
    parameters: FloatArray,
    pixels: FloatArray,
    weights: FloatArray,
    noise: FloatArray,
    rotation: FloatArray,
    translation: FloatArray,
    points: FloatArray,
    motion: FloatArray,
    own: FloatArray,
    follow: FloatArray,
) -> bool:
    """Fill M (n, 6, 4), P (n, 3, 4), K (n, 3, 6); return False where a system is singular."""
    n = points.shape[0]
    blocks = NormalBlocks(
        np.empty((6, 6)), np.empty(6), np.empty((n, 6)), np.empty((n, 18)), np.empty((n, 3))
    )
    if not linearise(parameters, pixels, weights, math.inf, rotation, translation, points, blocks) < math.inf:
        return False
    inverse, product = np.empty(6), np.empty(18)
    b4, a2, e, column = np.empty((4, 3)), np.empty((2, 6)), np.empty(4), np.empty(6)
    for j in range(n):
        if not invert_point_block(blocks.points[j], FAR_POINT_DAMPING, inverse):
            return False
        eliminate_point(inverse, blocks.mixed[j], product)
        linearise_point(parameters, pixels, weights, j, rotation, translation, points, b4, a2, e)
        for a in range(6):
            for i in range(3):
                follow[j, i, a] = product[3 * a + i]
            for b in range(a + 1):
                for i in range(3):
                    blocks.motion[a, b] -= product[3 * a + i] * blocks.mixed[j, 3 * b + i]
        _own_response(inverse, b4, noise[j], own[j])
        for c in range(4):
            for a in range(6):
                goal = 0.0
                for row in range(2):
                    if c >= 2:
                        goal += a2[row, a] * noise[j, 4 + 2 * row + c - 2]
                for i in range(3):
                    goal -= blocks.mixed[j, 3 * a + i] * own[j, i, c]
                motion[j, a, c] = goal
    weight = blocks.motion[0, 0] + blocks.motion[1, 1] + blocks.motion[2, 2]
    for i in range(3):
        for k in range(i + 1):
            blocks.motion[i, k] += weight * translation[i] * translation[k]
    if not factor_cholesky(blocks.motion, 6, 1e-13):
        return False
    for j in range(n):
        for c in range(4):
            for a in range(6):
                column[a] = motion[j, a, c]
            solve_factored(blocks.motion, 6, column)
            for a in range(6):
                motion[j, a, c] = column[a]
    return True


@kernel
def _own_response(inverse: FloatArray, b4: FloatArray, noise: FloatArray, own: FloatArray) -> None:
    """Write P = V⁻¹BᵀA (3, 4) of one point: how it follows its own pixels while the motion stands still."""
    for c in range(4):
        half = c // 2
        x, y, z = 0.0, 0.0, 0.0
        for row in range(2):
            a = noise[4 * half + 2 * row + c % 2]
            x += b4[2 * half + row, 0] * a
            y += b4[2 * half + row, 1] * a
            z += b4[2 * half + row, 2] * a
        own[0, c] = inverse[0] * x + inverse[1] * y + inverse[3] * z
        own[1, c] = inverse[1] * x + inverse[2] * y + inverse[4] * z
        own[2, c] = inverse[3] * x + inverse[4] * y + inverse[5] * z
