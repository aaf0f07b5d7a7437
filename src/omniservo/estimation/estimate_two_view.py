"""Motion and structure from two views."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import RigidTransform

from omniservo.cameras.conversion import UnifiedImage, unified_image
from omniservo.cameras.models import CentralModel
from omniservo.errors import InputError
from omniservo.estimation.deferred import changed, later
from omniservo.estimation.estimate_planar import estimate_planar
from omniservo.estimation.matches import Matches, on_virtual_plane
from omniservo.estimation.minimal_solvers.essential_matrix import linear_structure, mark_in_front
from omniservo.estimation.outside_domain import among_all, first_of_equal, in_domain
from omniservo.estimation.refinement.joint_refinement import refine_jointly, residual_sums, write_residuals
from omniservo.estimation.refinement.motion_search import FEW_POINTS
from omniservo.estimation.robust.members import MOTION_PARAMETERS
from omniservo.estimation.robust.rival_motions import with_rivals
from omniservo.estimation.robust.two_view_fit import (
    EIGHT_POINTS,
    LEAST_POINTS,
    TwoViewFit,
    fit_two_views,
    sharper_fit,
)
from omniservo.estimation.robust.vouched_fit import vouched_fit
from omniservo.estimation.status.evidence import is_only_noisier, judge
from omniservo.estimation.status.heavy_tails import tail_of
from omniservo.estimation.status.square_evidence import fit_squares
from omniservo.estimation.status.two_motions import Judged, judge_others, two_of
from omniservo.estimation.two_view_estimate import TwoViewEstimate
from omniservo.estimation.two_view_input import (
    check_choice,
    checked_noise,
    checked_pixels,
    checked_scale,
    checked_squares,
    checked_windows,
)
from omniservo.estimation.two_view_request import FEW_TO_RAISE, TwoViewRequest
from omniservo.estimation.uncertainty.first_order import determines_motion, linear_response
from omniservo.estimation.uncertainty.joint_uncertainty import JointUncertainty
from omniservo.estimation.uncertainty.shared_camera_error import pixel_noise
from omniservo.estimation.uncertainty.sure_region import Others
from omniservo.estimation.uncertainty.two_view_uncertainty import (
    Lens,
    Noise,
    Responses,
    Solution,
    total_covariances,
    two_view_uncertainty,
)
from omniservo.geometry.arrays import BoolArray, FloatArray, owned
from omniservo.geometry.quaternions import CAYLEY, QUATERNION

Scale = float | tuple[tuple[int, int], float]

METHODS = ("pixel", "virtual-plane", "homography")
ROTATIONS = {"quaternion": QUATERNION, "cayley": CAYLEY}
MOST_STEPS = 100


RAISE = 2.0
"""Before a real camera's matches that do not agree are refused, their noise is raised by this factor."""

UNDETERMINED = "the matches do not determine the motion"
NO_MINIMUM = "the refinement on the virtual plane found no minimum"

CONTRADICTED = "the residuals contradict the stated errors of pixels and camera"

MOST_OF_SQUARES_PX = 1.0
"""Squares are known one by one: noise far beyond what is stated, but no more than this, is accepted."""

ONE_WRONG = "one of so few may be a wrong match that decides the motion: more are needed"


