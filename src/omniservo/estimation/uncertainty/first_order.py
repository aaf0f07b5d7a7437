"""First-order uncertainty of motion and structure, in the gauge that the scale fixes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from omniservo.estimation.refinement.normal_blocks import (
    NormalBlocks,
    eliminate_point,
    empty_blocks,
    empty_rows,
    invert_point_block,
    linearise,
    linearise_point,
)
from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel, leaf
from omniservo.geometry.linear_systems import factor_cholesky, solve_factored

FAR_POINT_DAMPING = 1e-10
"""Relative weight that keeps the block of a point without parallax regular; its variance stays huge."""

LEAST_VARIANCE = 1e-10
"""A part of the motion whose variance is this part of all is one that the scale holds still."""


@dataclass(frozen=True, eq=False)
class LinearResponse:
    """How motion and structure answer pixel noise ε: dm = Σ Mⱼεⱼ, m = (t, δ), and dhⱼ = Pⱼεⱼ − Kⱼ Σ Wᵢεᵢ.

    ε is in σ, the noise of a pixel coordinate of weight 1. Where ‖t‖ is given W is M; where ‖hᵢ − hₖ‖ is
    given W has a seventh row, the relative error ρ of the scale, M follows it by −ρt and K has the column h.
    """

    motion: FloatArray
    """M (n, 6, 4)"""
    whole: FloatArray
    """W (n, 6, 4) or (n, 7, 4)"""
    own: FloatArray
    """P (n, 3, 4)"""
    follow: FloatArray
    """K (n, 3, 6) or (n, 3, 7)"""
    unscaled: FloatArray
    """(6, 6) covariance of (t, δ) with ‖t‖ = 1, for noise of 1 px over the weight"""

    def answer(self, pixels: FloatArray) -> FloatArray:
        """Return dx (6 + 3n) to displaced pixels (n, 4), times their weights [px]."""
        whole = np.einsum("jac,jc->a", self.whole, pixels)
        points = np.einsum("jic,jc->ji", self.own, pixels) - self.follow @ whole
        return np.concatenate((np.einsum("jac,jc->a", self.motion, pixels), points.ravel()))

    def law(self) -> tuple[FloatArray, FloatArray]:
        """Return (rows (k, 6 + 3n), own (n, 3, 3)): dx is Σ zₖ rowₖ and each point's own part, for σ = 1.

        The rows are the columns of the Cholesky factor of the covariance of x that belong to the motion; what
        they leave of a point's covariance is its own. (Points share nothing else where the cost is that of
        the real pixels; on the virtual plane what they share besides, of order 1/n, is left out.)
        """
        n = len(self.own)
        rows, own = np.empty((6, 6 + 3 * n)), np.empty((n, 3, 3))
        count = _joint_law(self.motion, self.whole, self.own, self.follow, rows, own)
        return rows[:count], own


@leaf
def _add_product(a: FloatArray, b: FloatArray, total: FloatArray) -> None:
    """Add a bᵀ to ``total``."""
    for i in range(a.shape[0]):
        for k in range(b.shape[0]):
            for c in range(a.shape[1]):
                total[i, k] += a[i, c] * b[k, c]


@kernel
def _joint_law(
    motion: FloatArray,
    whole: FloatArray,
    own: FloatArray,
    follow: FloatArray,
    rows: FloatArray,
    alone: FloatArray,
) -> int:
    """Write the Cholesky columns (k, 6 + 3n) of the motion and what they leave of each point; return k."""
    n, size = motion.shape[0], whole.shape[1]
    product, spread = np.zeros((size, 6)), np.zeros((size, size))
    left, towards = np.zeros((6, 6 + 3 * n)), np.empty((3, size))
    for j in range(n):
        _add_product(whole[j], whole[j], spread)
        _add_product(whole[j], motion[j], product)
        _add_product(motion[j], motion[j], left[:, :6])
    for j in range(n):
        at = 6 + 3 * j
        towards[:, :] = 0.0
        _add_product(own[j], whole[j], towards)
        alone[j] = 0.0
        _add_product(own[j], own[j], alone[j])
        for a in range(3):
            for c in range(6):
                for i in range(4):
                    left[c, at + a] += own[j, a, i] * motion[j, c, i]
                for k in range(size):
                    left[c, at + a] -= follow[j, a, k] * product[k, c]
            for b in range(3):
                for k in range(size):
                    alone[j, a, b] -= towards[a, k] * follow[j, b, k] + follow[j, a, k] * towards[b, k]
                    for m in range(size):
                        alone[j, a, b] += follow[j, a, k] * spread[k, m] * follow[j, b, m]
    count = 0
    floors = (left[0, 0] + left[1, 1] + left[2, 2], left[3, 3] + left[4, 4] + left[5, 5])
    for i in range(6):
        if not left[i, i] > LEAST_VARIANCE * floors[i // 3]:
            continue
        rows[count] = left[i] / math.sqrt(left[i, i])
        for k in range(i, 6):
            left[k] -= rows[count, k] * rows[count]
        for j in range(n):
            for a in range(3):
                for b in range(3):
                    alone[j, a, b] -= rows[count, 6 + 3 * j + a] * rows[count, 6 + 3 * j + b]
        count += 1
    return count


def linear_response(
    parameters: FloatArray,
    pixels: FloatArray,
    weights: FloatArray,
    noise: FloatArray,
    rotation: FloatArray,
    translation: FloatArray,
    points: FloatArray,
    between: tuple[int, int] | None,
) -> LinearResponse:
    """Return how the estimate answers pixel noise at its optimum, which `determines_motion`.

    Args:
        parameters: of the camera whose pixels the cost is measured in.
        pixels: (n, 4) in that camera.
        weights: (n, 2) of the residuals in either image, inverse to the pixels' noise.
        noise: (n, 8) the derivative of those pixels, times their weights, to pixel noise of 1 px over the
            weight: two 2×2 blocks row by row, the identity in the real image.
        rotation: (3, 3) the optimum.
        translation: (3,) the optimum, length 1.
        points: (n, 3) the optimum.
        between: indices of the points whose distance is known; None: ‖t‖ is.

    Raises:
        ValueError: the normal equations are singular.
    """
    responses = _responses(parameters, pixels, weights, noise, rotation, translation, points)
    motion, own, follow, is_regular = responses
    if not is_regular:
        raise ValueError("the normal equations are singular")
    flat = np.ascontiguousarray(np.swapaxes(motion, 0, 1)).reshape(6, -1)
    unscaled = flat @ flat.T
    if between is None:
        return LinearResponse(motion, motion, own, follow, unscaled)
    i, k = between
    link = points[i] - points[k]
    link = link / (link @ link)
    ratio = -(link @ (follow[i] - follow[k])) @ motion
    ratio[i] += link @ own[i]
    ratio[k] -= link @ own[k]
    gauge = np.concatenate((translation, np.zeros(3)))
    whole = np.concatenate((motion, ratio[:, None, :]), axis=1)
    scaled = motion - gauge[:, None] * ratio[:, None, :]
    return LinearResponse(scaled, whole, own, np.concatenate((follow, points[:, :, None]), axis=2), unscaled)


@kernel
def determines_motion(
    parameters: FloatArray,
    pixels: FloatArray,
    weights: FloatArray,
    rotation: FloatArray,
    translation: FloatArray,
    points: FloatArray,
) -> bool:
    """Tell whether the normal equations at this optimum are regular; arguments as `linear_response`."""
    room = empty_blocks(points.shape[0])
    return _factor_motion(parameters, pixels, weights, rotation, translation, points, room)


@kernel
def _factor_motion(
    parameters: FloatArray,
    pixels: FloatArray,
    weights: FloatArray,
    rotation: FloatArray,
    translation: FloatArray,
    points: FloatArray,
    blocks: NormalBlocks,
) -> bool:
    """Fill the blocks, and the motion's with the Cholesky factor of the Schur complement, ‖t‖ held."""
    if not linearise(parameters, pixels, weights, rotation, translation, points, blocks) < math.inf:
        return False
    inverse, product = np.empty(6), np.empty(18)
    for j in range(points.shape[0]):
        if not invert_point_block(blocks.points[j], FAR_POINT_DAMPING, inverse):
            return False
        eliminate_point(inverse, blocks.mixed[j], product)
        for a in range(6):
            for b in range(a + 1):
                for i in range(3):
                    blocks.motion[a, b] -= product[3 * a + i] * blocks.mixed[j, 3 * b + i]
    weight = blocks.motion[0, 0] + blocks.motion[1, 1] + blocks.motion[2, 2]
    for i in range(3):
        for k in range(i + 1):
            blocks.motion[i, k] += weight * translation[i] * translation[k]
    return factor_cholesky(blocks.motion, 6, 1e-13)


