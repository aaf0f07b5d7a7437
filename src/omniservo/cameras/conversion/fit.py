"""Fitting a camera of one class to another model, in pixels, over the field that is used."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from omniservo.cameras.conversion.equivalence import lens_of
from omniservo.cameras.conversion.families import FitFamily
from omniservo.cameras.conversion.least_maximum import least_maximum
from omniservo.cameras.conversion.residual import rim_pixels, used_pixels
from omniservo.cameras.models import Pinhole
from omniservo.cameras.models.central_model import CentralModel
from omniservo.cameras.unified_camera import UnifiedCamera
from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray

_GRID = 25
_KEPT_STARTS = 2
_ITERATIONS = 25
_STEP = 1e-4
_LEAST_PART = 1e-3
"""of the largest number of the axis's ∂pixel/∂(X, Y), that each one of its diagonal is at least"""
_FARTHEST = math.radians(150.0)
"""rays beyond are left out of the fit, though not of its residual: no formula but an angle's reaches them"""


@dataclass(frozen=True, eq=False)
class Field:
    """What a fit has to meet: the rays of the used pixels, and K's shape at the axis."""

    pixels: FloatArray
    rays: FloatArray
    local: FloatArray
    """∂pixel/∂(X, Y) at (0, 0, 1), upper triangle (2, 2) [px]"""
    center: FloatArray
    symmetric: bool
    """whether the model looks the same all round its axis, up to K"""


def field_of(model: CentralModel) -> Field:
    """Return the field that ``model`` uses.

    Raises:
        InputError: next to nothing of its image is valid, or it is turned about the axis.
    """
    pixels = used_pixels(model, _GRID)
    rays = model.unproject(pixels)[0] if len(pixels) else np.zeros((0, 3))
    near = rays[:, 2] > math.cos(_FARTHEST)
    if near.sum() < 20:
        raise InputError("camera: next to nothing of its image lies in its domain; it cannot be converted")
    axis = np.array([[0, 0, 1.0], [_STEP, 0, 1], [-_STEP, 0, 1], [0, _STEP, 1], [0, -_STEP, 1]])
    p = model.project(axis)[0]
    local = np.column_stack([p[1] - p[2], p[3] - p[4]]) / (2.0 * _STEP)
    local[1, 0] = 0.0
    if min(abs(local[0, 0]), abs(local[1, 1])) < _LEAST_PART * np.abs(local).max():
        raise InputError("camera: its image is turned about the axis; legal: u grows with x alone, v with y")
    if abs(local[0, 1]) < 1e-6 * abs(local[0, 0]):
        local[0, 1] = 0.0
    return Field(pixels[near], rays[near], local, p[0], _is_symmetric(model))


def fitted(field: Field, family: FitFamily, model: CentralModel) -> CentralModel | None:
    """Return the family's camera that leaves the smallest largest residual [px], or None where none fits.

    From every starting shape the scale and the radial coefficients follow from linear least squares; the best
    starts are refined in all numbers by least squares, and the best of these by `least_maximum`.
    """
    free = _Free(field, family)
    starts = [vector for start in family.starts if (vector := free.start(start)) is not None]
    starts.sort(key=free.squares)
    refined = [free.refined(vector) for vector in starts[:_KEPT_STARTS]]
    if not refined:
        return None
    best = least_maximum(free.differences, min(refined, key=free.squares))
    lens = lens_of(model)
    camera = family.build(*free.split(best), lens)
    if camera.usable_angle > model.usable_angle and len(rim_pixels(model)):
        camera = family.build(*free.split(best), {**lens, "max_angle": model.usable_angle})
    return camera


class _Free:
    """The numbers that a fit changes: (fx, fy, cx, cy[, skew], shape…) in the field's own scale."""

    def __init__(self, field: Field, family: FitFamily) -> None:
        self.field, self.family = field, family
        self.scale = math.sqrt(abs(field.local[0, 0] * field.local[1, 1]))
        self.skewed = family.skew and field.local[0, 1] != 0.0
        self.tangential = family.tangential and not field.symmetric

    def start(self, shape: tuple[float, ...]) -> FloatArray | None:
        """Return the vector that fits best with this starting shape, or None where it fits nothing."""
        field = self.field
        offsets = np.linalg.solve(field.local, (field.pixels - field.center).T)
        basis = self.family.basis(shape, field.rays)
        coefficients = np.linalg.lstsq(basis, np.hypot(*offsets), rcond=None)[0]
        if not coefficients[0] > 0.0:
            return None
        own = np.zeros(self.family.size)
        found = [*shape, *(coefficients[1:] / coefficients[0])]
        own[: len(found)] = found
        fx, skew, fy = coefficients[0] * field.local[[0, 0, 1], [0, 1, 1]] / self.scale
        K = [fx, fy, *(field.center / self.scale), *([skew] if self.skewed else [])]
        return np.concatenate([K, own, np.zeros(2 if self.tangential else 0)])

    def split(self, vector: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return K as (fx, fy, cx, cy, skew) [px], and the shape."""
        count = 5 if self.skewed else 4
        K = np.zeros(5)
        K[:count] = vector[:count] * self.scale
        return K, vector[count:]

    def differences(self, vector: FloatArray) -> FloatArray:
        """Return projected minus given pixels (n, 2) [px]."""
        K, shape = self.split(vector)
        with np.errstate(all="ignore"):
            m = self.family.plane(shape, self.field.rays)
            u = K[0] * m[:, 0] + K[4] * m[:, 1] + K[2]
            pixels = np.column_stack([u, K[1] * m[:, 1] + K[3]])
        return np.asarray(np.clip(np.nan_to_num(pixels - self.field.pixels, nan=1e6), -1e6, 1e6))

    def _raveled(self, vector: FloatArray) -> FloatArray:
        return self.differences(vector).ravel()

    def squares(self, vector: FloatArray) -> float:
        """Return the sum of squares [px²]."""
        return float((self.differences(vector) ** 2).sum())

    def refined(self, vector: FloatArray) -> FloatArray:
        """Return the least-squares vector near ``vector``."""
        from scipy.optimize import least_squares  # slow to import, and few cameras are converted

        result = least_squares(
            self._raveled,
            vector,
            method="lm",
            x_scale="jac",
            max_nfev=_ITERATIONS * (len(vector) + 1),
        )
        return np.asarray(result.x)


def _is_symmetric(model: CentralModel) -> bool:
    """Say whether the model is free of tangential, prism and tilt parts."""
    if isinstance(model, UnifiedCamera):
        return not any(model.distortion[2:])
    if isinstance(model, Pinhole):
        return not any((*model.distortion[2:4], *model.distortion[8:]))
    return True
