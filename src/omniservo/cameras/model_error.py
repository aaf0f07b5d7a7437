"""How far a camera's model is off: an error that is alike over regions of the image."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.distance import cdist

from omniservo.errors import InputError, spelled
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray, finite_number

_LARGEST_PX = 1e3
_LARGEST_LENGTH = 1e6

USUAL_LENGTH = 0.1
"""of the image's longer side, over which the error is alike where nothing else is known"""

NEGLIGIBLE = 1e-3
"""of the variance σ² that `ModelError.rows` may leave out"""


@with_field_docs
@dataclass(frozen=True)
class ModelError:
    """Error e(u) of a camera model's pixels: each coordinate is a Gaussian field over the image.

    E[e(u)] = 0, E[e(u) e(u')] = σ² exp(−‖u − u'‖²/(2ℓ²)), the two coordinates independent. True pixel =
    model's pixel + e. All images of a camera share one e: a point that stays where it is has one error.

    Raises:
        InputError: a number that is not finite or not legal.
    """

    sigma_px: float
    """σ of a pixel coordinate [px], ≥ 0"""
    length_px: float
    """ℓ > 0 [px], the distance over which errors are alike"""

    def __post_init__(self) -> None:
        for name, least in (("sigma_px", {"minimum": 0.0}), ("length_px", {"above": 0.0})):
            most = _LARGEST_PX if name == "sigma_px" else _LARGEST_LENGTH
            number = finite_number(f"model_error.{name}", getattr(self, name), maximum=most, **least)
            object.__setattr__(self, name, number)

    def covariance(self, pixels: FloatArray, others: FloatArray) -> FloatArray:
        """Return the covariance (n, m) [px²] of a coordinate at pixels (n, 2) with one at others (m, 2)."""
        squares = cdist(pixels, others, "sqeuclidean")
        return np.asarray(self.sigma_px**2 * np.exp(-squares / (2.0 * self.length_px**2)))

    def rows(self, pixels: FloatArray) -> FloatArray:
        """Return independent errors (k, n) [px], one σ each, of one coordinate at pixels (n, 2).

        Σ rowᵀrow is the covariance, with at most `NEGLIGIBLE` of σ² left out at a pixel: pivoted Cholesky.
        """
        n = len(pixels)
        if n == 0 or self.sigma_px == 0.0:
            return np.empty((0, n))
        left = np.full(n, self.sigma_px**2)
        least, rows = NEGLIGIBLE * self.sigma_px**2, np.empty((min(n, 64), n))
        for k in range(n):
            pivot = int(np.argmax(left))
            if left[pivot] <= least:
                return rows[:k].copy()
            if k == len(rows):
                rows = np.concatenate((rows, np.empty_like(rows)))
            row = self.covariance(pixels[pivot : pivot + 1], pixels)[0] - rows[:k, pivot] @ rows[:k]
            rows[k] = row / math.sqrt(left[pivot])
            left -= np.square(rows[k])
        return rows[:n].copy()

    def moves(self, pixels: FloatArray) -> FloatArray:
        """Return independent errors (2k, n, m) [px] of points' pixels (n, m), u and v in turn along m.

        One camera sees all of them, m/2 images of each point.
        """
        n = len(pixels)
        along = self.rows(pixels.reshape(-1, 2)).reshape(-1, n, pixels.shape[1] // 2)
        moves = np.zeros((2, *along.shape, 2))
        moves[0, ..., 0] = moves[1, ..., 1] = along
        return moves.reshape(2 * len(along), n, pixels.shape[1])

    def with_residual(self, rms_px: float) -> ModelError:
        """Return the error with a distance ``rms_px`` [px] added in quadrature, half to each coordinate."""
        return ModelError(math.hypot(self.sigma_px, rms_px / math.sqrt(2.0)), self.length_px)

    def __str__(self) -> str:
        return f"{self.sigma_px:.2g} px (1σ), alike over {self.length_px:.0f} px"

    def to_dict(self) -> dict[str, float]:
        """Return σ and ℓ as they stand in a file."""
        return {"sigma_px": self.sigma_px, "length_px": self.length_px}


def model_error_from(value: Any) -> ModelError | None:
    """Return what a camera states of its error: a `ModelError`, its fields, or None: nothing is stated.

    Raises:
        InputError: something else.
    """
    if value is None or isinstance(value, ModelError):
        return value
    if not isinstance(value, Mapping) or set(value) != {"sigma_px", "length_px"}:
        raise InputError(f"model_error: {spelled(value)} given; legal: {{sigma_px: …, length_px: …}}")
    return ModelError(**value)


def usual_model_error(sigma_px: float, width: int, height: int) -> ModelError:
    """Return an error of this size, alike over `USUAL_LENGTH` of the image's longer side."""
    return ModelError(sigma_px, USUAL_LENGTH * max(width, height))
