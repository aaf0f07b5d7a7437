"""What one further view would tell of motion, structure and scale."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.errors import InputError
from omniservo.estimation.known_displacements import DisplacementPrior, KnownDisplacements
from omniservo.estimation.multi_view_estimate import MultiViewEstimate
from omniservo.estimation.refinement.view_adjustment import ViewProblem
from omniservo.estimation.uncertainty.adjusted_views import AdjustedViews
from omniservo.estimation.uncertainty.calibration_response import pixel_slopes
from omniservo.estimation.uncertainty.view_uncertainty import ViewUncertainty
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import BoolArray, FloatArray, finite_array

USUAL_STEP = 0.15
"""of the points' median distance, by which candidates stand aside where all views are nearer together"""


@with_field_docs
@dataclass(frozen=True, eq=False)
class FurtherView:
    """What an image taken there is expected to do to the estimate: σ before and after.

    To first order, of an image that shows the points as often and as exactly as the others do.
    """

    initial_T_view: RigidTransform
    """where it is taken"""
    points: float
    """how many of the points it is expected to show"""
    position_sigma: tuple[float, float]
    """of the last view: root of the trace of its position's covariance [m], or in the structure's unit"""
    rotation_sigma: tuple[float, float]
    """likewise of its rotation [rad]"""
    size_sigma: tuple[float, float]
    """of the structure's size, relative (`MultiViewEstimate.size_sigma`)"""

    def __repr__(self) -> str:
        shift = np.array2string(self.initial_T_view.translation, precision=3)
        (a, b), (c, d) = self.position_sigma, self.rotation_sigma
        return f"FurtherView({shift}: position σ {a:.3g} → {b:.3g}, rotation σ {c:.3g} → {d:.3g})"


def further_view(
    found: MultiViewEstimate, initial_T_view: RigidTransform, *, displacement: npt.ArrayLike | None = None
) -> FurtherView:
    """Return what a further image would gain.

    Args:
        found: the estimate.
        initial_T_view: where the image is taken, in the frame of the estimate.
        displacement: covariance (6, 6) of the displacement from the first view to it, where an arm knows it
            as it knew those that the estimate rests on, independent of them. None: it is not known.

    Raises:
        InputError: no estimate, no points before the camera there, or an illegal covariance.
    """
    adjusted, law = found.adjusted, found.uncertainty
    if adjusted is None or law is None:
        raise InputError(f"found: status {found.status!r}: without an estimate nothing can be gained")
    more, shown = _with_view(adjusted, initial_T_view, displacement)
    after = more.law()
    if after is None or shown < 1.0:
        raise InputError("initial_T_view: a camera there sees none of the points")
    last = len(adjusted.state.poses) - 1
    before = _sigmas(law, last, adjusted.state.points, found.scale_sigma)
    pairs = zip(before, _sigmas(after, last, adjusted.state.points, found.scale_sigma), strict=True)
    return FurtherView(initial_T_view, shown, *pairs)


def candidate_views(found: MultiViewEstimate) -> list[FurtherView]:
    """Return six further views, what they would gain, that which shrinks the position's σ most first.

    They stand aside, above, below, nearer and farther than the first view, as far as the views that there are
    stand apart, and look where it looks: at the points' centre.

    Raises:
        InputError: no estimate.
    """
    adjusted = found.adjusted
    if adjusted is None:
        raise InputError(f"found: status {found.status!r}: without an estimate nothing can be gained")
    points, centres = adjusted.state.points, adjusted.state.poses[:, 4:]
    centre = np.median(points, axis=0)
    step = max(float(np.linalg.norm(centres, axis=1).max()), USUAL_STEP * float(np.linalg.norm(centre)))
    step = min(step, 0.5 * float(np.linalg.norm(centre)))
    gains = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            shift = sign * step * np.eye(3)[axis]
            try:
                gains.append(further_view(found, _looking_at(centre, shift)))
            except InputError:
                continue
    return sorted(gains, key=lambda gain: gain.position_sigma[1])


