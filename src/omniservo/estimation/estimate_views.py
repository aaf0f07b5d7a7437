"""Motion and structure from two views or more."""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import UnifiedCamera
from omniservo.errors import InputError
from omniservo.estimation.multi_view_estimate import MultiViewEstimate
from omniservo.estimation.refinement.bundle_adjustment import adjust_views
from omniservo.estimation.robust.pose_search import GATE, PRIOR_NOISE_PX, PRIOR_WEIGHT, write_pose_residuals
from omniservo.estimation.status.evidence import largest_noise
from omniservo.estimation.status.pose_evidence import variance_of
from omniservo.estimation.uncertainty.view_uncertainty import ViewUncertainty
from omniservo.estimation.view_poses import LEAST_POINTS, PlacedViews, place_all, place_others
from omniservo.estimation.view_scale import GaugeLength, ViewScale, checked_scale
from omniservo.geometry.arrays import BoolArray, FloatArray, finite_array, finite_number, owned

ADJUSTING_STEPS = 100
GATING_ROUNDS = 4


def estimate_views(
    camera: UnifiedCamera,
    pixels: npt.ArrayLike,
    *,
    visible: npt.ArrayLike | None = None,
    scale: ViewScale = None,
    scale_sigma: float = 0.0,
    robust: bool = True,
    noise: float | None = None,
) -> MultiViewEstimate:
    """Return the poses of v views and the points they see, which minimise Σ ‖π(Rᵀ(h − t)) − p‖² [px²].

    The two views that tell most of the structure (`estimate_two_view`), the others by the points found so far
    (`estimate_pose`), bundle adjustment of all, pixels far from it left out. Where four or more points are
    known (`KnownPoints`), the views stand by these, and may be as flat as a tag.

    Args:
        camera: took all pictures.
        pixels: (v, n, 2) [px], [i, j] shows point j in view i.
        visible: (v, n) bool: the pixels of others are not read. None: all.
        scale: None: the centres of the first two views are 1 apart, not metric. A number: their distance [m].
            ((i, j), d): the distance of the points i and j [m]. `ViewDistance`: that of any two views'
            centres. `KnownPoints`: points with known coordinates.
        scale_sigma: relative standard deviation of that.
        robust: leave out pixels that do not agree with the others or are outside the camera's domain.
        noise: σ of a pixel coordinate [px]; None: from the residuals.

    Raises:
        InputError: shapes, numbers that are not finite, illegal scale, most pixels outside the camera's
            domain (not robust: one).
    """
    started = time.perf_counter()
    views = _checked_views(camera, pixels, visible, noise, robust)
    length = checked_scale(scale, *views.seen.shape)
    relative = finite_number("scale_sigma", scale_sigma, minimum=0.0)
    if _place_by_known_points(views, length):
        failed = place_others(views)
    else:
        status, words, failed = place_all(views, robust)
        if status != "ok":
            return MultiViewEstimate.without_pose(views.seen.shape, status, words, started)
    if not views.placed[0]:
        words = f"the first view does not join the others: {failed[0]}"
        return MultiViewEstimate.without_pose(views.seen.shape, "not_converged", words, started)
    _to_first_view(views)
    problem = _adjust(views, robust) or _scaled(views, length)
    if problem:
        return MultiViewEstimate.without_pose(views.seen.shape, "not_converged", problem, started)
    words = "; ".join(f"view {view} has no pose: {why}" for view, why in sorted(failed.items()))
    return _concluded(views, length, relative, words, started)


