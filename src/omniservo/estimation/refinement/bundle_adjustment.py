"""Several views of one rigid target refined together: camera poses and points (bundle adjustment).

Least squares on the reprojection error in px,

    Σ over views v and points j seen there of ‖π(R_vᵀ(h_j − t_v)) − p_vj‖²,

by Levenberg-Marquardt; the points are eliminated from every linear system (Schur complement), so the cost of
a step grows with the number of points, and with the third power of the number of views only.
Triggs, McLauchlan, Hartley, Fitzgibbon 2000.
"""

import math
from typing import NamedTuple

import numpy as np

from omniservo.cameras.unified_kernels import project_point, project_point_jacobian
from omniservo.estimation.refinement.pose_refinement import pose_row
from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.geometry.kernel import kernel, leaf
from omniservo.geometry.linear_systems import factor_cholesky, solve_factored
from omniservo.geometry.matrix_products import transposed_times
from omniservo.geometry.quaternions import matrix_from_quaternion, turn_quaternion

LEAST_PIVOT = 1e-12
FIRST_DAMPING = 1e-6
MOST_DAMPING = 1e8
SETTLED = 1e-10
"""A step that promises less than this part of the cost is the last."""


class BundleBlocks(NamedTuple):
    """The normal equations of v views and n points, block by block: JᵀJ and Jᵀr in (dt, δ) and dh."""

    poses: FloatArray
    """(6(v−1), 6(v−1)); the first view stays"""
    pose_gradient: FloatArray
    """(6(v−1),)"""
    points: FloatArray
    """(n, 3, 3) of each point"""
    point_gradients: FloatArray
    """(n, 3)"""
    mixed: FloatArray
    """(n, 6(v−1), 3) of all poses and each point"""


@kernel
def empty_blocks(views: int, n: int) -> BundleBlocks:
    """Return room for v views and n points."""
    size = 6 * (views - 1)
    return BundleBlocks(
        np.empty((size, size)), np.empty(size), np.empty((n, 3, 3)), np.empty((n, 3)), np.empty((n, size, 3))
    )


@kernel
def adjust_views(
    parameters: FloatArray,
    pixels: FloatArray,
    seen: BoolArray,
    scale_view: int,
    most_steps: int,
    poses: FloatArray,
    points: FloatArray,
) -> tuple[float, bool]:
    """Refine poses and points in place and return (Σr² [px²], converged).

    The first view is the frame of reference and stays. The scale is that of ``scale_view``: the distance
    of its centre from the first one's stays as it is.

    Args:
        parameters: of the camera.
        pixels: (v, n, 2) [px]; rows that are not seen are not read.
        seen: (v, n).
        scale_view: 1 … v − 1.
        most_steps: of Levenberg-Marquardt.
        poses: (v, 7) reference_T_camera: quaternion (x, y, z, w), translation [m]. In: a guess.
        points: (n, 3) [m] in the frame of reference. In: a guess. Points seen nowhere are only scaled.
    """
    views, n = seen.shape
    size = 6 * (views - 1)
    blocks = empty_blocks(views, n)
    trial_poses, trial_points = poses.copy(), points.copy()
    reduced, step = np.empty((size, size)), np.empty(size)
    cost = linearise(parameters, pixels, seen, poses, points, blocks)
    damping, length = FIRST_DAMPING, _baseline(poses, scale_view)
    if not cost < math.inf:
        return cost, False
    for _ in range(most_steps):
        _hold_scale(poses, scale_view, blocks.poses, reduced)
        for i in range(size):
            reduced[i, i] += damping * blocks.poses[i, i]
            step[i] = -blocks.pose_gradient[i]
        _reduce(blocks, damping, reduced, step)
        if factor_cholesky(reduced, size, LEAST_PIVOT):
            solve_factored(reduced, size, step)
            promised = _apply(poses, points, blocks, damping, step, trial_poses, trial_points)
            trial = cost_of_views(parameters, pixels, seen, trial_poses, trial_points)
            if trial <= cost:
                settled = promised <= SETTLED * cost + 1e-20
                poses[:], points[:] = trial_poses, trial_points
                _rescale(poses, points, length / _baseline(poses, scale_view))
                if settled:
                    return trial, True
                cost = linearise(parameters, pixels, seen, poses, points, blocks)
                damping = max(0.1 * damping, 1e-12)
                continue
            if promised <= SETTLED * cost + 1e-20:
                return cost, True
        damping *= 10.0
        if damping > MOST_DAMPING:
            return cost, False
    return cost, False


