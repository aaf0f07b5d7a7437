"""Motion from two views of a target whose structure is known."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import RigidTransform

from omniservo.cameras import UnifiedCamera
from omniservo.cameras.conversion import unified_image
from omniservo.cameras.models import CentralModel
from omniservo.errors import InputError
from omniservo.estimation.estimate_pose import PoseSpread, known_pixels, pose_residuals, pose_spread
from omniservo.estimation.outside_domain import in_domain
from omniservo.estimation.pose_estimate import pose_of
from omniservo.estimation.robust.pose_fit import CHECKED_POINTS, LEAST_POINTS, KnownPixels, PoseFit, fit_pose
from omniservo.estimation.status.pose_evidence import (
    NEGLIGIBLE,
    far_rival,
    noise_of,
    odds_of,
    refusal,
    variance_of,
)
from omniservo.estimation.two_view_estimate import Status, TwoViewEstimate
from omniservo.estimation.uncertainty.camera_moves import CameraMoves
from omniservo.estimation.uncertainty.joint_uncertainty import JointUncertainty
from omniservo.geometry.arrays import (
    BoolArray,
    FloatArray,
    IntArray,
    finite_array,
    finite_number,
    owned,
    refuse_masked,
)

PICTURES = ("initial", "goal")

T1, R1, T2, R2 = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)
"""The places of the two poses' errors (12,): dt₁ [m], δ₁ [rad], dt₂, δ₂"""

HALF = 2
"""of a square's corners"""


@dataclass(frozen=True, eq=False)
class _View:
    """One image: its points, the fit, and where they stand among all points."""

    known: KnownPixels
    fit: PoseFit
    rows: BoolArray

    @property
    def cost(self) -> float:
        return float(self.fit.costs[0])

    @property
    def freedom(self) -> int:
        return 2 * int(self.fit.members.sum()) - 6


def estimate_known_target(
    camera: CentralModel,
    points: npt.ArrayLike,
    pixels_initial: npt.ArrayLike,
    pixels_goal: npt.ArrayLike,
    *,
    visible: npt.ArrayLike | None = None,
    robust: bool = True,
    noise: float | npt.ArrayLike | None = None,
    scale_sigma: float = 0.0,
    squares: IntArray | None = None,
) -> TwoViewEstimate:
    """Return the pose of the goal camera and the points, metric, from two images of a known target.

    The camera's pose by the target's points in either image, as `estimate_pose`, and initial_T_goal from
    both. The two poses are independent given the structure, so the mirrored pose of a plane in one image
    is judged by that image's cost; but σ, where it is not stated, is one number of both.

    Args:
        camera: took both images; of any model.
        points: (n, 3) [m] in the target's frame.
        pixels_initial: (n, 2) [px], row j shows point j.
        pixels_goal: (n, 2) [px].
        visible: (2, n) bool: points seen in the initial and the goal image; the pixels of others are not
            read. None: all.
        robust: reject points that do not agree with the others, and those outside the camera's domain.
        noise: σ of a pixel coordinate [px], one number, or (n, 2): of point j in either image.
        scale_sigma: relative standard deviation of the target's size: how well it was printed or measured.
        squares: (m, 4) points that are found together, as the corners of a tag: where half of them do not
            agree, none counts. None: every point stands for itself.

    Raises:
        InputError: shapes, numbers that are not finite, illegal noise, most pixels of an image outside the
            camera's domain (not robust: one).
    """
    started = time.perf_counter()
    target = finite_array("points", points, (None, 3))
    n = len(target)
    seen = _checked_visible(visible, n)
    sigmas = _checked_noise(noise, n)
    relative = finite_number("scale_sigma", scale_sigma, minimum=0.0)
    views: list[_View] = []
    outside = np.zeros(n, dtype=np.bool_)
    image = unified_image(camera)
    for place, pixels in enumerate((pixels_initial, pixels_goal)):
        name = f"pixels_{PICTURES[place]}"
        rows = np.asanyarray(pixels)  # a masked array stays one, and is refused where it is read
        if rows.shape != (n, 2):
            raise InputError(f"{name}: shape {rows.shape} given; {(n, 2)} is needed")
        use = _in_domain(camera, rows, seen[place], name) if robust else seen[place]
        outside |= seen[place] & ~use
        noise_px = None if sigmas is None else sigmas[use, place]
        known = known_pixels(image, target[use], rows[use], noise_px, name)
        if use.sum() < LEAST_POINTS:
            words = f"{PICTURES[place]} picture: {use.sum()} points; at least {LEAST_POINTS} are needed"
            return TwoViewEstimate.without_pose(n, "too_few_points", words, started)
        views.append(_of_whole_squares(_View(known, fit_pose(known, robust), use), squares, robust))
    if (refused := _refused(views)) is not None:
        return TwoViewEstimate.without_pose(n, *refused, started)
    return _with_pose(image.camera, target, views, seen & ~outside, relative, started)


