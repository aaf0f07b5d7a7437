"""Where an image needs more than one ray per pixel, and where in the pixel they go."""

from __future__ import annotations

import numpy as np

from omniservo.geometry.arrays import BoolArray, FloatArray, IntArray


def differs_from_neighbour(image: FloatArray | IntArray, contrast: float) -> BoolArray:
    """Return which pixels (height, width) differ by more than ``contrast`` from one of their neighbours."""
    different = np.zeros(image.shape, dtype=bool)
    ahead, behind, every = slice(1, None), slice(None, -1), slice(None)
    pairs = (
        ((ahead, every), (behind, every)),
        ((every, ahead), (every, behind)),
        ((ahead, ahead), (behind, behind)),
        ((ahead, behind), (behind, ahead)),
    )
    for first, second in pairs:
        edge = np.abs(image[first] - image[second]) > contrast
        different[first] |= edge
        different[second] |= edge
    return different


def sheared_grid(per_side: int) -> FloatArray:
    """Return per_side² offsets (n, 2) [px] from a pixel's centre, spread evenly over its square.

    The grid is sheared so that no two share a row or a column: an upright edge that crosses the pixel
    then changes its mean in per_side² steps instead of per_side.
    """
    i, j = np.divmod(np.arange(per_side**2), per_side)
    first = (i + (j + 0.5) / per_side) / per_side
    second = (j + (i + 0.5) / per_side) / per_side
    return np.stack([first, second], axis=-1) - 0.5
