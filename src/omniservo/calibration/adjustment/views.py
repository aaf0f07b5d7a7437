"""The corners of all views in flat arrays, checked."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from omniservo.errors import InputError, spelled
from omniservo.geometry.arrays import FloatArray, IntArray, finite_number, refuse_masked

_LARGEST_IMAGE = 100_000
_LARGEST_VIEWS = 10_000
_LARGEST_M = 1e6
_FLAT = 1e-3
"""a target whose thickness is less than this part of its extent counts as planar"""

_LINE = 0.02
"""corners within a strip this much narrower than long are on a line"""


@dataclass(frozen=True, eq=False)
class Views:
    """Corners of V views, one after the other in flat arrays of N rows."""

    pixels: FloatArray
    """(N, 2) [px]"""
    points: FloatArray
    """(N, 3) on the targets [m]"""
    ends: IntArray
    """(V + 1,): view i has the rows ends[i]:ends[i+1]"""
    numbers: IntArray
    """(V,) their places in the caller's lists"""

    @property
    def count(self) -> int:
        """V."""
        return len(self.numbers)

    @cached_property
    def row_view(self) -> IntArray:
        """(N,) the view of each row."""
        return np.repeat(np.arange(self.count), np.diff(self.ends))

    def rows(self, view: int) -> slice:
        """Return the rows of a view."""
        return slice(int(self.ends[view]), int(self.ends[view + 1]))

    def centred(self) -> tuple[Views, FloatArray]:
        """Return the views with each target moved to its corners' middle, and the middles (V, 3) [m]."""
        parts = [self.points[self.rows(i)].mean(axis=0) for i in range(self.count)]
        middles = np.array(parts).reshape(-1, 3)
        return replace(self, points=self.points - middles[self.row_view]), middles

    def some(self, chosen: IntArray | Sequence[int]) -> Views:
        """Return the ``chosen`` views alone."""
        rows = self.rows_of(chosen)
        sizes = np.diff(self.ends)[chosen]
        ends = np.concatenate([[0], np.cumsum(sizes)])
        return Views(self.pixels[rows], self.points[rows], ends, self.numbers[chosen])

    def rows_of(self, chosen: IntArray | Sequence[int]) -> IntArray:
        """Return the rows of the ``chosen`` views, in their order."""
        parts = [np.arange(self.ends[i], self.ends[i + 1]) for i in chosen]
        return np.concatenate([np.empty(0, dtype=np.int64), *parts])

    def median(self, values: FloatArray) -> FloatArray:
        """Return each view's median (V,) of ``values`` (N,)."""
        return np.array([np.median(values[self.rows(i)]) for i in range(self.count)])


def read_views(
    image_points: Sequence[npt.ArrayLike], object_points: Sequence[npt.ArrayLike], size: tuple[int, int]
) -> tuple[Views, dict[int, str]]:
    """Return the views that can be used at all, and why each other one cannot.

    Raises:
        InputError: lists of different lengths, arrays of another shape, NaN, or a corner outside the image;
            the message names view and row.
    """
    for name, value in (("image_points", image_points), ("object_points", object_points)):
        if isinstance(value, str | bytes) or not hasattr(value, "__len__"):
            raise InputError(f"{name}: {spelled(value)} given; a list with one array a view is needed")
    if len(image_points) != len(object_points):
        raise InputError(
            f"object_points: {len(object_points)} views given, image_points has {len(image_points)}; "
            "each view needs both"
        )
    if len(image_points) > _LARGEST_VIEWS:
        raise InputError(f"image_points: {len(image_points)} views given; legal: at most {_LARGEST_VIEWS}")
    pixels, points, numbers, dropped = [], [], [], {}
    for i, (seen, known) in enumerate(zip(image_points, object_points, strict=True)):
        p, q = _rows(f"image_points[{i}]", seen, 2), _rows(f"object_points[{i}]", known, 3)
        if len(p) != len(q):
            raise InputError(f"object_points[{i}]: {len(q)} rows given, image_points[{i}] has {len(p)}")
        _check_inside(i, p, size)
        reason = _useless(p, q)
        if reason:
            dropped[i] = reason
        else:
            pixels.append(p)
            points.append(q)
            numbers.append(i)
    ends = np.concatenate([[0], np.cumsum([len(p) for p in pixels])]).astype(np.int64)
    flat = np.concatenate([np.empty((0, 2)), *pixels]), np.concatenate([np.empty((0, 3)), *points])
    return Views(*flat, ends, np.array(numbers, dtype=np.int64)), dropped