def _of_whole_squares(view: _View, squares: IntArray | None, robust: bool) -> _View:
    """Return the view without the squares of which half of the corners or more were rejected."""
    if squares is None or not robust or view.fit.members.all():
        return view
    agree = ~view.rows
    agree[view.rows] = view.fit.members
    lost = squares[np.count_nonzero(agree[squares], axis=1) <= HALF]
    wrong = np.zeros(len(view.rows), dtype=np.bool_)
    wrong[lost] = True
    kept = ~wrong[view.rows]
    if not (view.fit.members & ~kept).any() or kept.sum() < CHECKED_POINTS:
        return view
    fit, members = fit_pose(view.known.where(kept), robust), np.zeros(len(kept), dtype=np.bool_)
    members[kept] = fit.members
    return _View(view.known, replace(fit, members=members), view.rows)


def _in_domain(camera: CentralModel, pixels: FloatArray, visible: BoolArray, name: str) -> BoolArray:
    """Return the visible points (n,) whose pixels (n, 2) the camera may have seen; all where most are not."""
    inside, use = in_domain(camera, finite_array(name, pixels[visible], (None, 2))), visible.copy()
    if inside is not None:
        use[visible] = inside
    return use


def _checked_visible(visible: Any, n: int) -> BoolArray:
    if visible is None:
        return np.ones((2, n), dtype=np.bool_)
    refuse_masked("visible", visible)
    seen = np.asarray(visible)
    if seen.dtype != np.bool_ or seen.shape != (2, n):
        raise InputError(f"visible: {seen.dtype} {seen.shape} given; bool {(2, n)} is needed")
    return seen


def _checked_noise(noise: Any, n: int) -> FloatArray | None:
    if noise is None:
        return None
    if np.ndim(noise) == 0:
        return np.full((n, 2), finite_number("noise", noise, above=0.0))
    sigmas = finite_array("noise", noise, (None, 2))
    if len(sigmas) != n:
        raise InputError(f"noise: {len(sigmas)} rows given; {n} are needed, one for each point")
    return sigmas


def _refused(views: list[_View]) -> tuple[Status, str] | None:
    """Return status and evidence where the two fits are no motion."""
    for view, picture in zip(views, PICTURES, strict=True):
        refused = refusal(view.fit, view.known)
        if refused is not None:
            status: Status = "ambiguous" if refused[0] == "ambiguous" else "not_converged"
            return status, f"{picture} picture: {refused[1]}"
    for view, picture in zip(views, PICTURES, strict=True):
        rival = far_rival(view.fit, _odds(view, views))
        if rival is not None:
            return "ambiguous", f"{picture} picture: {rival}"
    return None


def _odds(view: _View, views: list[_View]) -> FloatArray:
    """Return the odds of a view's minima that are not negligible, σ from both views where not stated."""
    rest = sum(other.cost for other in views if other is not view)
    odds = odds_of(view.fit.costs + rest, sum(v.freedom for v in views), view.known.noise_px)
    if view.known.noise_px is not None:
        odds = odds_of(view.fit.costs, view.freedom, view.known.noise_px)
    return odds[odds >= NEGLIGIBLE]


