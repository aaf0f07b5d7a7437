"""The normal equations of two views, block by block: a motion and, apart from each other, the points."""

import math
from typing import NamedTuple

import numpy as np

from omniservo.cameras.unified_kernels import project_point_jacobian
from omniservo.estimation.refinement.pose_refinement import pose_row
from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel, leaf
from omniservo.geometry.matrix_products import transposed_times


class NormalBlocks(NamedTuple):
    """The normal equations in (dt, δ; dh₁ … dhₙ), block by block."""

    motion: FloatArray
    """(6, 6), lower triangle"""
    motion_gradient: FloatArray
    """(6,)"""
    points: FloatArray
    """(n, 6): xx, xy, yy, xz, yz, zz of each point's block"""
    mixed: FloatArray
    """(n, 18): each point's 6×3 block, row by row"""
    point_gradients: FloatArray
    """(n, 3)"""


@kernel
def empty_blocks(n: int) -> NormalBlocks:
    """Return room for n points."""
    return NormalBlocks(np.empty((6, 6)), np.empty(6), np.empty((n, 6)), np.empty((n, 18)), np.empty((n, 3)))


class PointRows(NamedTuple):
    """One point's residual in both images and its derivatives, times the weights."""

    residual: FloatArray
    """(4,) u, v, u*, v*: projection minus pixel [px]"""
    to_point: FloatArray
    """(4, 3) by h"""
    to_motion: FloatArray
    """(2, 6) of (u*, v*) by (dt, δ); the initial image does not depend on them"""


@kernel
def empty_rows() -> PointRows:
    """Return room for one point."""
    return PointRows(np.empty(4), np.empty((4, 3)), np.empty((2, 6)))


@leaf
def linearise_point(
    parameters: FloatArray,
    pixels: FloatArray,
    weights: FloatArray,
    j: int,
    rotation: FloatArray,
    translation: FloatArray,
    points: FloatArray,
    rows: PointRows,
) -> bool:
    """Fill point ``j``'s rows; δ is the rotation vector applied on the right of R.

    False outside the camera's domain.
    """
    r, residual, to_point, to_motion = rotation, rows.residual, rows.to_point, rows.to_motion
    x, y, z = points[j, 0], points[j, 1], points[j, 2]
    u, v, j00, j01, j02, j10, j11, j12, ok = project_point_jacobian(parameters, x, y, z)
    if not ok:
        return False
    w = weights[j, 0]
    residual[0], residual[1] = w * (u - pixels[j, 0]), w * (v - pixels[j, 1])
    to_point[0, 0], to_point[0, 1], to_point[0, 2] = w * j00, w * j01, w * j02
    to_point[1, 0], to_point[1, 1], to_point[1, 2] = w * j10, w * j11, w * j12
    x, y, z = x - translation[0], y - translation[1], z - translation[2]
    cx, cy, cz = transposed_times(r, x, y, z)
    u, v, j00, j01, j02, j10, j11, j12, ok = project_point_jacobian(parameters, cx, cy, cz)
    if not ok:
        return False
    w = weights[j, 1]
    residual[2], residual[3] = w * (u - pixels[j, 2]), w * (v - pixels[j, 3])
    pose_row(to_motion[0], r, cx, cy, cz, w * j00, w * j01, w * j02)
    pose_row(to_motion[1], r, cx, cy, cz, w * j10, w * j11, w * j12)
    for k in range(3):
        to_point[2, k] = -to_motion[0, k]
        to_point[3, k] = -to_motion[1, k]
    return True


@kernel
def linearise(
    parameters: FloatArray,
    pixels: FloatArray,
    weights: FloatArray,
    rotation: FloatArray,
    translation: FloatArray,
    points: FloatArray,
    blocks: NormalBlocks,
) -> float:
    """Fill the blocks of the normal equations and return Σ‖r‖² [px²], or infinity outside the domain."""
    rows = empty_rows()
    e, b4, a2 = rows.residual, rows.to_point, rows.to_motion
    blocks.motion[:, :] = 0.0
    blocks.motion_gradient[:] = 0.0
    cost = 0.0
    for j in range(points.shape[0]):
        if not linearise_point(parameters, pixels, weights, j, rotation, translation, points, rows):
            return math.inf
        cost += e[0] * e[0] + e[1] * e[1] + e[2] * e[2] + e[3] * e[3]
        place = 0
        # A point moves in the goal image as −t does, so the goal's part stands in three blocks.
        for a in range(3):
            x, y, z, w = b4[0, a], b4[1, a], b4[2, a], b4[3, a]
            goal = z * e[2] + w * e[3]
            blocks.point_gradients[j, a] = x * e[0] + y * e[1] + goal
            blocks.motion_gradient[a] -= goal
            for b in range(a + 1):
                goal = z * b4[2, b] + w * b4[3, b]
                blocks.points[j, place] = x * b4[0, b] + y * b4[1, b] + goal
                blocks.motion[a, b] += goal
                blocks.mixed[j, 3 * a + b], blocks.mixed[j, 3 * b + a] = -goal, -goal
                place += 1
        for a in range(3, 6):
            x, y = a2[0, a], a2[1, a]
            blocks.motion_gradient[a] += x * e[2] + y * e[3]
            for b in range(3):
                goal = x * b4[2, b] + y * b4[3, b]
                blocks.mixed[j, 3 * a + b] = goal
                blocks.motion[a, b] -= goal
            for b in range(3, a + 1):
                blocks.motion[a, b] += x * a2[0, b] + y * a2[1, b]
    return cost


@leaf
def invert_point_block(block: FloatArray, damping: float, inverse: FloatArray) -> bool:
    """Write the inverse (6,), same order, of a point block (6,) with its diagonal times (1 + damping)."""
    xx, yy, zz = (1.0 + damping) * block[0], (1.0 + damping) * block[2], (1.0 + damping) * block[5]
    xy, xz, yz = block[1], block[3], block[4]
    a, b, c = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    determinant = xx * a + xy * b + xz * c
    if not determinant > 1e-15 * xx * yy * zz:
        return False
    f = 1.0 / determinant
    inverse[0], inverse[1], inverse[3] = f * a, f * b, f * c
    inverse[2], inverse[4] = f * (xx * zz - xz * xz), f * (xy * xz - xx * yz)
    inverse[5] = f * (xx * yy - xy * xy)
    return True


@leaf
def eliminate_point(inverse: FloatArray, mixed: FloatArray, product: FloatArray) -> None:
    """Write the product (18,), a 6×3 block row by row, of a mixed block and an inverted point block."""
    for a in range(6):
        x, y, z = mixed[3 * a], mixed[3 * a + 1], mixed[3 * a + 2]
        product[3 * a] = x * inverse[0] + y * inverse[1] + z * inverse[3]
        product[3 * a + 1] = x * inverse[1] + y * inverse[2] + z * inverse[4]
        product[3 * a + 2] = x * inverse[3] + y * inverse[4] + z * inverse[5]