def _checked_views(camera: UnifiedCamera, pixels: Any, visible: Any, noise: Any, robust: bool) -> PlacedViews:
    given = np.asarray(pixels)
    if given.ndim != 3 or given.shape[2] != 2 or len(given) < 2:
        raise InputError(f"pixels: shape {given.shape} given; (v, n, 2) with v ≥ 2 is needed")
    v, n, _ = given.shape
    seen = np.ones((v, n), dtype=np.bool_) if visible is None else np.asarray(visible)
    if seen.dtype != np.bool_ or seen.shape != (v, n):
        raise InputError(f"visible: {seen.dtype} {seen.shape} given; bool {(v, n)} is needed")
    rows = np.zeros((v, n, 2))
    rows[seen] = finite_array("pixels (visible rows)", given[seen], (None, 2)) if seen.any() else 0.0
    bearings, valid = camera.unproject(rows)
    if robust and 2 * np.count_nonzero(seen & valid) >= np.count_nonzero(seen):
        seen = seen & valid
    if not valid[seen].all():
        i, j = (int(x) for x in np.argwhere(seen & ~valid)[0])
        raise InputError(
            f"pixels: ({rows[i, j, 0]:g}, {rows[i, j, 1]:g}) at index ({i}, {j}) is outside the camera's"
            f" domain (at most {math.degrees(camera.usable_angle):.1f}° from the axis)"
        )
    sigma = None if noise is None else finite_number("noise", noise, above=0.0)
    points, agree = np.full((n, 3), math.nan), np.zeros((v, n), dtype=np.bool_)
    poses, placed = np.zeros((v, 7)), np.zeros(v, dtype=np.bool_)
    poses[:, 3] = 1.0
    return PlacedViews(camera, rows, bearings, seen.copy(), sigma, poses, placed, points, agree)


def _place_by_known_points(views: PlacedViews, length: GaugeLength) -> bool:
    """Place the views in which the known points tell the pose; True where at least two do."""
    if len(length.known) < LEAST_POINTS:
        return False
    for view in range(len(views.seen)):
        rows = views.seen[view, length.indices]
        if rows.sum() >= LEAST_POINTS:
            views.place(view, length.known[rows], length.indices[rows])
    if views.placed.sum() >= 2:
        return True
    views.placed[:] = False
    return False


def _to_first_view(views: PlacedViews) -> None:
    """Change the frame of poses and points to that of the first view."""
    first = _pose(views.poses[0]).inv()
    for view in np.flatnonzero(views.placed):
        pose = first * _pose(views.poses[view])
        views.poses[view, :4], views.poses[view, 4:] = pose.rotation.as_quat(), pose.translation
    views.points[:] = first.apply(views.points)


def _pose(row: FloatArray) -> RigidTransform:
    return RigidTransform.from_components(row[4:], Rotation.from_quat(row[:4]))


def _adjust(views: PlacedViews, robust: bool) -> str:
    """Refine poses and points on the pixels that agree with them; return what went wrong, or nothing."""
    usable = views.seen & views.placed[:, None]
    if robust:
        usable = views.agree.copy()
    for _ in range(GATING_ROUNDS):
        usable = usable & (~np.isnan(views.points[:, 0]) & (usable.sum(axis=0) >= 2))[None, :]
        if usable.sum() * 2 <= _unknowns(views, usable) or (usable[views.placed].sum(axis=1) < 3).any():
            return "too few pixels agree with each other"
        order = np.flatnonzero(views.placed)
        poses = views.poses[order]
        far = int(np.linalg.norm(poses[:, 4:], axis=1).argmax())
        if not np.linalg.norm(poses[far, 4:]) > 0.0:
            return "all views have one centre"
        points = np.where(usable.any(axis=0)[:, None], views.points, 0.0)
        cost, converged = adjust_views(
            views.camera.parameters, views.pixels[order], usable[order], far, ADJUSTING_STEPS, poses, points
        )
        if not converged:
            return "the bundle adjustment found no minimum"
        views.poses[order] = poses
        views.points[:] = np.where(usable.any(axis=0)[:, None], points, math.nan)
        views.agree[:] = usable
        noise = math.sqrt(cost / max(2 * usable.sum() - _unknowns(views, usable), 1))
        if noise > largest_noise(_whole_noise(views)):
            return f"the best structure leaves {noise:.2g} px of noise: the pixels do not agree"
        distance = np.linalg.norm(residuals_of(views), axis=2)
        near = views.seen & (distance <= GATE * _gate_noise(views, distance[usable]))
        if not robust or (near == usable).all():
            break
        usable = near
    return ""


def _whole_noise(views: PlacedViews) -> float | None:
    """Return the σ [px] of pixels that is stated, the camera's model error added in quadrature."""
    error = views.camera.model_error
    return views.noise if views.noise is None or error is None else math.hypot(views.noise, error.sigma_px)


