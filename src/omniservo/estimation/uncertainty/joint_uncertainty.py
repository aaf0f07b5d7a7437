"""Motion and structure as one uncertain quantity: what plans draw samples from."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.errors import InputError
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray, IntArray, finite_array, finite_number

Source = Literal["noise", "scale", "calibration"]
SOURCES: tuple[Source, ...] = get_args(Source)
"""Where uncertainty comes from: noise of the pixels, the stated scale, the calibration of the camera."""

_ADDED = {"pixel_sigma", "size_variance"}
"""Fields that older files do not have."""


@with_field_docs
@dataclass(frozen=True, eq=False)
class JointUncertainty:
    """First-order law of x = (t, δ, h₁ … hₘ), m the inliers, δ applied on the right of initial_T_goal.

    dx = τ (Σₖ zₖ noiseₖ + own) + Σ_q z_q calibration_q, all z standard normal, own of each point normal
    with its covariance and independent of all else, τ = √(ν/χ²_ν): with σ from the residuals pixel noise
    gives Student's t. The scale is not in it; see `TwoViewEstimate.scale_sigma`.
    """

    noise: FloatArray
    """(k, 6 + 3m) what each independent direction of pixel noise does to x [m], [rad]"""
    own: FloatArray
    """(m, 3, 3) covariance of what pixel noise does to each point alone [m²]"""
    freedom: float
    """ν > 2, degrees of freedom of σ; infinite where σ was given"""
    calibration: FloatArray
    """(q, 6 + 3m) what each independent direction of the camera's parameters does to x [m], [rad]"""
    camera: FloatArray
    """(q, p) that direction, one σ of it: of fx, fy, cx, cy, ξ and, where p = 9, k1, k2, p1, p2"""
    pixel_sigma: FloatArray | None = None
    """(m, 2) σ of each inlier's pixel coordinates in either image [px], where ``noise`` is stretched over
    curved valleys or rival minima: `TwoViewEstimate.sample` can then draw from the likelihood itself."""
    size_variance: float = 0.0
    """s², variance of the mean logarithm of the points' covariance: the motion's error makes the whole
    structure, and its ellipsoid, larger or smaller; see `structure_size`"""

    def __post_init__(self) -> None:
        for name in ("noise", "own", "calibration", "camera", "pixel_sigma"):
            if getattr(self, name) is not None:
                getattr(self, name).setflags(write=False)

    @property
    def inflation(self) -> float:
        """ν/(ν − 2), covariance of Student's t over σ²; 1 where σ was given, ν > 2."""
        return 1.0 if math.isinf(self.freedom) else self.freedom / (self.freedom - 2.0)

    @property
    def structure_freedom(self) -> float:
        """1/(1/ν + s²/2): the ellipsoid of all 3m coordinates at once has the quantile of F(3m, this)."""
        inverse = 1.0 / self.freedom + 0.5 * self.size_variance
        return 1.0 / inverse if inverse > 0.0 else math.inf

    def covariances(self) -> tuple[FloatArray, FloatArray]:
        """Return the covariance (6, 6) of (t, δ) and (m, 3, 3) of each point."""
        rows = np.concatenate((math.sqrt(self.inflation) * self.noise, self.calibration))
        points = np.ascontiguousarray(rows[:, 6:].T).reshape(-1, 3, len(rows))
        each = self.inflation * self.own + points @ np.swapaxes(points, 1, 2)
        return rows[:, :6].T @ rows[:, :6], each

    def of_points(self, chosen: IntArray) -> JointUncertainty:
        """Return the law of the motion and of these (k,) of the m points alone."""
        columns = np.concatenate((np.arange(6), (6 + 3 * chosen[:, None] + np.arange(3)).ravel()))
        sigma = None if self.pixel_sigma is None else self.pixel_sigma[chosen]
        noise, calibration = self.noise[:, columns], self.calibration[:, columns]
        return replace(self, noise=noise, own=self.own[chosen], calibration=calibration, pixel_sigma=sigma)

    def taus(self, rng: np.random.Generator, count: int) -> FloatArray:
        """Return samples of τ (count,)."""
        if math.isinf(self.freedom):
            return np.ones(count)
        return np.asarray(np.sqrt(self.freedom / rng.chisquare(self.freedom, size=count)))

    def draw_noise(self, rng: np.random.Generator, tau: FloatArray) -> FloatArray:
        """Return what pixel noise does to x (count, 6 + 3m), one sample for each τ."""
        dx = rng.standard_normal((len(tau), len(self.noise))) @ self.noise
        dx[:, 6:] += self.draw_own(rng, np.ones(len(tau))).reshape(len(tau), -1)
        return tau[:, None] * dx

    def draw_own(self, rng: np.random.Generator, tau: FloatArray) -> FloatArray:
        """Return what pixel noise does to each point alone (count, m, 3), one sample for each τ."""
        values, vectors = np.linalg.eigh(self.own)
        half = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
        normal = rng.standard_normal((len(tau), len(self.own), 3))
        drawn = np.matmul(normal.transpose(1, 0, 2), half.transpose(0, 2, 1)).transpose(1, 0, 2)
        return np.asarray(tau[:, None, None] * drawn)

    def draw_calibration(self, rng: np.random.Generator, count: int) -> tuple[FloatArray, FloatArray]:
        """Return what the camera does to x (count, 6 + 3m), and its parameters' deviations (count, p)."""
        lens = rng.standard_normal((count, len(self.calibration)))
        return lens @ self.calibration, lens @ self.camera

    def to_dict(self) -> dict[str, Any]:
        """Return plain lists and numbers; an infinite ``freedom`` becomes None."""
        return {
            "noise": self.noise.tolist(),
            "own": self.own.tolist(),
            "freedom": None if math.isinf(self.freedom) else self.freedom,
            "calibration": self.calibration.tolist(),
            "camera": self.camera.tolist(),
            "pixel_sigma": None if self.pixel_sigma is None else self.pixel_sigma.tolist(),
            "size_variance": self.size_variance,
        }

    @classmethod
    def from_dict(cls, fields: Any, inliers: int, source: str) -> JointUncertainty:
        """Return the uncertainty of :meth:`to_dict` for so many inliers.

        Raises:
            InputError: a field is missing, unknown or not legal.
        """
        names = ("noise", "own", "freedom", "calibration", "camera")
        if not isinstance(fields, dict) or {*fields, *_ADDED} != {*names, *_ADDED}:
            raise InputError(f"{source}: exactly the fields {', '.join(names)} are needed")
        freedom, width = fields["freedom"], 6 + 3 * inliers
        sigma = fields.get("pixel_sigma")
        law = cls(
            noise=_rows(f"{source}: noise", fields["noise"], width),
            own=_rows(f"{source}: own", fields["own"], 3, 3),
            freedom=math.inf if freedom is None else finite_number(f"{source}: freedom", freedom, above=2.0),
            calibration=_rows(f"{source}: calibration", fields["calibration"], width),
            camera=_rows(f"{source}: camera", fields["camera"], None),
            pixel_sigma=None
            if sigma is None
            else finite_array(f"{source}: pixel_sigma", sigma, (inliers, 2)),
            size_variance=finite_number(
                f"{source}: size_variance", fields.get("size_variance", 0.0), minimum=0.0
            ),
        )
        if len(law.own) != inliers:
            raise InputError(f"{source}: own: {len(law.own)} points given; {inliers} inliers")
        if len(law.camera) != len(law.calibration) or law.camera.shape[1] not in (0, 5, 9):
            raise InputError(
                f"{source}: camera: {law.camera.shape} given; ({len(law.calibration)}, 5 or 9) is needed"
            )
        return law


def _rows(name: str, value: Any, *shape: int | None) -> FloatArray:
    """Return a list of rows of this shape, which may be empty."""
    if value == []:
        return np.empty((0, *(size or 0 for size in shape)))
    return finite_array(name, value, (None, *shape))


@with_field_docs
@dataclass(frozen=True, eq=False)
class EstimateSamples:
    """Equally likely answers to what the motion and the structure are; see `TwoViewEstimate.sample`."""

    initial_T_goal: RigidTransform
    """(count,)"""
    points: FloatArray
    """(count, n, 3) [m], initial camera frame; NaN for a rejected match; of the rows required, if any"""
    camera: FloatArray
    """(count, p) by how much the camera's parameters differ from the stated ones, p = 0, 5 or 9"""
    repeats: float = 1.0
    """how often the motion of a sample is among them, on average; count/repeats is the effective sample size.
    Above 1 where motions are likely that the normal law rarely proposes"""
