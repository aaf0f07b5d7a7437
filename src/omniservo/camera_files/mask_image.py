"""A mask image, black where the camera sees itself or nothing, as convex polygons that cover the black."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from PIL import Image

from omniservo.cameras.image_mask import MOST_CORNERS, MOST_POLYGONS, ImageMask, distance_beyond, mask_from
from omniservo.errors import InputError
from omniservo.files import read_bytes
from omniservo.files.own_warnings import own_warnings
from omniservo.geometry.arrays import BoolArray, FloatArray, IntArray

_MAX_BYTES = 16 * 2**20
_MAX_PIXELS = 2**24
_FORMATS = ("PNG", "BMP", "PPM", "TIFF", "GIF")
_MODES = ("1", "L", "I", "I;16", "I;16B", "P", "RGB")

_ENOUGH = 1e-3
"""more polygons are not sought once so much of the visible pixels is lost at most"""

_LARGEST_LOSS = 0.02
"""share of the visible pixels that the cover may hide"""

_DIRECTIONS = 8
_CUTS = 7


@dataclass(frozen=True)
class MaskCover:
    """Convex polygons over every hidden pixel, and what they hide beside.

    Covered are the pixels' whole squares: the border of the cover belongs to the image.
    """

    polygons: ImageMask
    """for ``mask=`` of a camera; empty where nothing is hidden"""
    hidden_pixels: int
    """pixels that the image hides"""
    lost_pixels: int
    """visible pixels whose centre is inside a polygon"""
    overhang_px: float
    """the largest distance of such a centre from a hidden pixel's centre [px]"""


