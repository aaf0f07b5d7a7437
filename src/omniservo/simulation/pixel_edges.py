"""Where an image needs no ray per pixel, where one, where many, and where in the pixel they go."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from omniservo.geometry.arrays import BoolArray, FloatArray, IntArray


def differs_from_neighbour(image: FloatArray | IntArray | BoolArray, contrast: float = 0.0) -> BoolArray:
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
        a, b = image[first], image[second]
        edge = np.abs(a - b) > contrast if contrast > 0.0 else a != b
        different[first] |= edge
        different[second] |= edge
    return different


def fill_between_alike(images: Sequence[NDArray[Any]], legal: BoolArray) -> BoolArray:
    """Fill, in place, what lies between four nodes that are alike; return the filled pixels (height, width).

    Nodes are every second pixel of every second row; four in a square are alike where each image has one
    value at all of them.

    Args:
        images: (height, width) each, known at the nodes.
        legal: (height, width) the pixels that may be filled.
    """
    nodes = [image[::2, ::2] for image in images]
    alike = legal[::2, ::2][:-1, :-1].copy()
    rows, columns = alike.shape
    filled = np.zeros_like(legal)
    for down, across in ((0, 1), (1, 0), (1, 1)):
        for node in nodes:
            alike &= node[down : rows + down, across : columns + across] == node[:-1, :-1]
    for down, across in ((0, 0), (0, 1), (1, 0), (1, 1)):
        part = (slice(down, 2 * rows, 2), slice(across, 2 * columns, 2))
        filled[part] = alike & legal[part]
        for image, node in zip(images, nodes, strict=True):
            np.copyto(image[part], node[:-1, :-1], where=filled[part])
    return filled


def sheared_grid(per_side: int) -> FloatArray:
    """Return per_side² offsets (n, 2) [px] from a pixel's centre, spread evenly over its square.

    The grid is sheared so that no two share a row or a column: an upright edge that crosses the pixel
    then changes its mean in per_side² steps instead of per_side.
    """
    i, j = np.divmod(np.arange(per_side**2), per_side)
    first = (i + (j + 0.5) / per_side) / per_side
    second = (j + (i + 0.5) / per_side) / per_side
    return np.stack([first, second], axis=-1) - 0.5
