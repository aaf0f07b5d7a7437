"""The same points in several images, as `estimate_views` takes them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from omniservo.cameras.conversion import UnifiedImage
from omniservo.errors import InputError
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import BoolArray, FloatArray, finite_array, finite_number, refuse_masked
from omniservo.short_repr import short_repr


@with_field_docs
@dataclass(frozen=True, eq=False)
class ViewPoints:
    """n points in v images."""

    pixels: npt.ArrayLike
    """(v, n, 2) [px], [i, j] shows point j in view i"""
    visible: npt.ArrayLike | None = None
    """(v, n) bool: the pixels of others are not read. None: all"""
    noise: float | npt.ArrayLike | None = None
    """σ of a pixel coordinate [px]: one number, or (v, n); None: from the residuals"""
    window: npt.ArrayLike | None = None
    """(v, n) standard deviation [px] of the window that each was measured in: where two of one view overlap,
    they err alike (`MatchedPoints.window`). None: every pixel errs by itself"""

    __repr__ = short_repr


@dataclass(frozen=True, eq=False)
class CheckedPoints:
    """The same, checked."""

    pixels: FloatArray
    """(v, n, 2), 0 where not seen"""
    bearings: FloatArray
    """(v, n, 3)"""
    seen: BoolArray
    """(v, n)"""
    noise: FloatArray | None
    """(v, n), 1 where not seen"""
    window: FloatArray | None
    """(v, n), 1 where not seen"""

    @classmethod
    def of(cls, image: UnifiedImage, given: ViewPoints, robust: bool) -> CheckedPoints:
        """Return them checked, as the unified camera sees them.

        ``robust``: without those outside the camera's domain, where they are few.

        Raises:
            InputError: shapes, numbers that are not finite, or pixels outside the camera's domain.
        """
        pixels = np.asanyarray(given.pixels)  # a masked array stays one, and is refused where it is read
        refuse_masked("visible", given.visible)
        if pixels.ndim != 3 or pixels.shape[2] != 2 or len(pixels) < 2:
            raise InputError(f"pixels: shape {pixels.shape} given; (v, n, 2) with v ≥ 2 is needed")
        shape = pixels.shape[:2]
        seen = np.ones(shape, dtype=np.bool_) if given.visible is None else np.asarray(given.visible)
        if seen.dtype != np.bool_ or seen.shape != shape:
            raise InputError(f"visible: {seen.dtype} {seen.shape} given; bool {shape} is needed")
        rows = np.zeros((*shape, 2))
        rows[seen] = finite_array("pixels (visible rows)", pixels[seen], (None, 2)) if seen.any() else 0.0
        bearings, valid = image.own.unproject(rows)
        if robust and 2 * np.count_nonzero(seen & valid) >= np.count_nonzero(seen):
            seen = seen & valid
        if not valid[seen].all():
            i, j = (int(x) for x in np.argwhere(seen & ~valid)[0])
            raise InputError(
                f"pixels: ({rows[i, j, 0]:g}, {rows[i, j, 1]:g}) at index ({i}, {j}) is outside the camera's"
                f" domain (at most {math.degrees(image.own.usable_angle):.1f}° from the axis)"
            )
        noise, window = given.noise, given.window
        if noise is not None and np.ndim(noise) == 0:
            noise = np.full(shape, finite_number("noise", noise, above=0.0))
        scale = image.scale(rows)
        sigmas, widths = (
            None if checked is None else np.where(seen, scale * checked, 1.0)
            for checked in (_positive("noise", noise, seen), _positive("window", window, seen))
        )
        return cls(np.where(seen[..., None], image.carried(rows), 0.0), bearings, seen.copy(), sigmas, widths)


def _positive(name: str, values: Any, seen: BoolArray) -> FloatArray | None:
    if values is None:
        return None
    given = np.asanyarray(values, dtype=np.float64)
    if given.shape != seen.shape:
        raise InputError(f"{name}: shape {given.shape} given; {seen.shape} is needed, one for each pixel")
    refuse_masked(name, given[seen])
    given = np.asarray(given)
    bad = seen & ~(np.isfinite(given) & (given > 0.0))
    if bad.any():
        raise InputError(f"{name}: {given[bad][0]:g} given; legal: > 0 [px], finite")
    return np.where(seen, given, 1.0)