def load_mask(path: str | Path, size: tuple[int, int]) -> MaskCover:
    """Cover what a mask image hides, value 0, by at most 64 strictly convex polygons of at most 64 corners.

    The hull of all hidden pixels is cut in two where that gains most, and so on with the piece that loses
    most, until less than 0.1% of the visible pixels are lost or there are 64 pieces: every polygon is the
    convex hull of the pixels' squares in its piece, so that it covers them from outside.

    Args:
        path: a grey, black-and-white or coloured image without losses: PNG, BMP, PGM, TIFF, GIF; at most 16
            MB and 16.8 million pixels. Black, 0 in every channel, is hidden; JPEG is refused, since it
            blurs the border.
        size: (width, height) of the camera's image [px].

    Raises:
        InputError: unreadable, another size than the camera's, everything hidden, or no 64 convex polygons
            that lose at most 2% of the visible pixels.
    """
    hidden = _hidden_pixels(path, size)
    if not hidden.any():
        return MaskCover((), 0, 0, 0.0)
    if hidden.all():
        raise InputError(
            f"{path}: every pixel is hidden (0); legal: 0 where nothing is to be seen, else above"
        )
    pieces = _Pieces(hidden)
    visible = int(hidden.size - hidden.sum())
    while len(pieces.parts) < MOST_POLYGONS and pieces.lost() > _ENOUGH * visible:
        count = len(pieces.parts)
        pieces.cut_the_worst()
        if len(pieces.parts) == count:
            break
    polygons = mask_from([_few_corners(_around_squares(part.hull)) for part in pieces.parts])
    covered = _inside(polygons, hidden.shape)
    if not covered[hidden].all():  # never seen; the promise of this function
        raise InputError(f"{path}: cannot be covered by convex polygons")
    lost = covered & ~hidden
    count = int(lost.sum())
    if count > _LARGEST_LOSS * visible:
        raise InputError(
            f"{path}: {MOST_POLYGONS} convex polygons over what it hides would hide"
            f" {100 * count / visible:.1f}% of the visible pixels, too; legal: at most"
            f" {100 * _LARGEST_LOSS:g}%; simplify it"
        )
    distance = cv2.distanceTransform((~hidden).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    overhang = float(distance[lost].max()) if count else 0.0
    return MaskCover(polygons, int(hidden.sum()), count, overhang)


def _hidden_pixels(path: str | Path, size: tuple[int, int]) -> BoolArray:
    """Return which pixels (height, width) the image hides; its size is checked before it is decoded."""
    data = read_bytes(path, max_bytes=_MAX_BYTES)
    try:
        with own_warnings("ignore"), Image.open(io.BytesIO(data), formats=_FORMATS) as image:
            if image.width * image.height > _MAX_PIXELS:
                raise InputError(
                    f"{path}: {image.width}x{image.height}; at most {_MAX_PIXELS} pixels are read"
                )
            if image.size != tuple(size):
                raise InputError(
                    f"{path}: {image.width}x{image.height} pixels; the camera's image has {size[0]}x{size[1]}"
                )
            if image.mode not in _MODES:
                raise InputError(f"{path}: mode {image.mode} given; legal: grey, black and white, or RGB")
            values = np.asarray(image.convert("RGB") if image.mode == "P" else image)
    except InputError:
        raise
    except Exception as error:  # whatever a broken image makes the decoder raise
        if data[:2] == b"\xff\xd8":
            raise InputError(f"{path}: JPEG blurs a mask's border; legal: {', '.join(_FORMATS)}") from None
        reason = type(error).__name__
        raise InputError(
            f"{path}: not an image that is read ({reason}); legal: {', '.join(_FORMATS)}"
        ) from None
    return np.asarray(values == 0 if values.ndim == 2 else (values == 0).all(axis=2))


@dataclass(frozen=True)
class _Part:
    """Hidden pixels, row by row: those of the columns ``low`` to ``high`` of each row (n,)."""

    rows: IntArray
    low: IntArray
    high: IntArray
    hull: IntArray
    """corners of the convex hull of the pixels' centres (k, 2)"""
    lost: float
    """visible pixels whose centre is in the hull"""


class _Pieces:
    """Hidden pixels in convex pieces; rows are looked up in tables, so that a piece costs its height."""

    def __init__(self, hidden: BoolArray) -> None:
        height, width = hidden.shape
        columns = np.arange(width, dtype=np.int32)
        self._count = np.zeros((height, width + 1), dtype=np.int32)
        np.cumsum(hidden, axis=1, out=self._count[:, 1:])
        self._next = np.full((height, width + 1), width, dtype=np.int32)
        marked = np.where(hidden, columns, np.int32(width))
        self._next[:, :width] = np.minimum.accumulate(marked[:, ::-1], axis=1)[:, ::-1]
        self._last = np.full((height, width + 1), -1, dtype=np.int32)
        marked = np.where(hidden, columns, np.int32(-1))
        self._last[:, 1:] = np.maximum.accumulate(marked, axis=1)
        whole = self._part(np.arange(height), np.zeros(height, dtype=np.int64), np.full(height, width - 1))
        self.parts: list[_Part] = [] if whole is None else [whole]

    def lost(self) -> float:
        """Return how many visible pixels' centres are in the hulls, at most."""
        return sum(part.lost for part in self.parts)

    def cut_the_worst(self) -> None:
        """Cut the piece that loses most where it gains most; a cut never loses more than it finds."""
        index = int(np.argmax([part.lost for part in self.parts]))
        self.parts[index : index + 1] = self._best_cut(self.parts[index])

    def _best_cut(self, part: _Part) -> list[_Part]:
        """Return the two pieces of the line, of 8 directions at 7 places each, that lose least.

        Of equals, as on a ring, the line that leaves the smaller worst piece; a piece that loses something
        can always be cut.
        """
        best, least = [part], (np.inf, np.inf)
        for angle in np.arange(_DIRECTIONS) * np.pi / _DIRECTIONS:
            normal = (float(np.cos(angle)), float(np.sin(angle)))
            along = part.hull @ np.array(normal)
            for offset in np.linspace(along.min(), along.max(), _CUTS + 2)[1:-1]:
                halves = [half for half in self._halves(part, normal, float(offset)) if half is not None]
                losses = [half.lost for half in halves]
                if len(halves) == 2 and (sum(losses), max(losses)) < least:
                    best, least = halves, (sum(losses), max(losses))
        return best

    def _halves(self, part: _Part, normal: tuple[float, float], offset: float) -> list[_Part | None]:
        """Return the pieces on both sides of normal·(u, v) = offset."""
        a, b = normal
        if abs(a) < 1e-9:
            cut = np.where(part.rows * b <= offset, part.high, part.low - 1)
        else:
            places = np.floor((offset - b * part.rows) / a)
            cut = np.clip(places, part.low - 1, part.high).astype(np.int64)
        return [self._part(part.rows, part.low, cut), self._part(part.rows, cut + 1, part.high)]

    def _part(self, rows: IntArray, low: IntArray, high: IntArray) -> _Part | None:
        """Return the piece of these columns, shrunk to its hidden pixels; None without any."""
        first = self._next[rows, low].astype(np.int64)
        last = self._last[rows, high + 1].astype(np.int64)
        held = (low <= high) & (first <= high) & (last >= low)
        if not held.any():
            return None
        rows, first, last = rows[held], first[held], last[held]
        ends = np.concatenate([np.column_stack([first, rows]), np.column_stack([last, rows])])
        hull = cv2.convexHull(ends.astype(np.int32))[:, 0, :].astype(np.int64)
        edges = np.abs(np.roll(hull, -1, axis=0) - hull)
        border = int(np.gcd(edges[:, 0], edges[:, 1]).sum()) if len(hull) > 1 else 0
        # Pick's theorem: so many points of the grid are in the hull or on it
        inside = cv2.contourArea(hull.astype(np.int32)) + border / 2 + 1
        count = int((self._count[rows, last + 1] - self._count[rows, first]).sum())
        return _Part(rows, first, last, hull, max(inside - count, 0.0))


def _around_squares(hull: IntArray) -> FloatArray:
    """Return the hull of the unit squares around the corners of a convex hull of pixels' centres."""
    shifts = np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]])
    points = (2 * hull[:, None, :] + shifts).reshape(-1, 2).astype(np.int32)
    return np.asarray(cv2.convexHull(points)[:, 0, :] / 2.0)