def estimate_two_view(
    camera: CentralModel,
    pixels_initial: npt.ArrayLike,
    pixels_goal: npt.ArrayLike,
    *,
    scale: Scale | None = None,
    method: Literal["pixel", "virtual-plane", "homography"] = "pixel",
    rotation: Literal["quaternion", "cayley"] = "quaternion",
    robust: bool = True,
    noise: float | npt.ArrayLike | None = None,
    scale_sigma: float = 0.0,
    calibration_covariance: npt.ArrayLike | None = None,
    squares: npt.ArrayLike | None = None,
    windows: npt.ArrayLike | None = None,
) -> TwoViewEstimate:
    """Return the pose of the goal camera and the points, from the same points' pixels in two images.

    Eight-point algorithm on bearings from several starts (five to seven matches: all five-point solutions;
    wrong matches: samples of five), cheirality by distances, linear structure, joint refinement of
    s = (s_R, s_t, s_h₁ … s_hₙ), (13)-(22). Directions past 90° from the axis are members.

    Args:
        camera: took both images; of any model (`UnifiedImage`).
        pixels_initial: (n, 2) [px].
        pixels_goal: (n, 2) [px], row j shows the same point.
        scale: None: ‖t‖ = 1, not metric. A number: the distance of the two camera centres [m]. ((i, j), d):
            the distance of the target points i and j [m]. t and every point are scaled together.
        method: "pixel" minimises the reprojection error in the real image, the maximum-likelihood cost;
            "virtual-plane" that of the paper, (19), which needs every pixel within 90° of the axis. Members
            and status are decided on the real image for both. "homography": the target is a plane; four
            matches will do, and "pixel" refuses it.
        rotation: s_R as quaternion (17), (20) or Cayley vector (18), (21); the answer is the same.
        robust: reject matches that do not agree with the others, those outside the camera's domain, and
            all but the first of equal ones, which say nothing new.
        noise: σ of a pixel coordinate [px], one number, or (n, 2): of point j in the initial and in the goal
            image. Residuals are then weighted by 1/σ, and statuses and covariance rest on it. None: every
            pixel is as good as any other, and σ comes from the residuals; of fewer than eight matches 0.5.
        scale_sigma: standard deviation of the stated scale over the scale.
        calibration_covariance: (5, 5) or (9, 9), as `Calibration.covariance`. None: as the camera states it.
        squares: (m, 4) matches that are the corners of a square of unknown size, as of a tag, in order round
            it. Where they are no square under the motion, one was taken for another: it is left out. Method
            "homography" does not use them. None: nothing is known of the target.
        windows: (n,) standard deviation [px] of the window in the initial image that each match was measured
            in (`MatchedPoints.window`); where they overlap, matches err alike. None: each errs by itself.

    Raises:
        InputError: shapes, illegal numbers, most pixels outside the camera's domain (not robust: one), or one
            without virtual image.
    """
    started = time.perf_counter()
    image = unified_image(camera)
    pixels, px = checked_pixels(image, pixels_initial, pixels_goal)
    fixed = checked_scale(scale, scale_sigma, len(pixels))
    check_choice("method", method, METHODS)
    check_choice("rotation", rotation, tuple(ROTATIONS))
    lens, sigmas = Lens.of(image, calibration_covariance), checked_noise(noise, px)
    known = checked_squares(squares, len(pixels)), checked_windows(windows, px)
    request = TwoViewRequest(ROTATIONS[rotation], *fixed, scale_sigma, lens, *known, sigmas)
    return _estimate_inside(image, pixels, method, robust, request, started)


def _estimate_inside(
    image: UnifiedImage,
    pixels: FloatArray,
    method: str,
    robust: bool,
    request: TwoViewRequest,
    started: float,
) -> TwoViewEstimate:
    """Estimate; ``robust``: of equal matches from the first, and from those in the camera's domain."""
    if robust:
        first = first_of_equal(pixels)
        rows = first == np.arange(len(pixels))
        if not rows.all():
            return _estimate_part(image, pixels, method, request.at(first), rows, started)
    try:
        return _estimate(image, pixels, method, robust, request, started)
    except InputError:
        inside = in_domain(image.own, pixels[:, :2], pixels[:, 2:]) if robust else None
        if inside is None or inside.all():
            raise
    lost = request.rejected(inside)
    if lost is not None:
        words = f"point {lost}, which the scale refers to, is outside the camera's domain"
        return TwoViewEstimate.without_pose(len(pixels), "not_converged", words, started)
    return _estimate_part(image, pixels, method, request, inside, started)


