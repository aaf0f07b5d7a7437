"""Points of one image with the error of their location: what every kind of feature gives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from omniservo.errors import InputError
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray, IntArray, finite_array, owned

_SLACK = 1e-9
"""a covariance may be so far from symmetric and definite, relative to its size"""


@with_field_docs
@dataclass(frozen=True, eq=False)
class ImagePoints:
    """Located points of one image.

    Raises:
        InputError: not finite, shapes that do not belong together, a covariance that is none, or an id that
            stands twice.
    """

    pixels: FloatArray
    """(n, 2) [px]"""
    covariance: FloatArray
    """(n, 2, 2) [px²] of the location's error"""
    ids: IntArray | None = None
    """(n,) which point it is, the same in every image; None: unknown"""

    def __post_init__(self) -> None:
        pixels = finite_array("pixels", self.pixels, (None, 2))
        covariance = finite_array("covariance", self.covariance, (len(pixels), 2, 2))
        object.__setattr__(self, "pixels", owned(pixels))
        object.__setattr__(self, "covariance", owned(_checked(covariance)))
        if self.ids is not None:
            object.__setattr__(self, "ids", _distinct(self.ids, len(pixels)))

    def __len__(self) -> int:
        return len(self.pixels)


def _checked(covariance: FloatArray) -> FloatArray:
    a, b, c, d = covariance.reshape(-1, 4).T
    size = np.abs(covariance).max(axis=(1, 2), initial=0.0)
    bad = (np.abs(b - c) > _SLACK * size) | (np.minimum(a, d) < 0.0) | (a * d - b * c < -_SLACK * size**2)
    if bad.any():
        first = int(np.argmax(bad))
        given = covariance[first].tolist()
        raise InputError(f"covariance: {given} at index {first}; symmetric, positive semidefinite is needed")
    return covariance


def _distinct(ids: npt.ArrayLike, count: int) -> IntArray:
    given = np.array(ids)
    if given.shape != (count,) or (count and given.dtype.kind not in "iu"):
        raise InputError(f"ids: {given.dtype} of shape {given.shape} given; ({count},) whole numbers needed")
    value, times = np.unique(given, return_counts=True)
    if (times > 1).any():
        raise InputError(f"ids: {value[times > 1][0]} stands twice; each point has its own")
    result = given.astype(np.int64)
    result.setflags(write=False)
    return result