def _few_corners(hull: FloatArray) -> FloatArray:
    """Return a strictly convex polygon of at most 64 corners around a convex one, by leaving edges out.

    Two neighbours of an edge are prolonged until they meet; the edge that adds least area goes first.
    """
    corners = _strictly_convex(hull)
    while len(corners) > MOST_CORNERS:
        before, one, two, after = (np.roll(corners, k, axis=0) for k in (1, 0, -1, -2))
        first, second = one - before, two - after
        across = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
        gap = two - one
        with np.errstate(divide="ignore", invalid="ignore"):
            step = (gap[:, 0] * second[:, 1] - gap[:, 1] * second[:, 0]) / across
        tips = one + step[:, None] * first
        area = 0.5 * np.abs(gap[:, 0] * (tips - one)[:, 1] - gap[:, 1] * (tips - one)[:, 0])
        area[~(step > 0.0) | ~np.isfinite(area)] = np.inf
        k = int(area.argmin())
        corners[k] = tips[k] + 1e-9 * (tips[k] - corners.mean(axis=0))
        corners = _strictly_convex(np.delete(corners, (k + 1) % len(corners), axis=0))
    return corners


def _strictly_convex(corners: FloatArray) -> FloatArray:
    """Return the corners that are not on a line with their neighbours."""
    before, after = corners - np.roll(corners, 1, axis=0), np.roll(corners, -1, axis=0) - corners
    turn = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    return np.asarray(
        corners[np.abs(turn) > 1e-9 * np.linalg.norm(before, axis=1) * np.linalg.norm(after, axis=1)]
    )


def _inside(mask: ImageMask, shape: tuple[int, ...]) -> BoolArray:
    """Return which pixels' centres (height, width) lie inside a polygon."""
    inside = np.zeros(shape, dtype=np.bool_)
    for polygon in mask:
        corners = np.array(polygon)
        low = np.maximum(np.floor(corners.min(axis=0)).astype(int), 0)
        high = np.minimum(np.ceil(corners.max(axis=0)).astype(int) + 1, [shape[1], shape[0]])
        for v in range(low[1], high[1]):
            row = np.column_stack([np.arange(low[0], high[0]), np.full(high[0] - low[0], v)]).astype(
                np.float64
            )
            inside[v, low[0] : high[0]] |= distance_beyond((polygon,), row) < 0.0
    return inside