def _estimate_part(
    image: UnifiedImage,
    pixels: FloatArray,
    method: str,
    request: TwoViewRequest,
    rows: BoolArray,
    started: float,
) -> TwoViewEstimate:
    """Estimate robustly from the chosen rows; the others are rejected."""
    chosen, left = pixels[rows], request.where(rows)
    if left.noise is None:  # so few may be left that they do not tell it
        left = left._replace(
            noise=checked_noise(None, checked_pixels(image, chosen[:, :2], chosen[:, 2:])[1])
        )
    return among_all(_estimate_inside(image, chosen, method, True, left, started), rows)


def _estimate(
    image: UnifiedImage,
    pixels: FloatArray,
    method: str,
    robust: bool,
    request: TwoViewRequest,
    started: float,
) -> TwoViewEstimate:
    """Estimate from the camera's own pixels (n, 4) by one of `METHODS`."""
    views = (image.inside("pixels_initial", pixels[:, :2]), image.inside("pixels_goal", pixels[:, 2:]))
    noise = None if request.noise is None else request.lens.whole_noise(request.noise)
    matches = Matches.of_pixels(image.camera, np.concatenate(views, axis=1), noise)
    if method == "homography":
        return estimate_planar(matches, robust, request, started)
    plane = on_virtual_plane(image.camera, matches) if method == "virtual-plane" else None
    return _estimate_few(matches, plane, robust, request, started)


def _estimate_general(
    matches: Matches,
    plane: tuple[Matches, FloatArray] | None,
    robust: bool,
    request: TwoViewRequest,
    started: float,
) -> TwoViewEstimate:
    """Estimate a target that need not be a plane; ``plane`` is what `on_virtual_plane` returns."""
    if matches.size < LEAST_POINTS:
        words = f"{matches.size} matches given; at least {LEAST_POINTS} are needed"
        return TwoViewEstimate.without_pose(matches.size, "too_few_points", words, started)
    gates = matches  # by whose noise members are chosen and judged
    by_squares, against = robust and len(request.squares) > 0, ""
    if by_squares:
        fit, against = fit_squares(matches, request.squares, request.kind)
    else:
        fit = fit_two_views(matches, request.kind, robust)
        if fit is not None and matches.size > FEW_POINTS and request.may_raise(robust):
            gates, fit = sharper_fit(matches, fit, request.kind, request.own_px)
    if fit is None:
        words = f"fewer than {EIGHT_POINTS} of the {matches.size} matches agree"
        return TwoViewEstimate.without_pose(matches.size, "too_few_points", words, started)
    lens = request.lens
    status, words = judge(fit, gates, robust, lens)
    if status == "ok" and against:
        return TwoViewEstimate.without_pose(matches.size, "not_converged", against, started)
    if status in ("ok", "not_converged") and not by_squares:
        wider = with_rivals(gates, fit, request.kind, robust)
        if wider is not fit:
            fit = wider
            status, words = judge(fit, gates, robust, lens)
    if status == "not_converged" and request.may_raise(robust) and is_only_noisier(fit, gates, lens):
        return _estimate_general(matches.noisier(RAISE), plane, robust, request.noisier(RAISE), started)
    vouched = vouched_fit(gates, fit, request.kind) if status == "ok" and robust and not by_squares else fit
    if vouched is None:
        words = f"fewer than {EIGHT_POINTS} of the {matches.size} matches agree and vouch for each other"
        return TwoViewEstimate.without_pose(matches.size, "too_few_points", words, started)
    if vouched is not fit:
        fit = vouched
        status, words = judge(fit, gates, robust, lens)
    judged = Judged(status, words, two_of(fit, status))
    if status == "ok" and robust and not by_squares:
        judged = judge_others(gates, fit, request.kind, lens.sigma_px)
    if judged.status != "ok":
        both = tuple(_pose(m.rotation, m.translation) for m in judged.motions)
        return TwoViewEstimate.without_pose(matches.size, judged.status, judged.words, started, both)
    return _with_pose(matches, plane, fit, judged.doubts, request, started)


