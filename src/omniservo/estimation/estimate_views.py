"""Motion and structure from two views or more."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from omniservo.cameras import UnifiedCamera
from omniservo.cameras.conversion import unified_image
from omniservo.cameras.models import CentralModel
from omniservo.errors import InputError
from omniservo.estimation.known_displacements import DisplacementPrior
from omniservo.estimation.multi_view_estimate import MultiViewEstimate, ViewStatus
from omniservo.estimation.refinement.motion_search import LEAST_NOISE_PX
from omniservo.estimation.refinement.view_adjustment import ViewProblem, ViewState, adjust
from omniservo.estimation.robust.pose_search import GATE, PRIOR_NOISE_PX, PRIOR_WEIGHT
from omniservo.estimation.status.evidence import largest_noise
from omniservo.estimation.uncertainty.adjusted_views import AdjustedViews, error_of
from omniservo.estimation.uncertainty.calibration_response import calibration_directions, pixel_slopes
from omniservo.estimation.uncertainty.view_noise import view_noise
from omniservo.estimation.uncertainty.view_uncertainty import (
    ModelErrors,
    ViewResponse,
    ViewUncertainty,
)
from omniservo.estimation.view_points import CheckedPoints, ViewPoints
from omniservo.estimation.view_poses import (
    LEAST_POINTS,
    PlacedViews,
    place_all,
    place_by_displacements,
    place_by_known_points,
    place_linked,
    place_others,
    pose_of,
    residuals_of,
)
from omniservo.estimation.view_scale import GaugeLength, ViewScale, checked_scale
from omniservo.geometry.arrays import BoolArray, FloatArray, finite_number, owned

ADJUSTING_STEPS = 100
GATING_ROUNDS = 8

SETTLED_NOISE = 0.02
"""The weights stay once σ changes by less than this part."""

SETTLED_PX = 0.005
"""What the camera's parameters do is linearised anew until pixels change by less."""

LEAST_OF_VIEW = 3
"""pixels that agree, of a view that no displacement holds"""


def estimate_views(
    camera: CentralModel,
    pixels: npt.ArrayLike | ViewPoints,
    *,
    visible: npt.ArrayLike | None = None,
    scale: ViewScale = None,
    scale_sigma: float = 0.0,
    robust: bool = True,
    noise: float | npt.ArrayLike | None = None,
    calibration_covariance: npt.ArrayLike | None = None,
) -> MultiViewEstimate:
    """Return the poses of v views and the points they see, which minimise Σ ‖π(Rᵀ(h − t)) − p‖²/σ².

    The two views that tell most of the structure (`estimate_two_view`), the others by the points found so far
    (`estimate_pose`), bundle adjustment of all, pixels far from it left out. Where four or more points are
    known (`KnownPoints`), the views stand by these, and may be as flat as a tag. Known displacements
    (`KnownDisplacements`) and a camera whose parameters are uncertain are adjusted with the rest. The frame
    is that of the first view that has a pose.

    Args:
        camera: took all images; of any model. Its ``model_error`` is the same in all of them, so that views
            do not average it out.
        pixels: (v, n, 2) [px], [i, j] shows point j in view i; or `ViewPoints`.
        visible: (v, n) bool: the pixels of others are not read. None: all.
        scale: None: the centres of the first two views are 1 apart, not metric. A number: their distance [m].
            ((i, j), d): the distance of the points i and j [m]. `ViewDistance`: that of any two views'
            centres. `KnownPoints`: points with known coordinates. `KnownDisplacements`: of the camera between
            some views, with their covariance. A group of `KnownPoints` of less than half or more than twice
            its size by all groups together is "not_converged".
        scale_sigma: relative standard deviation of that.
        robust: leave out pixels that do not agree with the others or are outside the camera's domain.
        noise: σ of a pixel coordinate [px], one number or (v, n); None: from the residuals.
        calibration_covariance: (5, 5) or (9, 9), as `Calibration.covariance`: the camera's parameters are
            adjusted too, as far as that allows (`MultiViewEstimate.camera_shift`). None: they are exact.

    Raises:
        InputError: shapes, numbers that are not finite, illegal scale, most pixels outside the camera's
            domain (not robust: one).
    """
    started = time.perf_counter()
    image = unified_image(camera)
    given = CheckedPoints.of(image, _points_of(pixels, visible, noise), robust)
    shape = given.seen.shape
    length = checked_scale(scale, *shape)
    relative = finite_number("scale_sigma", scale_sigma, minimum=0.0)
    if calibration_covariance is not None:
        image.refuse_parameters("calibration_covariance")
    directions = calibration_directions(image.camera, calibration_covariance)
    work = _Adjustment(image.camera, given, directions, length, robust)
    status, words = work.place()
    if status != "ok":
        return MultiViewEstimate.without_pose(shape, status, words, started, work.reasons())
    problem = work.adjust()
    if not problem:
        problem = work.to_scale()
    found = None if problem else work.concluded(relative, started)
    if found is None:
        problem = problem or "the views do not determine the motion"
        return MultiViewEstimate.without_pose(shape, "not_converged", problem, started, work.reasons())
    return found


