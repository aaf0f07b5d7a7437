"""The unified camera."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from omniservo.cameras.dead_zone import DeadZone
from omniservo.cameras.unified_kernels import project_point_jacobian, project_points, unproject_pixels
from omniservo.errors import InputError
from omniservo.geometry.arrays import BoolArray, FloatArray, finite_number, frozen
from omniservo.geometry.kernel import kernel


@dataclass(frozen=True)
class UnifiedCamera:
    """m̄ = (X, Y)/(Z + ξρ), then radial-tangential distortion, then K."""

    fx: float
    fy: float
    cx: float
    cy: float
    xi: float
    width: int
    height: int
    skew: float = field(default=0.0, kw_only=True)
    distortion: tuple[float, float, float, float] = field(default=(0.0, 0.0, 0.0, 0.0), kw_only=True)
    max_angle: float | None = field(default=None, kw_only=True)
    dead_zone: Any = field(default=None, kw_only=True)
    parameters: FloatArray = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        finite_number("xi", self.xi, minimum=0.0)
        if self.fx == 0 or self.fy == 0:
            raise InputError("fx, fy: must not be 0")
        zone = self.dead_zone
        if isinstance(zone, dict):
            zone = DeadZone(tuple(zone["center"]), zone["radius"])
        elif zone is not None and not isinstance(zone, DeadZone):
            zone = DeadZone(tuple(zone[0]), zone[1])
        object.__setattr__(self, "dead_zone", zone)
        object.__setattr__(self, "distortion", tuple(float(k) for k in self.distortion))
        xi = self.xi
        least = -xi if xi <= 1 else -1 / xi
        if self.max_angle is not None:
            least = max(least, math.cos(self.max_angle))
        sine = math.sqrt(max(0.0, 1 - least * least))
        r2 = (sine / (least + xi)) ** 2 if least + xi > 0 else math.inf
        values = [self.fx, self.fy, self.cx, self.cy, self.skew, xi, *self.distortion, least, r2]
        object.__setattr__(self, "parameters", frozen(np.array(values)))

    @property
    def matrix(self) -> FloatArray:
        """K, (3, 3)."""
        return np.array([[self.fx, self.skew, self.cx], [0, self.fy, self.cy], [0, 0, 1.0]])

    @property
    def usable_angle(self) -> float:
        """Largest angle from the axis [rad]."""
        return math.acos(max(-1.0, float(self.parameters[10])))

    @property
    def is_distorted(self) -> bool:
        """True where any distortion coefficient differs from 0."""
        return any(self.distortion)

    def project(self, points: npt.ArrayLike) -> tuple[FloatArray, BoolArray]:
        """Pixels of points (…, 3) in the camera frame, and which are valid."""
        p = np.asarray(points, dtype=np.float64)
        pixels = np.empty((*p.shape[:-1], 2))
        valid = np.empty(p.shape[:-1], dtype=np.bool_)
        project_points(
            self.parameters, np.ascontiguousarray(p.reshape(-1, 3)), pixels.reshape(-1, 2), valid.reshape(-1)
        )
        return pixels, valid

    def project_jacobian(self, points: npt.ArrayLike) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Pixels, their derivative (…, 2, 3) by the point, and which are valid."""
        p = np.asarray(points, dtype=np.float64)
        out = _jacobians(self.parameters, np.ascontiguousarray(p.reshape(-1, 3)))
        shape = p.shape[:-1]
        return (
            out[:, :2].reshape(*shape, 2),
            out[:, 2:8].reshape(*shape, 2, 3),
            out[:, 8].reshape(shape) > 0,
        )

    def unproject(self, pixels: npt.ArrayLike) -> tuple[FloatArray, BoolArray]:
        """Bearings of pixels (…, 2), and which are valid."""
        p = np.asarray(pixels, dtype=np.float64)
        bearings = np.empty((*p.shape[:-1], 3))
        valid = np.empty(p.shape[:-1], dtype=np.bool_)
        unproject_pixels(
            self.parameters,
            np.ascontiguousarray(p.reshape(-1, 2)),
            bearings.reshape(-1, 3),
            valid.reshape(-1),
        )
        return bearings, valid

    def in_image(self, pixels: npt.ArrayLike) -> BoolArray:
        """Inside the image's rectangle and outside the dead zone."""
        p = np.asarray(pixels, dtype=np.float64)
        u, v = p[..., 0], p[..., 1]
        inside = (u >= -0.5) & (u <= self.width - 0.5) & (v >= -0.5) & (v <= self.height - 0.5)
        if self.dead_zone is not None:
            cu, cv = self.dead_zone.center
            inside &= np.hypot(u - cu, v - cv) >= self.dead_zone.radius
        return np.asarray(inside)

    def to_dict(self) -> dict[str, Any]:
        """The camera of a problem file."""
        zone = self.dead_zone
        return {
            "model": "unified",
            "fx": self.fx,
            "fy": self.fy,
            "cx": self.cx,
            "cy": self.cy,
            "skew": self.skew,
            "xi": self.xi,
            "distortion": list(self.distortion),
            "width": self.width,
            "height": self.height,
            "max_angle": self.max_angle,
            "dead_zone": None if zone is None else {"center": list(zone.center), "radius": zone.radius},
        }

    @classmethod
    def from_dict(cls, d: dict[str, Any], source: str = "camera") -> UnifiedCamera:
        """The camera of a problem file."""
        fields = {k: v for k, v in d.items() if k != "model"}
        return cls(**fields)


@kernel
def _jacobians(parameters: FloatArray, points: FloatArray) -> FloatArray:
    out = np.empty((points.shape[0], 9))
    for i in range(points.shape[0]):
        r = project_point_jacobian(parameters, points[i, 0], points[i, 1], points[i, 2])
        out[i, 0], out[i, 1], out[i, 2], out[i, 3], out[i, 4] = r[0], r[1], r[2], r[3], r[4]
        out[i, 5], out[i, 6], out[i, 7] = r[5], r[6], r[7]
        out[i, 8] = 1.0 if r[8] else 0.0
    return out
