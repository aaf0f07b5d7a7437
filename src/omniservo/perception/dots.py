"""What dot finding returns, and what may be required of it."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from omniservo.errors import InputError
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray, finite_number, owned


@with_field_docs
@dataclass(frozen=True)
class FoundDots:
    """The dots of one image, top to bottom, then left to right."""

    pixels: FloatArray
    """(n, 2) [px] image of each dot's centre (with a camera) or centroid of its image (without)"""
    area_px: FloatArray
    """(n,) [px²] area of each dot's image"""
    covariance: FloatArray
    """(n, 2, 2) [px²] second central moments of each dot's image, its shape, not an uncertainty: an ellipse
    with half axes p, q along orthonormal directions e, f has p²/4·eeᵀ + q²/4·ffᵀ"""

    def __post_init__(self) -> None:
        for item in fields(self):
            object.__setattr__(self, item.name, owned(getattr(self, item.name)))

    def __len__(self) -> int:
        return len(self.pixels)

    @classmethod
    def none(cls) -> FoundDots:
        """The dots of an image without any."""
        return cls(np.zeros((0, 2)), np.zeros(0), np.zeros((0, 2, 2)))


@with_field_docs
@dataclass(frozen=True)
class DotOptions:
    """Limits within which a dark blob counts as a dot."""

    min_contrast: float = 24.0
    """[grey values of 255] the dot is at least so much darker than its ground"""
    max_diameter: float = 90.0
    """[px] longest axis of the largest dot"""
    min_area: float = 8.5
    """[px²] smallest image of a dot; below about 12 its shape can no longer be judged well"""
    min_aspect: float = 0.2
    """shortest over longest axis of the image"""

    def __post_init__(self) -> None:
        finite_number("min_contrast", self.min_contrast, minimum=4, maximum=250)
        finite_number("max_diameter", self.max_diameter, minimum=4, maximum=1000)
        finite_number("min_area", self.min_area, minimum=3)
        finite_number("min_aspect", self.min_aspect, above=0, maximum=1)
        if self.min_area > self.max_diameter**2:
            raise InputError(
                f"min_area: {self.min_area:g} given; legal: at most max_diameter² = {self.max_diameter**2:g}"
            )
