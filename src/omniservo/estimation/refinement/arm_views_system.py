"""Bundle adjustment of views that an arm has reached, with what is known beside the pixels.

Unknown are the poses T_i of all views but the first, the points h_j, the error ξ of the camera's mount (a
twist in the camera's frame: flange_T_camera · exp ξ) and the camera's parameters θ. Sought is the least of

    Σ ‖π_θ(T_i⁻¹ h_j) − p_ij‖²/w_ij²                                of the pixels,
    Σ ‖log(N_i⁻¹ T_i) − (I − Ad(N_i⁻¹)) ξ‖² over `REPEATS`²         of views that the arm has reached at N_i,
    (log ℓ − log L − a·ξ)²/σ_L²                                     of a length that is known,
    ξᵀ Σ_ξ⁻¹ ξ + (θ − θ₀)ᵀ Σ_θ⁻¹ (θ − θ₀)                           of mount and camera as calibrated,

by Levenberg and Marquardt (Triggs, McLauchlan, Hartley, Fitzgibbon 2000, with priors).
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.estimation.arm_views import (
    GOAL,
    ArmViewsOptimum,
    LengthPrior,
    lens_directions,
    mount_directions,
    seen_from_first,
    weights_of,
)
from omniservo.estimation.uncertainty.calibration_response import pixel_slopes
from omniservo.geometry.adjoint import adjoint
from omniservo.geometry.arrays import FloatArray, IntArray

REPEATS = np.repeat([1e-4, 1e-4], 3)
"""[m], [rad] 1σ of a displacement as an arm's joints tell it, beside what the mount's error does to it"""

EXACT = 1e-4
"""Relative σ of a length that is stated as exact."""

TOLERANT = 2.0
"""[σ] from which on a pixel counts less and less while wrong ones are looked for"""

_STEPS, _MOST_DAMPING = 100, 1e9

_SETTLED = 1e-4
"""A step that lowers the sum by less is the last: one σ raises it by 1."""


class Columns(NamedTuple):
    """Where in x what stands."""

    points: IntArray
    """(n, 3)"""
    mount: IntArray
    lens: IntArray

    def pose(self, view: int) -> IntArray:
        """(6,) of a view's translation and rotation vector."""
        return np.arange(6 * (view - 1), 6 * view)


def columns_of(v: int, n: int, at: ArmViewsOptimum) -> Columns:
    """Return them for v views of n points."""
    first, m, q = 6 * (v - 1), len(at.mount), len(at.lens)
    points = first + np.arange(3 * n).reshape(n, 3)
    begin = first + 3 * n
    return Columns(points, np.arange(begin, begin + m), np.arange(begin + m, begin + m + q))


def least_of(at: ArmViewsOptimum, *, tolerant: bool) -> ArmViewsOptimum | None:
    """Return where the sum is least, from there on; None where nothing is found."""
    tolerance, damping = TOLERANT if tolerant else None, 1e-4
    cost = _cost(at, tolerance)
    for _ in range(_STEPS):
        r, jacobian = system_of(at, tolerance)
        scale = unit_scale(jacobian)
        if scale is None:
            return None
        jacobian /= scale
        normal, gradient = jacobian.T @ jacobian, jacobian.T @ r
        while True:
            try:
                step = np.linalg.solve(normal + damping * np.eye(len(normal)), -gradient)
            except np.linalg.LinAlgError:
                return None
            trial = _moved(at, step / scale)
            after = _cost(trial, tolerance)
            if after <= cost:
                break
            damping *= 10.0
            if damping > _MOST_DAMPING:
                return at
        settled = cost - after <= _SETTLED
        at, cost, damping = trial, after, max(0.1 * damping, 1e-9)
        if settled:
            return at
    return at if tolerant else None


def _cost(at: ArmViewsOptimum, tolerance: float | None) -> float:
    """Return the sum; ∞ where a point that is seen cannot be."""
    squares = np.square(np.linalg.norm(residuals_of(at), axis=2) / weights_of(at.views))[at.views.seen]
    if not np.isfinite(squares).all():
        return math.inf
    if tolerance is not None:
        squares = tolerance**2 * np.log1p(squares / tolerance**2)
    where = columns_of(len(at.poses), len(at.points), at)
    size = 6 * (len(at.poses) - 1) + at.points.size + len(at.mount) + len(at.lens)
    return float(squares.sum()) + sum(float(r @ r) for r, _ in _priors(at, where, size))


def residuals_of(at: ArmViewsOptimum) -> FloatArray:
    """Return projection minus pixel (v, n, 2) [px], ∞ where a point cannot be seen."""
    pixels, valid = at.camera.project(seen_from_first(at))
    return np.where(valid[..., None], pixels - np.nan_to_num(at.views.pixels), np.inf)