def _gate_noise(views: PlacedViews, distances: FloatArray) -> float:
    """Return σ for the gate: what is stated, or from the median distance and a prior."""
    if (stated := _whole_noise(views)) is not None:
        return stated
    freedom = max(2 * len(distances) - _unknowns(views, views.agree), 1)
    square = float(np.median(distances)) ** 2 / (2.0 * math.log(2.0)) * 2 * len(distances)
    return math.sqrt((PRIOR_WEIGHT * PRIOR_NOISE_PX**2 + square) / (PRIOR_WEIGHT + freedom))


def _unknowns(views: PlacedViews, usable: BoolArray) -> int:
    return 6 * (int(views.placed.sum()) - 1) - 1 + 3 * int(usable.any(axis=0).sum())


def residuals_of(views: PlacedViews) -> FloatArray:
    """Return projection minus pixel (v, n, 2) [px], NaN where there is no pose, place or pixel."""
    residuals = np.full(views.pixels.shape, math.nan)
    for view in np.flatnonzero(views.placed):
        write_pose_residuals(
            views.camera.parameters,
            views.points,
            views.pixels[view],
            views.poses[view, :4],
            views.poses[view, 4:],
            residuals[view],
        )
    residuals[~views.seen] = math.nan
    return residuals


def _scaled(views: PlacedViews, length: GaugeLength) -> str:
    """Scale poses and points to the known length; return what went wrong, or nothing."""
    lost = length.indices[
        ~views.placed[length.indices] if length.of_views else np.isnan(views.points[length.indices, 0])
    ]
    if len(lost) and not (len(length.known) and len(length.indices) - len(lost) >= 2):
        return f"{'view' if length.of_views else 'point'} {lost[0]}, which the scale refers to, has no place"
    used = length.without(lost)
    value = used.value(views.poses[:, 4:], views.points)
    if not value > 0.0:
        return "the length that the scale refers to is 0"
    factor = (2.0**-0.5 if used.metres is None else used.metres) / value
    views.poses[:, 4:] *= factor
    views.points *= factor
    return ""


def _concluded(
    views: PlacedViews, length: GaugeLength, scale_sigma: float, words: str, started: float
) -> MultiViewEstimate:
    v, n = views.seen.shape
    order, rows = np.flatnonzero(views.placed), np.flatnonzero(~np.isnan(views.points[:, 0]))
    law = ViewUncertainty.of_views(
        views.camera,
        views.pixels[order][:, rows],
        views.agree[order][:, rows],
        views.poses[order],
        views.points[rows],
        length.among(order, rows),
    )
    if law is None:
        words = "the views do not determine the motion"
        return MultiViewEstimate.without_pose((v, n), "not_converged", words, started)
    residuals = residuals_of(views)
    square = float((residuals[views.agree] ** 2).sum())
    freedom = 2 * int(views.agree.sum()) - _unknowns(views, views.agree)
    variance = variance_of(square, freedom, views.noise)
    covariance = np.full((v, 6, 6), math.nan)
    covariance[0] = 0.0
    for rank, view in enumerate(order[1:], start=1):
        g = np.concatenate((views.poses[view, 4:], np.zeros(3)))
        covariance[view] = law.pose_covariance(rank, variance) + scale_sigma**2 * np.outer(g, g)
    points_covariance = np.full((n, 3, 3), math.nan)
    h = views.points[rows]
    points_covariance[rows] = law.point_covariances(variance) + scale_sigma**2 * h[:, :, None] * h[:, None, :]
    unknown = views.noise is None and freedom > 2
    return MultiViewEstimate(
        status="ok",
        message=words,
        initial_T_views=tuple(_pose(views.poses[view]) if views.placed[view] else None for view in range(v)),
        points=owned(views.points),
        is_metric=length.metres is not None,
        covariance=owned(covariance),
        points_covariance=owned(points_covariance),
        inliers=views.agree,
        rms_px=math.sqrt(square / int(views.agree.sum())),
        noise_px=math.sqrt(square / freedom),
        residuals_px=owned(residuals),
        scale_sigma=scale_sigma,
        freedom=float(freedom) if unknown else math.inf,
        uncertainty=law,
        sigma_px=math.sqrt(square / freedom if unknown else variance),
        seconds=time.perf_counter() - started,
    )