def _estimate_few(
    matches: Matches,
    plane: tuple[Matches, FloatArray] | None,
    robust: bool,
    request: TwoViewRequest,
    started: float,
) -> TwoViewEstimate:
    """Estimate; few matches of a real camera with the pixels' own noise in gates first.

    What the camera's error allows a match, motion and structure mostly absorb. In gates it is room for a
    wrong match, which of few decides the motion. It is given where they agree in no other way. Squares that
    all agree but for more noise than is stated, of a camera that is said to be exact, are judged by the noise
    that they show.
    """
    if matches.size <= FEW_POINTS and request.may_raise(robust) and not len(request.squares):
        narrow = matches.noisier(request.own_px / matches.noise_px)
        found = _estimate_general(narrow, plane, robust, request._replace(is_last=True), started)
        if (found.status == "ok" and not found.message) or found.status == "ambiguous":
            return found
    found = _estimate_general(matches, plane, robust, request, started)
    if found.status != "not_converged" or not request.may_forget(robust):
        return found
    unknown = request._replace(noise=None, is_last=True)
    again = _estimate_general(matches._replace(noise_px=0.0), plane, robust, unknown, started)
    if again.status != "ok" or not again.inliers.all() or again.noise_px > MOST_OF_SQUARES_PX:
        return found
    words = f"{CONTRADICTED}, which are taken {again.noise_px / matches.noise_px:.2g} times as large"
    return changed(again, message=words)


def _with_pose(
    matches: Matches,
    plane: tuple[Matches, FloatArray] | None,
    fit: TwoViewFit,
    doubts: tuple[TwoViewFit, ...],
    request: TwoViewRequest,
    started: float,
) -> TwoViewEstimate:
    """Finish a fit that is a pose: the chosen cost, the scale, residuals, uncertainty."""
    lost = request.rejected(fit.members)
    if lost is not None:
        words = f"point {lost}, which the scale refers to, was rejected as a wrong match"
        return TwoViewEstimate.without_pose(len(matches.pixels), "not_converged", words, started)
    members, best, n = matches.where(fit.members), fit.minima[0], len(matches.pixels)
    rotation, translation, structure = best.rotation.copy(), best.translation.copy(), best.points.copy()
    chosen = members
    if plane is not None:
        chosen = plane[0].where(fit.members)
        if not _refined(chosen, request.kind, rotation, translation, structure):
            return TwoViewEstimate.without_pose(n, "not_converged", NO_MINIMUM, started)
    solution, length = Solution(rotation, translation, structure), request.length(fit.members)
    arrays = (chosen.parameters, chosen.pixels, chosen.weights)
    if not determines_motion(*arrays, *solution):
        return TwoViewEstimate.without_pose(n, "not_converged", UNDETERMINED, started)
    points, residuals = _all_points(matches, fit, *solution), np.empty_like(matches.pixels)
    write_residuals(matches.parameters, matches.pixels, rotation, translation, points, residuals)
    square, weighted = residual_sums(residuals, matches.weights, fit.members)
    known, shares, raised, words = _noise(matches, fit, request, weighted)
    if words and members.size < FEW_TO_RAISE:
        return TwoViewEstimate.without_pose(n, "not_converged", f"{words}; {ONE_WRONG}", started)
    lens, metres = request.lens._replace(factor=raised), length.of_translation(structure)
    translation, points = metres * translation, metres * points

    def law() -> JointUncertainty:
        seen = np.tile(np.eye(2).ravel(), (members.size, 2)) if plane is None else plane[1][fit.members]
        response = linear_response(*arrays, seen, *solution, length.between)
        own = None if shares is None else linear_response(*arrays, seen * shares, *solution, length.between)
        alone = response if own is None else own
        sigmas = known, known.shared_by(alone.motion, members, request.windows_of(fit.members))
        both = Responses(response, alone)
        others = Others.of(matches, fit, doubts) if plane is None else None
        return two_view_uncertainty(members, others, both, solution, *sigmas, length, lens)

    uncertain = _Uncertainty(law, request.scale_sigma, translation, points, fit.members)
    return TwoViewEstimate(
        status="ok",
        message=words,
        initial_T_goal=_pose(rotation, translation),
        points=owned(points),
        is_metric=request.metres is not None,
        covariance=later(uncertain.of_motion),
        points_covariance=later(uncertain.of_points),
        inliers=fit.members.copy(),
        rms_px=math.sqrt(square / (2 * members.size)),
        noise_px=math.sqrt(weighted / max(members.size - MOTION_PARAMETERS, 1)),
        residuals_px=owned(residuals),
        seconds=time.perf_counter() - started,
        scale_sigma=request.scale_sigma,
        uncertainty=later(uncertain.joint),
    )