def system_of(at: ArmViewsOptimum, tolerance: float | None) -> tuple[FloatArray, FloatArray]:
    """Return what is squared and added up (N,), pixels first, and its derivative (N, columns).

    ``tolerance`` [σ]: from there on a pixel counts less (Cauchy's weights); None: none does.
    """
    views, camera = at.views, at.camera
    v, n = views.seen.shape
    where = columns_of(v, n, at)
    size = 6 * (v - 1) + 3 * n + len(at.mount) + len(at.lens)
    jacobian, local = np.zeros((v, n, 2, size)), seen_from_first(at)
    pixels, slopes, valid = camera.project_jacobian(local)
    used = views.seen & valid
    gaps = np.where(used[..., None], pixels - np.nan_to_num(views.pixels), 0.0)
    directions = lens_directions(views.known)
    every = np.arange(n)
    for i, pose in enumerate(at.poses):
        turn = pose.as_matrix()[:3, :3]
        by_point = slopes[i] @ turn.T
        for axis in range(3):
            jacobian[i, every, :, where.points[:, axis]] = by_point[:, :, axis]
        if i:
            jacobian[i][:, :, where.pose(i)] = np.concatenate(
                (-by_point, np.cross(slopes[i], local[i][:, None, :])), axis=2
            )
        if len(directions):
            by_lens = pixel_slopes(camera, local[i], directions.shape[1])
            jacobian[i][:, :, where.lens] = by_lens @ directions.T
    weights = np.where(used, 1.0 / weights_of(views), 0.0)
    if tolerance is not None:
        far = np.linalg.norm(gaps, axis=2) * weights
        weights = weights / np.sqrt(1.0 + (far / tolerance) ** 2)
    jacobian *= weights[:, :, None, None]
    rows = [((weights[..., None] * gaps).ravel(), jacobian.reshape(-1, size)), *_priors(at, where, size)]
    return np.concatenate([r for r, _ in rows]), np.concatenate([j for _, j in rows])


def _priors(at: ArmViewsOptimum, where: Columns, size: int) -> list[tuple[FloatArray, FloatArray]]:
    """Return what is known beside the pixels, as rows of the system."""
    mounts, rows = mount_directions(at.views.known), []
    for values, columns in ((at.mount, where.mount), (at.lens, where.lens)):
        slopes = np.zeros((len(values), size))
        slopes[:, columns] = np.eye(len(values))
        rows.append((values, slopes))
    for i, reached in enumerate(at.views.reached):
        if reached is None or i in (0, GOAL):
            continue
        error = reached.inv() * at.poses[i]
        by_mount = (np.eye(6) - adjoint(reached.inv())) @ mounts.T
        gap = np.concatenate((error.translation, error.rotation.as_rotvec())) - by_mount @ at.mount
        slopes = np.zeros((6, size))
        slopes[:3, where.pose(i)[:3]] = reached.as_matrix()[:3, :3].T
        slopes[3:, where.pose(i)[3:]] = np.eye(3)
        slopes[:, where.mount] = -by_mount
        rows.append((gap / REPEATS, slopes / REPEATS[:, None]))
    if at.views.known.length is not None:
        rows.append(_length_row(at, at.views.known.length, mounts, where, size))
    return rows


def _length_row(
    at: ArmViewsOptimum, length: LengthPrior, mounts: FloatArray, where: Columns, size: int
) -> tuple[FloatArray, FloatArray]:
    slopes, sigma = np.zeros((1, size)), max(length.sigma, EXACT)
    if length.rows is None:
        way = np.asarray(at.poses[GOAL].translation - at.poses[length.since].translation)
        slopes[0, where.pose(GOAL)[:3]] = way / (way @ way)
        if length.since:
            slopes[0, where.pose(length.since)[:3]] = -way / (way @ way)
    else:
        i, j = length.rows
        way = at.points[j] - at.points[i]
        slopes[0, where.points[j]] = way / (way @ way)
        slopes[0, where.points[i]] = -way / (way @ way)
    by_mount = np.zeros(len(mounts)) if length.by_mount is None else mounts @ length.by_mount
    slopes[0, where.mount] = -by_mount
    gap = math.log(float(np.linalg.norm(way)) / length.metres) - float(by_mount @ at.mount)
    return np.array([gap / sigma]), slopes / sigma


def unit_scale(jacobian: FloatArray) -> FloatArray | None:
    """Return the columns' lengths; None where one is 0 or not finite."""
    scale = np.sqrt(np.square(jacobian).sum(axis=0))
    return scale if np.isfinite(scale).all() and scale.min() > 0.0 else None


def _moved(at: ArmViewsOptimum, step: FloatArray) -> ArmViewsOptimum:
    where = columns_of(len(at.poses), len(at.points), at)
    poses = [at.poses[0]]
    for i, pose in enumerate(at.poses[1:], start=1):
        by = step[where.pose(i)]
        moved = pose.as_matrix()
        moved[:3, :3] = moved[:3, :3] @ Rotation.from_rotvec(by[3:]).as_matrix()
        moved[:3, 3] += by[:3]
        poses.append(RigidTransform(moved, normalize=False))
    return replace(
        at, poses=tuple(poses), points=at.points + step[where.points], mount=at.mount + step[where.mount],
        lens=at.lens + step[where.lens],
    )  # fmt: skip