def _with_pose(
    camera: UnifiedCamera,
    target: FloatArray,
    views: list[_View],
    seen: BoolArray,
    scale_sigma: float,
    started: float,
) -> TwoViewEstimate:
    n, freedom = len(target), sum(view.freedom for view in views)
    cost, stated = sum(view.cost for view in views), views[0].known.noise_px
    spreads = []
    for view in views:
        variance = variance_of(view.cost, view.freedom, view.known.noise_px)
        if stated is None:  # Student's t of both views together; its factor comes with the law below
            variance = cost / freedom if freedom > 2 else variance_of(cost, freedom, None)
        spread = pose_spread(view.known, view.fit, variance, _odds(view, views), camera)
        if spread is None:
            words = "the points do not determine the pose"
            return TwoViewEstimate.without_pose(n, "not_converged", words, started)
        spreads.append(spread)
    initial, goal = (pose_of(view.fit.minima[0]) for view in views)
    motion = initial.inv() * goal
    points = initial.inv().apply(target)
    inliers, residuals = seen[0] | seen[1], np.full((n, 4), math.nan)
    for place, view in enumerate(views):
        inliers[view.rows] &= view.fit.members
        residuals[view.rows, 2 * place : 2 * place + 2] = pose_residuals(view.known, view.fit.minima[0])
    response = _responses(initial, motion, points[inliers])
    off, parameters = _camera_moves(camera, spreads)
    law = JointUncertainty(
        noise=_halves(spreads) @ response.T,
        own=np.zeros((int(inliers.sum()), 3, 3)),
        freedom=float(freedom) if stated is None and freedom > 2 else math.inf,
        calibration=-off @ response.T,
        camera=parameters,
    )
    covariance, spread_of_points = law.covariances()
    gauge = np.concatenate((motion.translation, np.zeros(3)))
    covariance += scale_sigma**2 * np.outer(gauge, gauge)
    points_covariance = np.full((n, 3, 3), math.nan)
    h = points[inliers]
    points_covariance[inliers] = spread_of_points + scale_sigma**2 * h[:, :, None] * h[:, None, :]
    used = residuals[inliers].reshape(-1, 2)
    square = (used[~np.isnan(used[:, 0])] ** 2).sum(axis=1)
    return TwoViewEstimate(
        status="ok",
        message=max(spreads, key=lambda spread: spread.raised).message,
        initial_T_goal=motion,
        points=owned(points),
        is_metric=True,
        covariance=owned(covariance),
        points_covariance=owned(points_covariance),
        inliers=inliers,
        rms_px=math.sqrt(float(square.mean())),
        noise_px=noise_of(cost, freedom, stated),
        residuals_px=owned(residuals),
        seconds=time.perf_counter() - started,
        scale_sigma=scale_sigma,
        uncertainty=law,
    )


def _camera_moves(camera: UnifiedCamera, spreads: list[PoseSpread]) -> tuple[FloatArray, FloatArray]:
    """Return by what independent errors of the camera, one for both images, put the two poses off (f, 12).

    And which errors of its parameters (f, p) those are.
    """
    first, second = spreads[0].by_camera, spreads[1].by_camera
    if first is None or second is None:
        return np.empty((0, 12)), np.empty((0, 5))
    split = len(first.seen)
    both = np.zeros((split + len(second.seen), 12, 2))
    both[:split, :6], both[split:, 6:] = first.response, second.response
    seen = np.concatenate((first.seen, second.seen))
    moves = CameraMoves.of(camera, seen, np.concatenate((first.pixels, second.pixels)))
    return moves.through(both), moves.parameters


def _halves(spreads: list[PoseSpread]) -> FloatArray:
    """Return (12, 12): independent errors, as rows, of the two poses by their points' own noise."""
    halves = np.zeros((12, 12))
    for place, spread in enumerate(spreads):
        values, vectors = np.linalg.eigh(spread.own)
        at = slice(6 * place, 6 * place + 6)
        halves[at, at] = (vectors * np.sqrt(np.maximum(values, 0.0))).T
    return halves


def _responses(initial: RigidTransform, motion: RigidTransform, points: FloatArray) -> FloatArray:
    """Return (6 + 3m, 12): what errors of the two poses do to (t, δ, h₁ … hₘ).

    With poses {R₁, t₁}, {R₂, t₂} in the target's frame, t = R₁ᵀ(t₂ − t₁), R = R₁ᵀR₂ and h = R₁ᵀ(X − t₁):
    dt = R₁ᵀ(dt₂ − dt₁) + [t]× δ₁,  δ = δ₂ − Rᵀδ₁,  dh = −R₁ᵀdt₁ + [h]× δ₁.
    """
    back, turn = initial.rotation.as_matrix().T, motion.rotation.as_matrix()
    response = np.zeros((6 + 3 * len(points), 12))
    response[:3, T1], response[:3, T2] = -back, back
    response[:3, R1] = _cross(np.asarray(motion.translation)[None])[0]
    response[3:6, R1], response[3:6, R2] = -turn.T, np.eye(3)
    response[6:, T1] = np.tile(-back, (len(points), 1))
    response[6:, R1] = _cross(points).reshape(-1, 3)
    return response


def _cross(vectors: FloatArray) -> FloatArray:
    """Return [v]× (k, 3, 3) of (k, 3)."""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(-1, 3, 3)
