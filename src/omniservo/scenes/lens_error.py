"""A lens that differs a little from its model, by much the same over whole regions of the image."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from omniservo.geometry.arrays import FloatArray, finite_number

_WAVES = 64


@dataclass(frozen=True)
class LensError:
    """A smooth field of displacements d(p) over the image: pixel p shows what the model has at p − d(p).

    A sample of the Gaussian process with covariance σ² exp(−‖p − q‖² / 2ℓ²) in each coordinate, both
    independent, as the sum of 64 random waves (Rahimi & Recht 2007); smooth everywhere.
    """

    sigma: float
    """σ, of each coordinate [px]"""
    length: float
    """ℓ, over which it is alike [px]"""
    seed: int = 0
    """of the sample"""

    def __post_init__(self) -> None:
        finite_number("lens_error: sigma", self.sigma, minimum=0.0)
        finite_number("lens_error: length", self.length, above=0.0)

    def at(self, pixels: FloatArray) -> FloatArray:
        """Return d (…, 2) [px] at pixels (…, 2)."""
        waves, phases = self._sample
        found = np.zeros(pixels.shape)
        for k in range(2):
            for (across, down), phase in zip(
                waves[k], phases[k], strict=True
            ):  # one by one: images are large
                found[..., k] += np.cos(across * pixels[..., 0] + down * pixels[..., 1] + phase)
        return np.asarray(self.sigma * math.sqrt(2.0 / _WAVES) * found)

    @cached_property
    def _sample(self) -> tuple[FloatArray, FloatArray]:
        """Wave vectors (2, k, 2) [1/px] and phases (2, k) [rad]."""
        random = np.random.default_rng(self.seed)
        waves = random.standard_normal((2, _WAVES, 2)) / self.length
        return waves, random.uniform(0.0, 2.0 * math.pi, (2, _WAVES))
