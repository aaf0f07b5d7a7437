"""What one image of known points says about the camera's pose."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.drawn import drawn
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.geometry.quaternions import matrix_from_quaternion
from omniservo.short_repr import short_repr

PoseStatus = Literal["ok", "too_few_points", "collinear_points", "ambiguous", "not_converged"]


def pose_of(row: FloatArray) -> RigidTransform:
    """Return the pose of a row that begins with quaternion and translation."""
    matrix = np.eye(4)
    matrix_from_quaternion(row[0], row[1], row[2], row[3], matrix)
    matrix[:3, 3] = row[4:7]
    return RigidTransform(matrix, normalize=False)


@with_field_docs
@dataclass(frozen=True, eq=False)
class PoseEstimate:
    """The camera's pose from n known points, or the reason why there is none.

    Any status but "ok" is no pose: ``reference_T_camera`` is None and every number that belongs to a pose is
    NaN, in arrays of unchanged shape.
    """

    status: PoseStatus
    """"ok"; "too_few_points": fewer than three; "collinear_points": on one line, around which the camera
    could stand anywhere; "ambiguous": a second pose is nearly as likely (see ``poses``); "not_converged": no
    pose that the points, or enough of them, agree with."""
    message: str
    """One sentence with the evidence; empty for "ok"."""
    minima: FloatArray
    """(m, 7) ``poses`` as numbers: quaternion (x, y, z, w) and translation [m]."""
    odds: tuple[float, ...]
    """(m,) likelihood of each of ``poses`` beside the first, at least 0.001."""
    covariance: FloatArray
    """(6, 6) of (translation in the points' frame [m], rotation vector applied on the right [rad]). With the
    noise stated σ²(JᵀJ)⁻¹, σ being that, or what the residuals say where they prove it too small; else
    Student's t with ν = 2n − 6 degrees of freedom, σ²ν/(ν − 2)(JᵀJ)⁻¹. Of four points or three, which say too
    little about σ, it is blended with 0.5 px, worth four residuals. Where the cost's valley bends, or another
    minimum is not negligible, it is stretched to hold what is as likely."""
    inliers: BoolArray
    """(n,) the points that the pose rests on."""
    rms_px: float
    """Root mean square distance between pixel and projection of the inliers [px]."""
    noise_px: float
    """σ of one pixel coordinate, from the residuals: √(Σr²/(2n − 6)) [px], of the median point where each
    one's noise is stated. Of three points, which leave no residual, what is stated, or 0.5."""
    residuals_px: FloatArray
    """(n, 2) projection minus pixel [px]; NaN where the point is outside the camera's domain."""
    seconds: float
    """Wall time of the estimation [s]."""

    __repr__ = short_repr

    def _repr_html_(self) -> str:
        return str(drawn("value_html", self))

    @property
    def reference_T_camera(self) -> RigidTransform | None:
        """{R, t} takes coordinates from the camera to the points' frame, c = Rᵀ(h − t). None unless "ok"."""
        return self.poses[0] if self.status == "ok" else None

    @cached_property
    def poses(self) -> tuple[RigidTransform, ...]:
        """Every pose that the pixels do not rule out, the likeliest first; empty where none was found.

        One; two of a plane; up to four of three points.
        """
        return tuple(pose_of(row) for row in self.minima)

    @property
    def alternative(self) -> RigidTransform | None:
        """The second likeliest pose, where its likelihood is not negligible: of a plane its mirrored one."""
        return self.poses[1] if len(self.poses) > 1 else None
