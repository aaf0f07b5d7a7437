"""The camera's pose from one image of known points (perspective-n-point on bearings)."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from omniservo.cameras import UnifiedCamera
from omniservo.cameras.conversion import UnifiedImage, unified_image
from omniservo.cameras.models import CentralModel
from omniservo.errors import InputError
from omniservo.estimation.outside_domain import in_domain, with_rows
from omniservo.estimation.pose_estimate import PoseEstimate, PoseStatus, pose_of
from omniservo.estimation.refinement.motion_search import LEAST_NOISE_PX
from omniservo.estimation.refinement.pose_minima import COST
from omniservo.estimation.refinement.pose_refinement import inverse_information
from omniservo.estimation.robust.pose_fit import LEAST_POINTS, KnownPixels, PoseFit, fit_pose
from omniservo.estimation.robust.pose_search import write_pose_residuals
from omniservo.estimation.status.pose_evidence import FAR_ROTATION, judge_pose, rotation_between
from omniservo.estimation.uncertainty.camera_moves import CameraMoves, camera_variance, is_exact
from omniservo.estimation.uncertainty.pose_region import pose_stretch
from omniservo.estimation.uncertainty.pose_response import noise_factor, own_spread, pose_response
from omniservo.geometry.arrays import FloatArray, finite_array, finite_number, owned


def estimate_pose(
    camera: CentralModel,
    points: npt.ArrayLike,
    pixels: npt.ArrayLike,
    *,
    robust: bool = True,
    noise: float | npt.ArrayLike | None = None,
) -> PoseEstimate:
    """Return the camera's pose that minimises Σ ‖π(Rᵀ(h − t)) − p‖² over known points h and their pixels p.

    Poses of three bearings (P3P), the best of random samples, refinement in the image; bearings of any
    direction are members. The mirrored pose of a plane is always looked for. Three points leave up to four
    poses, all of which are reported.

    Args:
        camera: took the image; of any model (`UnifiedImage`).
        points: (n, 3) [m] in a frame of their own.
        pixels: (n, 2) [px], row j shows point j.
        robust: reject points that do not agree with the others (never of three), and those outside the
            camera's domain.
        noise: σ of a pixel coordinate [px], one number or (n,), one for each point. The camera's
            ``model_error`` and ``calibration_covariance`` count beside it, alike in neighbours. None: every
            pixel is as good as any other, and σ comes from the residuals.

    Raises:
        InputError: shapes, numbers that are not finite, illegal noise, most pixels outside the camera's
            domain (not robust: one).
    """
    image = unified_image(camera)
    try:
        return _estimate_pose(image.camera, known_pixels(image, points, pixels, noise), robust)
    except InputError:
        model, seen = finite_array("points", points, (None, 3)), finite_array("pixels", pixels, (None, 2))
        sigmas = _checked_noise(noise, len(model))
        inside = in_domain(camera, seen) if robust and len(model) == len(seen) else None
        if inside is None or inside.all():
            raise
    sigmas = None if sigmas is None else sigmas[inside]
    known = known_pixels(image, model[inside], seen[inside], sigmas)
    part = _estimate_pose(image.camera, known, robust)
    inliers = np.zeros(len(seen), dtype=np.bool_)
    inliers[inside] = part.inliers
    return replace(part, inliers=inliers, residuals_px=with_rows(part.residuals_px, inside))


def _estimate_pose(camera: UnifiedCamera, known: KnownPixels, robust: bool) -> PoseEstimate:
    started = time.perf_counter()
    n = len(known.points)
    if n < LEAST_POINTS:
        words = f"{n} points given; at least {LEAST_POINTS} are needed"
        return _without_pose(n, "too_few_points", words, np.empty((0, 7)), (), started)
    fit = fit_pose(known, robust)
    verdict = judge_pose(fit, known)
    poses = owned(fit.minima[: len(verdict.odds), :COST])
    odds = tuple(float(x) for x in verdict.odds)
    if verdict.status != "ok":
        return _without_pose(n, verdict.status, verdict.message, poses, odds, started)
    spread = pose_spread(known, fit, verdict.variance, verdict.odds, camera)
    if spread is None:
        words = "the points do not determine the pose"
        return _without_pose(n, "not_converged", words, poses, odds, started)
    covariance = spread.own + spread.of_camera
    residuals = pose_residuals(known, fit.minima[0])
    square = float((residuals[fit.members] ** 2).sum())
    return PoseEstimate(
        status="ok",
        message=spread.message,
        minima=poses,
        odds=odds,
        covariance=owned(covariance),
        inliers=fit.members,
        rms_px=math.sqrt(square / int(fit.members.sum())),
        noise_px=verdict.noise_px,
        residuals_px=owned(residuals),
        seconds=time.perf_counter() - started,
    )


def known_pixels(
    image: UnifiedImage, points: npt.ArrayLike, pixels: npt.ArrayLike, noise: Any, name: str = "pixels"
) -> KnownPixels:
    """Return checked points and carried pixels with bearings and weights; ``name`` stands in messages.

    Raises:
        InputError: see `estimate_pose`.
    """
    model = finite_array("points", points, (None, 3)) if np.size(points) else np.empty((0, 3))
    seen = finite_array(name, pixels, (None, 2)) if np.size(pixels) else np.empty((0, 2))
    if len(model) != len(seen):
        raise InputError(f"points, {name}: {len(model)} and {len(seen)} rows given; one pixel each is needed")
    camera = image.own
    bearings, valid = camera.unproject(seen)
    if not valid.all():
        j = int(np.argmin(valid))
        raise InputError(
            f"{name}: ({seen[j, 0]:g}, {seen[j, 1]:g}) at index {j} is outside the camera's domain"
            f" (at most {math.degrees(camera.usable_angle):.1f}° from the axis)"
        )
    sigmas, parameters = _checked_noise(noise, len(model)), image.camera.parameters
    if sigmas is not None:
        sigmas = np.sqrt(np.square(sigmas) + camera_variance(camera, bearings))
    carried = image.carried(seen)
    if sigmas is None or not len(sigmas):
        return KnownPixels(parameters, model, carried, bearings, np.ones(len(model)), None)
    sigmas = sigmas * image.scale(seen)
    usual = float(np.median(sigmas))
    return KnownPixels(parameters, model, carried, bearings, usual / sigmas, usual)


def _checked_noise(noise: Any, n: int) -> FloatArray | None:
    """Return σ of each point's pixel coordinates (n,) [px]."""
    if noise is None:
        return None
    if np.ndim(noise) == 0:
        return np.full(n, finite_number("noise", noise, above=0.0))
    sigmas = finite_array("noise", noise, (None,))
    if len(sigmas) != n:
        raise InputError(f"noise: {len(sigmas)} numbers given; {n} are needed, one for each point")
    if n and sigmas.min() <= 0.0:
        raise InputError(f"noise: {sigmas.min():g} given; legal: > 0")
    return sigmas