def read_size(image_size: Any) -> tuple[int, int]:
    """Return (width, height) [px].

    Raises:
        InputError: not two whole numbers of pixels.
    """
    if isinstance(image_size, str | bytes) or not hasattr(image_size, "__len__") or len(image_size) != 2:
        raise InputError(f"image_size: {spelled(image_size)} given; legal: (width, height) [px]")
    sides = [finite_number("image_size", s, minimum=1.0, maximum=_LARGEST_IMAGE) for s in image_size]
    if any(side != int(side) for side in sides):
        raise InputError(f"image_size: {spelled(image_size)} given; legal: whole numbers of pixels")
    return int(sides[0]), int(sides[1])


def flatness(points: FloatArray) -> tuple[FloatArray, FloatArray, bool]:
    """Return a target's centre (3,), its axes as columns (3, 3), right-handed, and whether it is planar.

    The third axis is across the plane of the corners and points to the side of +z.
    """
    centre = points.mean(0)
    _, extents, axes = np.linalg.svd(points - centre, full_matrices=True)
    third = axes[2] if axes[2][np.argmax(np.abs(axes[2]))] > 0.0 else -axes[2]
    first = axes[0]
    basis = np.stack([first, np.cross(third, first), third], 1)
    return centre, basis, bool(len(extents) < 3 or extents[2] <= _FLAT * extents[0])


def _rows(name: str, value: npt.ArrayLike, width: int) -> FloatArray:
    """Return (k, width) floats; a NaN is refused with its row."""
    refuse_masked(name, value)
    try:
        array = np.asarray(value)
        if array.dtype.kind not in "fiu":
            raise TypeError
        array = np.array(array, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{name}: {spelled(value)} given; numbers (k, {width}) are needed") from None
    if array.ndim == 3 and 1 in array.shape[:2]:  # OpenCV's (k, 1, width) and (1, k, width)
        array = array.reshape(-1, array.shape[2])
    if array.size == 0:
        array = np.empty((0, width))
    if array.ndim != 2 or array.shape[1] != width:
        raise InputError(f"{name}: shape {array.shape} given; (k, {width}) is needed")
    bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
    if len(bad):
        raise InputError(f"{name}: row {bad[0]}: {array[bad[0]].tolist()} given; finite numbers are needed")
    if len(array) and np.abs(array).max() > _LARGEST_M:
        row = int(np.argmax(np.abs(array).max(axis=1)))
        raise InputError(f"{name}: row {row}: {array[row].tolist()} given; legal: at most {_LARGEST_M:g}")
    return array


def _check_inside(view: int, pixels: FloatArray, size: tuple[int, int]) -> None:
    outside = np.flatnonzero(((pixels < -0.5) | (pixels > np.array(size) - 0.5)).any(axis=1))
    if len(outside):
        u, v = pixels[outside[0]]
        raise InputError(
            f"image_points[{view}]: row {outside[0]}: ({u:.6g}, {v:.6g}) given; outside the image of "
            f"{size[0]} × {size[1]} px: another image's corners, or a wrong image_size"
        )


def _useless(pixels: FloatArray, points: FloatArray) -> str:
    """Return why a view says nothing about the camera, or ""."""
    least = 4 if len(points) < 4 or flatness(points)[2] else 6
    if len(points) < least:
        kind = "" if least == 4 else " of a target that is not flat"
        return f"{len(points)} corners{kind}; at least {least} are needed"
    for kind, rows in (("on the board", points), ("in the image", pixels)):
        extents = np.linalg.svd(rows - rows.mean(0), compute_uv=False)
        if extents[1] <= _LINE * extents[0]:
            return f"its corners lie on a line {kind}"
    return ""
