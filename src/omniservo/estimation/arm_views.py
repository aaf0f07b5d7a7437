"""The views of a camera that an arm has moved: what is seen in them, and what is known beside it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.cameras import UnifiedCamera
from omniservo.cameras.calibration_covariance import PARAMETERS, covariance_directions
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import BoolArray, FloatArray, IntArray

GOAL = 1
"""The view's number; view 0 is where the arm stands."""


class LengthPrior(NamedTuple):
    """The length of the goal's displacement, or of two points."""

    metres: float
    sigma: float
    """relative, 0: exact"""
    rows: tuple[int, int] | None = None
    """of the two points; None: from the centre of view ``since`` to the goal's"""
    since: int = 0
    by_mount: FloatArray | None = None
    """(6,) a = ∂ log L/∂ξ, where the arm tells it; None: it has nothing to do with the mount"""


@with_field_docs
@dataclass(frozen=True, eq=False)
class KnownErrors:
    """What is known of errors that all views share; scaled by `with_parts`."""

    mount: FloatArray | None = None
    """(6, 6) covariance of ξ, in the camera's frame (linear [m], angular [rad]); None: exact"""
    lens: FloatArray | None = None
    """(5, 5) or (9, 9) covariance of the camera's parameters, as `estimate_two_view` takes it; None: exact"""
    length: LengthPrior | None = None
    """None: the arm's displacements alone tell the scale"""


@with_field_docs
@dataclass(frozen=True, eq=False)
class ArmViews:
    """The pixels of n points in v views: where the arm stands, the goal, and where the arm has stood."""

    camera: UnifiedCamera
    pixels: FloatArray
    """(v, n, 2) [px]"""
    seen: BoolArray
    """(v, n)"""
    noise: FloatArray
    """(v, n) σ of a coordinate [px]; see ``is_guess``"""
    reached: tuple[RigidTransform | None, ...]
    """(v,) poses in the first view's frame as the arm has them; None: the goal, which it need not know"""
    known: KnownErrors
    is_guess: bool = False
    """whether the noise is known but for a common factor, which the residuals tell"""
    windows: FloatArray | None = None
    """(n,) as `MatchedPoints.window`"""

    def where(self, rows: IntArray) -> ArmViews:
        """Return the chosen points (k,); a known length of two points must be among them."""
        windows = None if self.windows is None else self.windows[rows]
        length = self.known.length
        if length is not None and length.rows is not None:
            first, second = (int(np.flatnonzero(rows == row)[0]) for row in length.rows)
            length = length._replace(rows=(first, second))
        return replace(
            self, pixels=self.pixels[:, rows], seen=self.seen[:, rows], noise=self.noise[:, rows],
            windows=windows, known=replace(self.known, length=length),
        )  # fmt: skip


@with_field_docs
@dataclass(frozen=True, eq=False)
class ArmViewsOptimum:
    """Where the sum is least."""

    views: ArmViews
    """with the pixels that agree, and their noise as it was found"""
    poses: tuple[RigidTransform, ...]
    """(v,) in the first view's frame"""
    points: FloatArray
    """(n, 3) [m]"""
    mount: FloatArray
    """(m,) independent parts of ξ, in σ"""
    lens: FloatArray
    """(q,) of θ − θ₀, likewise"""
    freedom: float = math.inf
    """of σ, where the residuals state it"""

    @property
    def camera(self) -> UnifiedCamera:
        """The camera with the parameters that were found."""
        return with_lens(self.views.camera, self.lens @ lens_directions(self.views.known))