def _noise(
    matches: Matches, fit: TwoViewFit, request: TwoViewRequest, weighted: float
) -> tuple[Noise, FloatArray | None, float, str]:
    """Return what the members' Σ w²r² [px²], and rejected matches that belong to it, tell of the noise.

    Beside it what part of their σ (m, 8) is the pixels' own, None: all; by which factor stated errors are
    raised; and a sentence that says so.
    """
    members, best = matches.where(fit.members), fit.minima[0]
    freedom = members.size - MOTION_PARAMETERS
    sigma = math.sqrt(max(weighted / max(freedom, 1), matches.noise_px**2))
    tail, more = tail_of(matches, fit, sigma)
    known = Noise.of(weighted + tail, freedom + more, matches.noise_px or None)
    if request.lens.error is None:
        return known, None, 1.0, ""
    stated = None if request.noise is None else request.noise[fit.members]
    moves = request.lens.moves(members)
    found = pixel_noise(members, (best.rotation, best.translation), moves, stated, weighted)
    shares, raised = np.repeat(found.shares, 4, axis=1), found.raised * request.raised
    if raised == 1.0:
        return known, shares, 1.0, ""
    words = f"{CONTRADICTED}, which are taken {raised:.2g} times as large"
    return Noise(matches.noise_px**2, float(freedom)), shares, raised, words


@dataclass
class _Uncertainty:
    """Worked out once, when one of its parts is read: it takes longer than all before."""

    law: Callable[[], JointUncertainty]
    scale_sigma: float
    translation: FloatArray
    points: FloatArray
    members: BoolArray

    @cached_property
    def _joint(self) -> JointUncertainty:
        return self.law()

    def joint(self) -> JointUncertainty:
        return self._joint

    def of_motion(self) -> FloatArray:
        return owned(self._covariances[0])

    def of_points(self) -> FloatArray:
        return owned(self._covariances[1])

    @cached_property
    def _covariances(self) -> tuple[FloatArray, FloatArray]:
        return total_covariances(self._joint, self.scale_sigma, self.translation, self.points, self.members)


def _pose(rotation: FloatArray, translation: FloatArray) -> RigidTransform:
    """Return {R, t}; R is orthonormal to rounding, so the costly check of it is left out."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, translation
    return RigidTransform(matrix, normalize=False)


def _refined(
    matches: Matches, kind: int, rotation: FloatArray, translation: FloatArray, points: FloatArray
) -> bool:
    """Refine motion and structure in place; tell whether they converged."""
    _, converged = refine_jointly(
        matches.parameters,
        matches.pixels,
        matches.weights,
        kind,
        rotation,
        translation,
        points,
        MOST_STEPS,
    )
    return bool(converged)


def _all_points(
    matches: Matches, fit: TwoViewFit, rotation: FloatArray, translation: FloatArray, structure: FloatArray
) -> FloatArray:
    """Return (n, 3): members as refined, others by linear structure, NaN where their rays do not meet."""
    if fit.members.all():
        return structure
    points = np.empty((len(matches.pixels), 3))
    linear_structure(matches.bearings, rotation, translation, points)
    in_front = np.empty(len(points), dtype=np.bool_)
    mark_in_front(matches.bearings, rotation, translation, in_front)
    points[~in_front] = math.nan
    points[fit.members] = structure
    return points