@kernel
def cost_of_views(
    parameters: FloatArray, pixels: FloatArray, seen: BoolArray, poses: FloatArray, points: FloatArray
) -> float:
    """Return Σr² [px²] over everything seen; infinity where a point leaves the camera's domain."""
    r = np.empty((3, 3))
    cost = 0.0
    for v in range(seen.shape[0]):
        matrix_from_quaternion(poses[v, 0], poses[v, 1], poses[v, 2], poses[v, 3], r)
        for j in range(seen.shape[1]):
            if not seen[v, j]:
                continue
            x, y, z = points[j, 0] - poses[v, 4], points[j, 1] - poses[v, 5], points[j, 2] - poses[v, 6]
            x, y, z = transposed_times(r, x, y, z)
            p, q, ok = project_point(parameters, x, y, z)
            if not ok:
                return math.inf
            cost += (p - pixels[v, j, 0]) ** 2 + (q - pixels[v, j, 1]) ** 2
    return cost


@kernel
def linearise(
    parameters: FloatArray,
    pixels: FloatArray,
    seen: BoolArray,
    poses: FloatArray,
    points: FloatArray,
    blocks: BundleBlocks,
) -> float:
    """Fill the blocks; return the cost, or infinity outside the domain.

    By (dt, δ): dc = −Rᵀdt + [c]× δ; by the point: dc = Rᵀdh.
    """
    normal, gradient, mixed = blocks.poses, blocks.pose_gradient, blocks.mixed
    own, pull = blocks.points, blocks.point_gradients
    normal[:, :], gradient[:], own[:, :, :], pull[:, :], mixed[:, :, :] = 0.0, 0.0, 0.0, 0.0, 0.0
    r, row = np.empty((3, 3)), np.empty((2, 6))
    cost = 0.0
    for v in range(seen.shape[0]):
        matrix_from_quaternion(poses[v, 0], poses[v, 1], poses[v, 2], poses[v, 3], r)
        at = 6 * (v - 1)
        for j in range(seen.shape[1]):
            if not seen[v, j]:
                continue
            hx, hy, hz = points[j, 0] - poses[v, 4], points[j, 1] - poses[v, 5], points[j, 2] - poses[v, 6]
            x, y, z = transposed_times(r, hx, hy, hz)
            p, q, j00, j01, j02, j10, j11, j12, ok = project_point_jacobian(parameters, x, y, z)
            if not ok:
                return math.inf
            pose_row(row[0], r, x, y, z, j00, j01, j02)
            pose_row(row[1], r, x, y, z, j10, j11, j12)
            dp, dq = p - pixels[v, j, 0], q - pixels[v, j, 1]
            cost += dp * dp + dq * dq
            for a in range(3):  # a point's derivative is minus that of the translation
                pull[j, a] -= row[0, a] * dp + row[1, a] * dq
                for b in range(3):
                    own[j, a, b] += row[0, a] * row[0, b] + row[1, a] * row[1, b]
            if v == 0:
                continue
            for a in range(6):
                gradient[at + a] += row[0, a] * dp + row[1, a] * dq
                for b in range(6):
                    normal[at + a, at + b] += row[0, a] * row[0, b] + row[1, a] * row[1, b]
                for b in range(3):
                    mixed[j, at + a, b] -= row[0, a] * row[0, b] + row[1, a] * row[1, b]
    return cost


@leaf
def _baseline(poses: FloatArray, view: int) -> float:
    """Return the distance of a view's centre from the first one's."""
    square = 0.0
    for i in range(3):
        square += (poses[view, 4 + i] - poses[0, 4 + i]) ** 2
    return math.sqrt(square)