SAID = 1.05
"""times that noise is raised, before that is said"""


class PixelResponse(NamedTuple):
    """How a pose answers the errors of its camera."""

    seen: FloatArray
    """(n, 1, 3) [m] the points in the camera"""
    pixels: FloatArray
    """(n, 2) [px] of them"""
    response: FloatArray
    """G (n, 6, 2), see `pose_response`"""
    moves: CameraMoves
    """of the camera, in this image alone"""


@dataclass(frozen=True, eq=False)
class PoseSpread:
    """How uncertain a pose is."""

    own: FloatArray
    """(6, 6) by the points' own noise, stretched to the region that they leave"""
    by_camera: PixelResponse | None = None
    """what the camera's errors do; None: it is exact"""
    raised: float = 1.0
    """by which factor the points' own stated σ was too small, as the residuals show"""

    @property
    def message(self) -> str:
        """What is said of that."""
        if self.raised < SAID:
            return ""
        return f"the residuals contradict the stated noise, which is taken {self.raised:.2g} times as large"

    @property
    def of_camera(self) -> FloatArray:
        """The covariance (6, 6) by the camera's errors."""
        if self.by_camera is None:
            return np.zeros((6, 6))
        rows = self.by_camera.moves.through(self.by_camera.response)
        return np.asarray(rows.T @ rows)


def pose_spread(
    known: KnownPixels, fit: PoseFit, variance: float, odds: FloatArray, camera: UnifiedCamera
) -> PoseSpread | None:
    """Return how uncertain the best minimum is; None where it is not determined.

    ``variance`` is that of a pixel coordinate of weight 1 [px²], ``odds`` are those of the first minima.
    """
    inverse, by_camera = np.empty((6, 6)), None
    best, raised = fit.minima[0], 1.0
    weights = np.where(fit.members, known.weights, 0.0)
    cost = inverse_information(
        known.parameters, known.points, known.pixels, weights, best[:4], best[4:7], inverse
    )
    if not cost < math.inf:
        return None
    covariance = variance * inverse
    if not is_exact(camera):
        found = pose_response(camera, (known.points, known.weights), fit.members, pose_of(best))
        if found is None:
            return None
        response, slopes = found
        seen = pose_of(best).inv().apply(known.points)[:, None]
        moves = CameraMoves.of(camera, seen, known.pixels)
        own, stated = variance / np.square(known.weights), known.noise_px is not None
        if known.noise_px is not None:
            own = np.square(known.noise_px / known.weights) - camera_variance(camera, known.bearings)
            own = np.maximum(own, LEAST_NOISE_PX**2)
        residuals = pose_residuals(known, best)
        raised = noise_factor(moves.pixels, residuals, slopes, own, stated=stated)
        own *= raised**2
        covariance = own_spread(response, own)
        variance = float(np.median(own * np.square(known.weights)))
        by_camera = PixelResponse(seen, known.pixels, response, moves)
    for rival, likely in zip(fit.minima[1:], odds[1:], strict=False):
        if rotation_between(best, rival) <= FAR_ROTATION:
            turn = Rotation.from_quat(best[:4]).inv() * Rotation.from_quat(rival[:4])
            gap = np.concatenate((rival[4:7] - best[4:7], turn.as_rotvec()))
            covariance += likely / odds.sum() * np.outer(gap, gap)
    lacking = pose_stretch(known, weights, fit.minima[: len(odds)], variance * inverse, variance)
    return PoseSpread(covariance + lacking, by_camera, raised)


def pose_residuals(known: KnownPixels, minimum: FloatArray) -> FloatArray:
    """Return projection minus pixel (n, 2) [px]; NaN outside the domain."""
    residuals = np.empty_like(known.pixels)
    write_pose_residuals(known.parameters, known.points, known.pixels, minimum[:4], minimum[4:7], residuals)
    return residuals


def _without_pose(
    n: int,
    status: PoseStatus,
    message: str,
    poses: FloatArray,
    odds: tuple[float, ...],
    started: float,
) -> PoseEstimate:
    return PoseEstimate(
        status=status,
        message=message,
        minima=poses,
        odds=odds,
        covariance=np.full((6, 6), math.nan),
        inliers=np.zeros(n, dtype=np.bool_),
        rms_px=math.nan,
        noise_px=math.nan,
        residuals_px=np.full((n, 2), math.nan),
        seconds=time.perf_counter() - started,
    )