def _points_of(pixels: Any, visible: Any, noise: Any) -> ViewPoints:
    if not isinstance(pixels, ViewPoints):
        return ViewPoints(pixels, visible, noise)
    if visible is not None or noise is not None:
        raise InputError("visible, noise: given beside ViewPoints, which has both")
    return pixels


class _Adjustment:
    """The views, as they are placed, adjusted and judged."""

    def __init__(
        self,
        camera: UnifiedCamera,
        given: CheckedPoints,
        directions: FloatArray,
        length: GaugeLength | DisplacementPrior,
        robust: bool,
    ) -> None:
        self.directions, self.length, self.robust = directions, length, robust
        self.by_camera = np.zeros((*given.pixels.shape, len(directions)))
        self.deviation = np.zeros(len(directions))
        self.views = PlacedViews.of(camera, given, 0.0)
        self._linearise_camera()
        room = math.sqrt(float(np.square(self.by_camera).sum()) / max(2 * given.seen.sum(), 1))
        self.views.room_px = room
        self.sigma = np.ones(given.seen.shape)
        self.linked: set[int] = set()

    @property
    def prior(self) -> DisplacementPrior | None:
        """The displacements, if there are any."""
        return self.length if isinstance(self.length, DisplacementPrior) else None

    def reasons(self) -> dict[int, str]:
        """Why views have no pose."""
        return self.views.failed

    def place(self) -> tuple[Any, str]:
        """Place all views and return "ok", or status and evidence."""
        views, prior = self.views, self.prior
        if isinstance(self.length, GaugeLength) and place_by_known_points(views, self.length):
            place_others(views)
        else:
            status, words = place_all(views, self.robust)
            if status != "ok" and (prior is None or not place_by_displacements(views, prior)):
                return status, words
        first = int(np.argmax(views.placed))
        self._to_view(first)
        if prior is not None:
            rows = np.flatnonzero(views.placed)
            known = prior.among(rows)
            factor = math.nan if known is None else known.scale_of(views.poses[rows])
            if not factor > 0.0:
                words = "no two views that are joined have a known displacement: the scale is not known"
                return "not_converged", words
            views.poses[:, 4:] *= factor
            views.points *= factor
            self.linked = set(place_linked(views, prior))
            self._to_view(int(np.argmax(views.placed)))
            views.triangulate()
            self._agree_with_displacements(prior)
        return "ok", ""

    def _agree_with_displacements(self, prior: DisplacementPrior) -> None:
        """Mark the pixels, of views that stand by displacements alone, that lie where these allow it."""
        views, stated = self.views, self.views.noise()
        residuals = np.linalg.norm(residuals_of(views), axis=2)
        for view in self.linked:
            pose = views.poses[view]
            local = pose_of(pose).inv().apply(views.points)
            known = ~np.isnan(local[:, 0])
            away = np.linalg.norm(local, axis=1)
            _, slopes, _ = views.camera.project_jacobian(local)
            shift, turn = prior.sigmas_of(view)
            angle = np.hypot(shift / away, turn)
            room = np.linalg.norm(slopes, axis=(1, 2)) * away * angle
            sigma = PRIOR_NOISE_PX if stated is None else stated[view]
            views.agree[view] = views.seen[view] & known & (residuals[view] <= GATE * np.hypot(sigma, room))

    def _to_view(self, view: int) -> None:
        """Change the frame of poses and points to that of a view."""
        views = self.views
        first = pose_of(views.poses[view]).inv()
        for at in np.flatnonzero(views.placed):
            pose = first * pose_of(views.poses[at])
            views.poses[at, :4], views.poses[at, 4:] = pose.rotation.as_quat(), pose.translation
        views.points[:] = first.apply(views.points)

    def adjust(self) -> str:
        """Refine on the pixels that agree; return what went wrong, or nothing."""
        views, stated = self.views, self.views.noise()
        usable = views.agree.copy() if self.robust else views.seen & views.placed[:, None]
        relative = self.prior is None and not len(self.directions)  # only ratios of weights matter
        self.sigma = (
            np.full(views.seen.shape, 1.0 if relative else PRIOR_NOISE_PX) if stated is None else stated
        )
        self._linearise_camera()
        for _ in range(GATING_ROUNDS):
            usable = usable & (~np.isnan(views.points[:, 0]) & (usable.sum(axis=0) >= 2))[None, :]
            if words := self._too_few(usable):
                return words
            if words := self._adjust_once(usable):
                return words
            if self.robust:
                views.regain()
            residuals = self._residuals()
            distance = np.linalg.norm(residuals, axis=2)
            gate = GATE * self._gate_noise((distance / self.sigma)[usable], usable)
            near = views.seen & views.placed[:, None] & (distance <= gate * self.sigma)
            if words := self._too_noisy(distance, usable & near if self.robust else usable):
                return words
            settled = not self.robust or (near == usable).all()
            settled &= self._linearise_camera() < SETTLED_PX
            if stated is None and not relative:
                settled &= self._reweighted(self._noise(distance / self.sigma, usable))
            if settled:
                break
            usable = near if self.robust else usable
        views.points[~views.agree.any(axis=0)] = math.nan
        return ""

    def _too_noisy(self, distance: FloatArray, kept: BoolArray) -> str:
        """Return that the pixels that are kept leave more noise than can be; what is left out is no noise."""
        stated = self.views.noise()
        noise = self._noise(distance / self.sigma, kept)
        if noise <= largest_noise(None if stated is None else 1.0):
            return ""
        px = noise if stated is None else noise * float(np.median(stated[kept]))
        return f"the best structure leaves {px:.2g} px of noise: the pixels do not agree"

    def _reweighted(self, ratio: float) -> bool:
        """Take σ from residuals that are ``ratio`` of what it was; tell whether it stays."""
        error = self.views.camera.model_error
        sigma = max(ratio * self.sigma.flat[0], LEAST_NOISE_PX)
        sigma = math.hypot(sigma, 0.0 if error is None else error.sigma_px)
        stays = abs(sigma / self.sigma.flat[0] - 1.0) < SETTLED_NOISE
        self.sigma = np.full_like(self.sigma, sigma)
        return bool(stays)

    def _too_few(self, usable: BoolArray) -> str:
        of_views = usable.sum(axis=1)
        held = [view in self.linked for view in range(len(of_views))]
        lone = self.views.placed & (of_views < LEAST_OF_VIEW) & ~np.array(held)
        if usable.sum() * 2 <= self._unknowns(usable) or lone.any():
            return "too few pixels agree with each other"
        return ""

    def _unknowns(self, usable: BoolArray) -> int:
        return 6 * (int(self.views.placed.sum()) - 1) - 1 + 3 * int(usable.any(axis=0).sum())

    def _linearise_camera(self) -> float:
        """Take ∂π/∂θ where the stated camera would show the points; return what that changes [px].

        Where a pixel was seen would not do: its noise would count as smaller in a camera that draws smaller.
        """
        views, directions = self.views, self.directions
        if not len(directions):
            return 0.0
        before = self.by_camera @ self.deviation
        bearings = views.given.bearings.copy()
        known = ~np.isnan(views.points[:, 0])
        for view in np.flatnonzero(views.placed):
            bearings[view, known] = pose_of(views.poses[view]).inv().apply(views.points[known])
        slopes = pixel_slopes(views.camera, bearings, directions.shape[1]) @ directions.T
        self.by_camera = np.where(views.seen[:, :, None, None], slopes, 0.0)
        return float(np.abs(self.by_camera @ self.deviation - before).max(initial=0.0))

    def _residuals(self) -> FloatArray:
        """Return projection minus pixel (v, n, 2) [px], the camera's deviation taken off."""
        return residuals_of(self.views) + self.by_camera @ self.deviation

    def _problem(self, order: Any, rows: Any) -> ViewProblem:
        """Return what is measured of these views and points, of the pixels that agree."""
        views = self.views
        weights = np.where(views.agree, 1.0 / self.sigma, 0.0)
        prior = None if self.prior is None else self.prior.among(order)
        kept = np.ix_(order, rows)
        return ViewProblem(views.camera, views.pixels[kept], weights[kept], self.by_camera[kept], prior)

    def _adjust_once(self, usable: BoolArray) -> str:
        views = self.views
        order, rows = np.flatnonzero(views.placed), np.flatnonzero(usable.any(axis=0))
        views.agree[:] = usable
        problem = self._problem(order, rows)
        if problem.prior is None and not np.abs(views.poses[order][:, 4:]).max() > 0.0:
            return "all views have one centre"
        state = ViewState(views.poses[order], views.points[rows], self.deviation)
        _, converged, state = adjust(problem, state, ADJUSTING_STEPS)
        if not converged:
            return "the bundle adjustment found no minimum"
        views.poses[order], self.deviation = state.poses, state.deviation
        views.points[:] = math.nan
        views.points[rows] = state.points
        return ""

    def _noise(self, whitened: FloatArray, usable: BoolArray) -> float:
        """Return σ of the whitened coordinates, from the residuals."""
        freedom = max(2 * int(usable.sum()) - self._unknowns(usable), 1)
        return math.sqrt(float(np.square(whitened[usable]).sum()) / freedom)

    def _gate_noise(self, distances: FloatArray, usable: BoolArray) -> float:
        """Return σ of the whitened coordinates for the gate, from the median distance and a prior."""
        freedom = max(2 * len(distances) - self._unknowns(usable), 1)
        square = float(np.median(distances)) ** 2 / (2.0 * math.log(2.0)) * 2 * len(distances)
        if self.views.given.noise is not None:
            return max(1.0, math.sqrt(square / freedom) if freedom > len(distances) / 2 else 0.0)
        prior = (PRIOR_NOISE_PX / self.sigma.flat[0]) ** 2
        return math.sqrt((PRIOR_WEIGHT * prior + square) / (PRIOR_WEIGHT + freedom))

    def to_scale(self) -> str:
        """Scale poses and points to the known length; return what went wrong, or nothing."""
        views, length = self.views, self.length
        if isinstance(length, DisplacementPrior):
            return ""
        if length.metres is None:
            length = self.length = replace(length, indices=np.flatnonzero(views.placed)[:2])
        lost = length.indices[
            ~views.placed[length.indices] if length.of_views else np.isnan(views.points[length.indices, 0])
        ]
        if len(lost) and not (len(length.known) and len(length.indices) - len(lost) >= 2):
            what = "view" if length.of_views else "point"
            return f"{what} {lost[0]}, which the scale refers to, has no place"
        used = length.without(lost)
        value = used.value(views.poses[:, 4:], views.points)
        if not value > 0.0:
            return "the length that the scale refers to is 0"
        factor = (2.0**-0.5 if used.metres is None else used.metres) / value
        views.poses[:, 4:] *= factor
        views.points *= factor
        return used.contradiction(views.points)

    def concluded(self, scale_sigma: float, started: float) -> MultiViewEstimate | None:
        """Return the answer; None where the views do not determine the motion."""
        views = self.views
        order, rows = np.flatnonzero(views.placed), np.flatnonzero(views.agree.any(axis=0))
        problem = self._problem(order, rows)
        state = ViewState(views.poses[order], views.points[rows], self.deviation)
        response = ViewResponse.at(problem, state)
        if response is None:
            return None
        errors = ModelErrors.of(error_of(views.camera), problem, response)
        stated, window = views.given.noise, views.given.window
        own = None if stated is None else (stated / self.sigma)[views.agree]
        noise = view_noise(float(np.square(response.slopes.residuals).sum()), problem, response, errors, own)
        length = None if isinstance(self.length, DisplacementPrior) else self.length.among(order, rows)
        window = None if window is None else window[np.ix_(order, rows)]
        adjusted = AdjustedViews(problem, state, length, noise, window, self.directions)
        return self._answer(adjusted.law_of(response, errors), adjusted, (scale_sigma, started))

    def _answer(
        self, law: ViewUncertainty, adjusted: AdjustedViews, said: tuple[float, float]
    ) -> MultiViewEstimate:
        views, noise, (scale_sigma, started) = self.views, adjusted.noise, said
        (v, n), order = views.seen.shape, np.flatnonzero(views.placed)
        rows = np.flatnonzero(views.agree.any(axis=0))
        covariance = np.full((v, 6, 6), math.nan)
        covariance[order[0]] = 0.0
        for rank, view in enumerate(order[1:], start=1):
            g = np.concatenate((views.poses[view, 4:], np.zeros(3)))
            covariance[view] = law.pose_covariance(rank) + scale_sigma**2 * np.outer(g, g)
        points_covariance = np.full((n, 3, 3), math.nan)
        h = views.points[rows]
        spread = scale_sigma**2 * h[:, :, None] * h[:, None, :]
        points_covariance[rows] = law.point_covariances() + spread
        residuals = self._residuals()
        square, count = float((residuals[views.agree] ** 2).sum()), int(views.agree.sum())
        unit = float(np.median(self.sigma[views.agree]))
        status, reasons = self._view_statuses()
        words = [noise.words] if noise.words else []
        if order[0] != 0:
            words.append(f"the frame is that of view {order[0]}")
        words += [f"view {view} has no pose: {why}" for view, why in enumerate(reasons) if why]
        return MultiViewEstimate(
            status="ok",
            message="; ".join(words),
            initial_T_views=tuple(
                pose_of(views.poses[view]) if views.placed[view] else None for view in range(v)
            ),
            points=owned(views.points),
            is_metric=not isinstance(self.length, GaugeLength) or self.length.metres is not None,
            covariance=owned(covariance),
            points_covariance=owned(points_covariance),
            inliers=views.agree,
            rms_px=math.sqrt(square / count),
            noise_px=unit * noise.from_residuals,
            residuals_px=owned(residuals),
            scale_sigma=scale_sigma,
            freedom=noise.freedom,
            uncertainty=law,
            sigma_px=unit * noise.sigma,
            seconds=time.perf_counter() - started,
            view_status=status,
            view_reasons=reasons,
            camera_shift=owned(self.deviation @ self.directions),
            adjusted=adjusted,
        )

    def _view_statuses(self) -> tuple[tuple[ViewStatus, ...], tuple[str, ...]]:
        statuses: list[ViewStatus] = []
        reasons = []
        for view, placed in enumerate(self.views.placed):
            seen = int(self.views.agree[view].sum())
            if not placed:
                few = int(self.views.seen[view].sum()) < LEAST_POINTS
                statuses.append("too_few_points" if few else "no_pose")
                reasons.append(self.views.failed.get(view, "it shares too few points with the others"))
            else:
                statuses.append("by_displacement" if view in self.linked and seen < LEAST_OF_VIEW else "ok")
                reasons.append("")
        return tuple(statuses), tuple(reasons)
