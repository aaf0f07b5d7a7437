"""Motion and structure as one uncertain quantity: what plans draw samples from."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray, finite_array, finite_number, frozen

Source = Literal["noise", "scale", "calibration"]
SOURCES: tuple[Source, ...] = get_args(Source)
"""Where uncertainty comes from: noise of the pixels, the stated scale, the calibration of the camera."""


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
    """ν, degrees of freedom of σ; infinite where σ was given"""
    calibration: FloatArray
    """(q, 6 + 3m) what each independent direction of the camera's parameters does to x [m], [rad]"""
    camera: FloatArray
    """(q, p) that direction, one σ of it: of fx, fy, cx, cy, ξ and, where p = 9, k1, k2, p1, p2"""

    def __post_init__(self) -> None:
        m = len(self.own)
        finite_array("uncertainty.own", self.own, (m, 3, 3))
        for name in ("noise", "calibration"):
            finite_array(f"uncertainty.{name}", getattr(self, name), (None, 6 + 3 * m))
        camera = finite_array("uncertainty.camera", self.camera, (len(self.calibration), None))
        if camera.shape[1] not in (0, 5, 9):
            raise InputError(f"uncertainty.camera: {camera.shape[1]} columns given; legal: 0, 5, 9")
        if not self.freedom > 0.0:
            raise InputError(f"uncertainty.freedom: {self.freedom:g} given; more than 0 is needed")
        for name in ("noise", "own", "calibration", "camera"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @property
    def inflation(self) -> float:
        """ν/(ν − 2), covariance of Student's t over σ²; 1 where σ was given, infinite for ν ≤ 2."""
        if math.isinf(self.freedom):
            return 1.0
        return self.freedom / (self.freedom - 2.0) if self.freedom > 2.0 else math.inf

    def covariances(self) -> tuple[FloatArray, FloatArray]:
        """Return the covariance (6, 6) of (t, δ) and (m, 3, 3) of each point."""
        m = len(self.own)
        rows = np.concatenate((math.sqrt(self.inflation) * self.noise, self.calibration))
        points = rows[:, 6:].reshape(len(rows), m, 3)
        each = self.inflation * self.own + np.einsum("kmi,kmj->mij", points, points)
        return rows[:, :6].T @ rows[:, :6], each

    def draw(
        self, rng: np.random.Generator, count: int, sources: tuple[Source, ...] = SOURCES
    ) -> tuple[FloatArray, FloatArray]:
        """Return ``count`` samples of dx (count, 6 + 3m) and of the camera's parameters (count, p).

        What is not among the sources stands still; the others are the same numbers as with all sources.
        """
        m, calibrated = len(self.own), "calibration" in sources
        tau = np.ones((count, 1))
        if not math.isinf(self.freedom):
            tau = np.sqrt(self.freedom / rng.chisquare(self.freedom, size=(count, 1)))
        shared = rng.standard_normal((count, len(self.noise)))
        own = rng.standard_normal((count, m, 3))
        lens = rng.standard_normal((count, len(self.calibration)))
        dx = np.zeros((count, 6 + 3 * m))
        if "noise" in sources:
            values, vectors = np.linalg.eigh(self.own)
            half = vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :]
            alone = np.einsum("kmi,mji->kmj", own, half).reshape(count, 3 * m)
            dx = shared @ self.noise
            dx[:, 6:] += alone
            dx *= tau
        if not calibrated or not len(lens):
            return dx, np.zeros((count, self.camera.shape[1]))
        return dx + lens @ self.calibration, lens @ self.camera

    def to_dict(self) -> dict[str, Any]:
        """Return plain lists and numbers; an infinite ``freedom`` becomes None."""
        return {
            "noise": self.noise.tolist(),
            "own": self.own.tolist(),
            "freedom": None if math.isinf(self.freedom) else self.freedom,
            "calibration": self.calibration.tolist(),
            "camera": self.camera.tolist(),
        }

    @classmethod
    def from_dict(cls, fields: Any, inliers: int, source: str) -> JointUncertainty:
        """Return the uncertainty of :meth:`to_dict` for so many inliers.

        Raises:
            InputError: a field is missing, unknown or not legal.
        """
        names = ("noise", "own", "freedom", "calibration", "camera")
        if not isinstance(fields, dict) or sorted(fields) != sorted(names):
            raise InputError(f"{source}: exactly the fields {', '.join(names)} are needed")
        freedom, width = fields["freedom"], 6 + 3 * inliers
        directions = len(fields["calibration"]) if isinstance(fields["calibration"], list) else 0
        camera = finite_array(f"{source}: camera", fields["camera"] or np.empty((0, 0)), (None, None))
        return cls(
            noise=finite_array(f"{source}: noise", fields["noise"] or np.empty((0, width)), (None, width)),
            own=finite_array(f"{source}: own", fields["own"] or np.empty((0, 3, 3)), (inliers, 3, 3)),
            freedom=math.inf if freedom is None else finite_number(f"{source}: freedom", freedom, above=0.0),
            calibration=finite_array(
                f"{source}: calibration", fields["calibration"] or np.empty((0, width)), (directions, width)
            ),
            camera=camera,
        )


@dataclass(frozen=True, eq=False)
class EstimateSamples:
    """Equally likely answers to what the motion and the structure are; see `TwoViewEstimate.sample`."""

    initial_T_goal: RigidTransform
    """(count,)"""
    points: FloatArray
    """(count, n, 3) [m], initial camera frame; NaN for a rejected match"""
    camera: FloatArray
    """(count, p) by how much the camera's parameters differ from the stated ones, p = 0, 5 or 9"""
