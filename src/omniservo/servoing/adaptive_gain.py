"""A gain that grows as the error vanishes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray, finite_number


@with_field_docs
@dataclass(frozen=True)
class AdaptiveGain:
    """λ(x) = (λ₀ − λ∞) exp(−λ₀′ x / (λ₀ − λ∞)) + λ∞ of x = ‖L⁺e‖∞, as ViSP's ``vpAdaptiveGain`` has it."""

    at_zero: float
    """λ₀, where the error vanishes [1/s]"""
    at_infinity: float
    """λ∞, far away [1/s]"""
    slope_at_zero: float
    """λ₀′ ≥ 0: how fast the gain falls there"""

    def __post_init__(self) -> None:
        finite_number("at_infinity", self.at_infinity, above=0.0)
        finite_number("at_zero", self.at_zero, above=self.at_infinity)
        finite_number("slope_at_zero", self.slope_at_zero, minimum=0.0)

    def __call__(self, twist: FloatArray) -> float:
        """Return the gain [1/s] for L⁺e (6,), the twist at gain −1."""
        span = self.at_zero - self.at_infinity
        return span * math.exp(-self.slope_at_zero * float(np.abs(twist).max()) / span) + self.at_infinity


Gain = float | AdaptiveGain
"""λ: a number [1/s], or one that adapts."""


def refuse_wrong_gain(gain: Gain) -> None:
    """Raise `InputError` unless it is a positive number or an `AdaptiveGain`."""
    if not isinstance(gain, AdaptiveGain):
        finite_number("gain", gain, above=0.0)
