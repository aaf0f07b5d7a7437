"""What several views say about the camera's motion and the target's structure."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.drawn import drawn
from omniservo.errors import InputError
from omniservo.estimation.two_view_estimate import Status, TwoViewEstimate
from omniservo.estimation.uncertainty.adjusted_views import AdjustedViews
from omniservo.estimation.uncertainty.view_uncertainty import ViewUncertainty
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import BoolArray, FloatArray, owned

ViewStatus = Literal["ok", "by_displacement", "too_few_points", "no_pose"]


@with_field_docs
@dataclass(frozen=True, eq=False)
class MultiViewEstimate:
    """Motion and structure from v images of n points, or the reason why there is none.

    Any status but "ok" is no answer: every pose is None and every number NaN, in arrays of unchanged shape.
    """

    status: Status
    """as `TwoViewEstimate`: why no two views gave a motion; "ok" where at least two views have a pose"""
    message: str
    """One sentence with the evidence; for "ok" empty, or which views have no pose and why, and where stated
    errors were raised."""
    initial_T_views: tuple[RigidTransform | None, ...]
    """(v,) coordinates in each view's camera to those in the first one's, None for a view without a pose.
    Where the first view has none, the frame is that of the first that has: ``reference``."""
    points: FloatArray
    """(n, 3) [m], or in distances of the first two views' centres where not metric; frame of the first view.
    NaN for a point that fewer than two views agree on."""
    is_metric: bool
    """False: the centres of the first two views are 1 apart."""
    covariance: FloatArray
    """(v, 6, 6) of (translation, rotation vector applied on the right of initial_T_views); 0 for the first
    view, NaN for one without a pose. As `TwoViewEstimate.covariance`, ``scale_sigma`` included."""
    points_covariance: FloatArray
    """(n, 3, 3) likewise"""
    inliers: BoolArray
    """(v, n) the pixels that the estimate rests on"""
    rms_px: float
    """Root mean square distance between pixel and projection of the inliers [px]."""
    noise_px: float
    """σ of one pixel coordinate, from the residuals [px]."""
    residuals_px: FloatArray
    """(v, n, 2) projection minus pixel [px], NaN where there is no pose, point or pixel"""
    scale_sigma: float
    """Standard deviation of the scale over the scale, as it was stated."""
    freedom: float
    """Degrees of freedom of σ; infinite where the noise was stated. Residuals with two or fewer are blended
    with 0.5 px, worth four of them."""
    uncertainty: ViewUncertainty | None
    """Joint law of what has a pose or a place, in the structure's unit."""
    sigma_px: float
    """σ of the covariances [px]: what was stated, or what the residuals say."""
    seconds: float
    """Wall time of the estimation [s]."""
    view_status: tuple[ViewStatus, ...]
    """(v,) "ok"; "by_displacement": the view stands by its stated displacement, its image adds nothing;
    "too_few_points": it shows fewer than four points; "no_pose": none that its points agree with"""
    view_reasons: tuple[str, ...]
    """(v,) why a view has no pose; empty for one that has"""
    camera_shift: FloatArray
    """(p,) by how much the camera's parameters seem to differ from the stated ones, in the order of
    ``calibration_covariance``; to first order. Zeros where that was not given"""
    adjusted: AdjustedViews | None
    """what `further_view` needs; None: there is no estimate"""

    @property
    def reference(self) -> int | None:
        """The view whose frame is that of poses and points; None: there is no pose."""
        return next((k for k, pose in enumerate(self.initial_T_views) if pose is not None), None)

    @property
    def size_sigma(self) -> float:
        """Standard deviation of the structure's size √Σ‖h‖² over that size, ``scale_sigma`` included."""
        if self.uncertainty is None:
            return math.nan
        points = self.points[~np.isnan(self.points[:, 0])]
        return math.hypot(math.sqrt(self.uncertainty.size_variance(points)), self.scale_sigma)

    def _repr_html_(self) -> str:
        return str(drawn("value_html", self))

    def __repr__(self) -> str:
        posed = sum(pose is not None for pose in self.initial_T_views)
        words = [self.status, f"{posed} of {len(self.initial_T_views)} views", f"{len(self.points)} points"]
        if self.status == "ok":
            words += [f"{self.rms_px:.3g} px rms", "metric" if self.is_metric else "of unknown scale"]
        return f"MultiViewEstimate({', '.join(words)})"

    def two_view(self, goal: int = 1) -> TwoViewEstimate:
        """Return what all views say about the motion from the first one to ``goal``.

        Raises:
            InputError: there is no such view, or the first view has no pose.
        """
        views, n = self.inliers.shape
        if not 0 < goal < views:
            raise InputError(f"goal: {goal!r} given; legal: whole numbers from 1 to {views - 1}")
        if self.status == "ok" and self.initial_T_views[0] is None:
            raise InputError(f"goal: view 0, from which it is seen, has no pose: {self.view_reasons[0]}")
        pose, law = self.initial_T_views[goal], self.uncertainty
        if self.status != "ok" or pose is None or law is None:
            status: Status = "not_converged" if self.status == "ok" else self.status
            words = self.message or f"view {goal} has no pose"
            return TwoViewEstimate.without_pose(n, status, words, time.perf_counter() - self.seconds)
        placed = ~np.isnan(self.points[:, 0])
        rank = sum(other is not None for other in self.initial_T_views[:goal])
        return TwoViewEstimate(
            status="ok",
            message="",
            initial_T_goal=pose,
            points=self.points,
            is_metric=self.is_metric,
            covariance=owned(self.covariance[goal]),
            points_covariance=self.points_covariance,
            inliers=placed,
            rms_px=self.rms_px,
            noise_px=self.noise_px,
            residuals_px=np.concatenate((self.residuals_px[0], self.residuals_px[goal]), axis=1),
            seconds=self.seconds,
            scale_sigma=self.scale_sigma,
            uncertainty=law.law(rank),
        )

    @classmethod
    def without_pose(
        cls,
        shape: tuple[int, int],
        status: Status,
        message: str,
        started: float,
        reasons: Mapping[int, str],
    ) -> MultiViewEstimate:
        """Return the answer to pixels (v, n) that hold none; ``started`` is a `time.perf_counter`."""
        v, n = shape
        none: ViewStatus = "no_pose"
        return cls(
            status=status,
            message=message,
            initial_T_views=(None,) * v,
            points=np.full((n, 3), math.nan),
            is_metric=False,
            covariance=np.full((v, 6, 6), math.nan),
            points_covariance=np.full((n, 3, 3), math.nan),
            inliers=np.zeros((v, n), dtype=np.bool_),
            rms_px=math.nan,
            noise_px=math.nan,
            residuals_px=np.full((v, n, 2), math.nan),
            scale_sigma=0.0,
            freedom=math.inf,
            uncertainty=None,
            sigma_px=math.nan,
            seconds=time.perf_counter() - started,
            view_status=(none,) * v,
            view_reasons=tuple(reasons.get(view, message) for view in range(v)),
            camera_shift=np.zeros(5),
            adjusted=None,
        )