@kernel
def _responses(
    parameters: FloatArray,
    pixels: FloatArray,
    weights: FloatArray,
    noise: FloatArray,
    rotation: FloatArray,
    translation: FloatArray,
    points: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray, bool]:
    """Return M (n, 6, 4), P (n, 3, 4), K (n, 3, 6); False, and they are unset, where a system is singular."""
    n = points.shape[0]
    motion, own, follow = np.empty((n, 6, 4)), np.empty((n, 3, 4)), np.empty((n, 3, 6))
    blocks, rows = empty_blocks(n), empty_rows()
    if not _factor_motion(parameters, pixels, weights, rotation, translation, points, blocks):
        return motion, own, follow, False
    inverse, product, column = np.empty(6), np.empty(18), np.empty(6)
    for j in range(n):
        invert_point_block(blocks.points[j], FAR_POINT_DAMPING, inverse)
        eliminate_point(inverse, blocks.mixed[j], product)
        linearise_point(parameters, pixels, weights, j, rotation, translation, points, rows)
        for a in range(6):
            for i in range(3):
                follow[j, i, a] = product[3 * a + i]
        _own_response(inverse, rows.to_point, noise[j], own[j])
        for c in range(4):
            for a in range(6):
                goal = 0.0
                for row in range(2):
                    if c >= 2:
                        goal += rows.to_motion[row, a] * noise[j, 4 + 2 * row + c - 2]
                for i in range(3):
                    goal -= blocks.mixed[j, 3 * a + i] * own[j, i, c]
                motion[j, a, c] = goal
    for j in range(n):
        for c in range(4):
            for a in range(6):
                column[a] = motion[j, a, c]
            solve_factored(blocks.motion, 6, column)
            for a in range(6):
                motion[j, a, c] = column[a]
    return motion, own, follow, True


@leaf
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
