"""Where in the image boards were seen."""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np

from omniservo.geometry.arrays import BoolArray, FloatArray

_LONGEST = 512


def raster_size(size: tuple[int, int]) -> tuple[int, int]:
    """Return (width, height) of a raster of at most 512 px for an image of ``size`` (width, height) [px]."""
    shrink = min(1.0, _LONGEST / max(size))
    return max(1, round(size[0] * shrink)), max(1, round(size[1] * shrink))


def inside_outlines(corners: Iterable[FloatArray], size: tuple[int, int]) -> BoolArray:
    """Return which parts of an image lie inside the outline of at least one view's corners.

    Args:
        corners: (n, 2) of each view [px].
        size: (width, height) of the image [px].

    Returns:
        (rows, columns) of a raster of `raster_size`.
    """
    width, height = raster_size(size)
    shrink = min(1.0, _LONGEST / max(size))
    raster = np.zeros((height, width), dtype=np.uint8)
    for pixels in corners:
        cv2.fillConvexPoly(raster, cv2.convexHull((pixels * shrink).round().astype(np.int32)), 1)
    return raster > 0