def with_view(at: ArmViewsOptimum, first_T_next: RigidTransform) -> ArmViewsOptimum:
    """Return what is expected of one more view, from there on the first: its pixels as they will be.

    Points that it will not show are left out, and with one of its two points a known length.
    """
    next_T_first = first_T_next.inv()
    points = next_T_first.apply(at.points)
    pixels, valid = at.camera.project(points)
    shown = valid & at.camera.in_image(np.where(valid[:, None], pixels, -1e3))
    poses = [next_T_first * pose for pose in at.poses]
    reached = [None if pose is None else next_T_first * pose for pose in at.views.reached]
    views, order = at.views, [GOAL, 0, *range(2, len(poses))]
    known = views.known
    if known.length is not None:
        rows, since = known.length.rows, order.index(known.length.since) + 1
        kept = rows is None or shown[list(rows)].all()
        known = replace(known, length=known.length._replace(since=since) if kept else None)
    views = replace(
        views,
        pixels=np.concatenate((np.nan_to_num(pixels)[None], views.pixels[order])),
        seen=np.concatenate((shown[None], views.seen[order])),
        noise=np.concatenate((views.noise[:1], views.noise[order])),
        reached=(RigidTransform.identity(), *(reached[i] for i in order)),
        known=known,
    )
    at = replace(
        at, views=views.where(np.flatnonzero(shown)), points=points[shown],
        poses=(RigidTransform.identity(), *(poses[i] for i in order)),
    )  # fmt: skip
    return at if math.isinf(at.freedom) else replace(at, freedom=freedom_of(at))


def seen_from_first(at: ArmViewsOptimum) -> FloatArray:
    """Return where the points are seen from each view (v, n, 3)."""
    return np.array([pose.inv().apply(at.points) for pose in at.poses])


def weights_of(views: ArmViews) -> FloatArray:
    """Return w (v, n): the noise, the camera's model error added in quadrature [px]."""
    error = views.camera.model_error
    return np.asarray(np.hypot(views.noise, 0.0 if error is None else error.sigma_px))


def freedom_of(at: ArmViewsOptimum) -> float:
    """Return how many pixel coordinates are more than what they determine; what is known tells the rest."""
    v = len(at.poses)
    free = 6 * (v - 1) - 6 * sum(pose is not None for pose in at.views.reached[GOAL + 1 :])
    used = at.views.seen.any(axis=0).sum()
    return float(2 * at.views.seen.sum() - 3 * used - free + (at.views.known.length is not None))


def no_errors(known: KnownErrors) -> tuple[FloatArray, FloatArray]:
    """Return mount and lens as calibrated, in σ."""
    return np.zeros(len(mount_directions(known))), np.zeros(len(lens_directions(known)))


def lens_directions(known: KnownErrors) -> FloatArray:
    """Return independent parts of θ − θ₀ (q, 5 or 9), one σ each."""
    return np.empty((0, 5)) if known.lens is None else covariance_directions(known.lens)


def mount_directions(known: KnownErrors) -> FloatArray:
    """Return independent parts of ξ (m, 6), one σ each."""
    if known.mount is None:
        return np.empty((0, 6))
    values, vectors = np.linalg.eigh(known.mount)
    kept = values > 1e-12 * max(values[-1], 1e-300)
    return np.asarray((vectors[:, kept] * np.sqrt(values[kept])).T)


def with_lens(camera: UnifiedCamera, change: FloatArray) -> UnifiedCamera:
    """Return the camera with its parameters changed by (p,)."""
    if not change.any():
        return camera
    fields: dict[str, Any] = {
        name: getattr(camera, name) + float(by)
        for name, by in zip(PARAMETERS[:5], change, strict=False)
        if by
    }
    if len(change) > 5:
        fields["distortion"] = tuple(np.add(camera.distortion, change[5:]).tolist())
    if "xi" in fields:
        fields["xi"] = max(fields["xi"], 0.0)
    return replace(camera, **fields)


def chain_of(
    first: RigidTransform, others: Sequence[RigidTransform | None]
) -> tuple[RigidTransform | None, ...]:
    """Return `ArmViews.reached` of poses in one frame: the first, and (v − 1,) others."""
    back = first.inv()
    return RigidTransform.identity(), *(None if pose is None else back * pose for pose in others)