@leaf
def _rescale(poses: FloatArray, points: FloatArray, factor: float) -> None:
    """Scale everything about the first view's centre, which no image shows."""
    for i in range(3):
        centre = poses[0, 4 + i]
        for v in range(1, poses.shape[0]):
            poses[v, 4 + i] = centre + factor * (poses[v, 4 + i] - centre)
        for j in range(points.shape[0]):
            points[j, i] = centre + factor * (points[j, i] - centre)


@kernel
def _hold_scale(poses: FloatArray, scale_view: int, normal: FloatArray, reduced: FloatArray) -> None:
    """Copy ``normal`` and add the weight that forbids a step along the baseline of ``scale_view``."""
    reduced[:, :] = normal
    at = 6 * (scale_view - 1)
    square = _baseline(poses, scale_view) ** 2
    weight = normal[at, at] + normal[at + 1, at + 1] + normal[at + 2, at + 2]
    for i in range(3):
        for k in range(3):
            along = (poses[scale_view, 4 + i] - poses[0, 4 + i]) * (
                poses[scale_view, 4 + k] - poses[0, 4 + k]
            )
            reduced[at + i, at + k] += 1e6 * weight * along / square


@leaf
def _damped_point(own: FloatArray, damping: float, factor: FloatArray) -> bool:
    """Write the Cholesky factor of a point's damped block; False where no one sees the point."""
    for a in range(3):
        for b in range(3):
            factor[a, b] = own[a, b]
        factor[a, a] += damping * own[a, a]
    return own[0, 0] + own[1, 1] + own[2, 2] > 0.0 and factor_cholesky(factor, 3, 1e-14)


@kernel
def _reduce(blocks: BundleBlocks, damping: float, reduced: FloatArray, step: FloatArray) -> None:
    """Take the points out of the system, in place: S = A − Σ W V⁻¹ Wᵀ, b = −g + Σ W V⁻¹ gₕ."""
    own, pull, mixed = blocks.points, blocks.point_gradients, blocks.mixed
    size = reduced.shape[0]
    factor, column = np.empty((3, 3)), np.empty(3)
    share = np.empty((size, 3))
    for j in range(own.shape[0]):
        if not _damped_point(own[j], damping, factor):
            continue
        for i in range(size):
            column[:] = mixed[j, i]
            solve_factored(factor, 3, column)
            share[i] = column
        for i in range(size):
            if share[i, 0] == 0.0 and share[i, 1] == 0.0 and share[i, 2] == 0.0:
                continue
            for a in range(3):
                step[i] += share[i, a] * pull[j, a]
            for k in range(i + 1):
                reduced[i, k] -= (
                    share[i, 0] * mixed[j, k, 0] + share[i, 1] * mixed[j, k, 1] + share[i, 2] * mixed[j, k, 2]
                )


@kernel
def _apply(
    poses: FloatArray,
    points: FloatArray,
    blocks: BundleBlocks,
    damping: float,
    step: FloatArray,
    trial_poses: FloatArray,
    trial_points: FloatArray,
) -> float:
    """Write the poses and points after a step; return the decrease that its gradient promises."""
    own, pull, mixed = blocks.points, blocks.point_gradients, blocks.mixed
    factor, move = np.empty((3, 3)), np.empty(3)
    promised = 0.0
    for i in range(step.shape[0]):
        promised -= blocks.pose_gradient[i] * step[i]
    for v in range(1, poses.shape[0]):
        at = 6 * (v - 1)
        trial_poses[v, :4] = turn_quaternion(poses[v, :4], step[at + 3], step[at + 4], step[at + 5])
        for i in range(3):
            trial_poses[v, 4 + i] = poses[v, 4 + i] + step[at + i]
    for j in range(points.shape[0]):
        trial_points[j] = points[j]
        if not _damped_point(own[j], damping, factor):
            continue
        for a in range(3):
            move[a] = -pull[j, a]
            for i in range(step.shape[0]):
                move[a] -= mixed[j, i, a] * step[i]
        solve_factored(factor, 3, move)
        for a in range(3):
            promised -= pull[j, a] * move[a]
            trial_points[j, a] += move[a]
    return promised