def _looking_at(point: FloatArray, shift: FloatArray) -> RigidTransform:
    """Return the pose that sees a point in the direction in which the first view sees it, turned least."""
    here, there = point / np.linalg.norm(point), (point - shift) / np.linalg.norm(point - shift)
    axis, cosine = np.cross(here, there), float(here @ there)
    sine = float(np.linalg.norm(axis))
    turn = axis * (math.atan2(sine, cosine) / sine) if sine > 0.0 else np.zeros(3)
    return RigidTransform.from_components(shift, Rotation.from_rotvec(turn))


def _sigmas(law: ViewUncertainty, view: int, points: FloatArray, scale_sigma: float) -> tuple[float, ...]:
    spread = law.pose_covariance(view)
    sizes = [math.sqrt(float(np.trace(part))) for part in (spread[:3, :3], spread[3:, 3:])]
    return *sizes, math.hypot(math.sqrt(law.size_variance(points)), scale_sigma)


def _with_view(
    adjusted: AdjustedViews, pose: RigidTransform, displacement: Any
) -> tuple[AdjustedViews, float]:
    """Return the views with a further one, and how many points it is expected to show."""
    problem, state = adjusted.problem, adjusted.state
    pixels, visible = _shown(problem, pose, state.points)
    seen = problem.weights > 0.0
    could = np.stack([_shown(problem, _pose(row), state.points)[1] for row in state.poses]) | seen
    share = float(seen.sum()) / float(could.sum())
    typical = float(np.median(problem.weights[seen])) * math.sqrt(share)  # each point, as often as others
    weights = np.where(visible, typical, 0.0)
    by_camera = np.zeros((*pixels.shape, problem.by_camera.shape[3]))
    if len(adjusted.directions):
        local = pose.inv().apply(state.points[visible])
        by_camera[visible] = (
            pixel_slopes(problem.camera, local, adjusted.directions.shape[1]) @ adjusted.directions.T
        )
    row = np.concatenate((pose.rotation.as_quat(), pose.translation))
    window = adjusted.window
    if window is not None:
        window = np.concatenate((window, np.full((1, len(visible)), np.median(window[seen]))))
    more = replace(
        adjusted,
        problem=replace(
            problem,
            pixels=np.concatenate((problem.pixels, pixels[None])),
            weights=np.concatenate((problem.weights, weights[None])),
            by_camera=np.concatenate((problem.by_camera, by_camera[None])),
            prior=_prior(problem, pose, displacement),
        ),
        state=state._replace(poses=np.concatenate((state.poses, row[None]))),
        window=window,
    )
    return more, share * float(visible.sum())


def _prior(problem: ViewProblem, pose: RigidTransform, displacement: Any) -> DisplacementPrior | None:
    prior, views = problem.prior, len(problem.pixels)
    if displacement is None:
        return prior
    if prior is None:
        raise InputError("displacement: given, but the estimate rests on no known displacement")
    spread = np.zeros((len(prior.covariance) + 6,) * 2)
    spread[:-6, :-6] = prior.covariance
    spread[-6:, -6:] = finite_array("displacement", displacement, (6, 6))
    pairs = np.concatenate((prior.pairs, [[0, views]]))
    return DisplacementPrior.of(KnownDisplacements(pairs, (*prior.moves, pose), spread), views + 1)


def _shown(problem: ViewProblem, pose: RigidTransform, points: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return the pixels (m, 2) of the points, 0 where they are not in the image, and which are."""
    pixels, valid = problem.camera.project(pose.inv().apply(points))
    visible = valid & problem.camera.in_image(np.where(valid[:, None], pixels, 0.0))
    return np.where(visible[:, None], pixels, 0.0), visible


def _pose(row: FloatArray) -> RigidTransform:
    return RigidTransform.from_components(row[4:], Rotation.from_quat(row[:4]))
