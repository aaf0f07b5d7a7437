"""The picture of a tag, to print it or to put it into a rendered scene."""

from __future__ import annotations

import cv2
import numpy as np

from omniservo.geometry.arrays import ByteArray, FloatArray, finite_number
from omniservo.tag_dictionaries import dictionary, dictionary_size

QUIET_CELLS = 1
"""width of the white border around the tag's black square, in cells"""
_MOST_PIXELS_PER_CELL = 1000


def tag_picture(name: str, tag_id: int, *, pixels_per_cell: int = 8) -> ByteArray:
    """Return a tag as it is printed, dark 0 and bright 255, with its white border.

    The tag is a square of `tag_cells` × `tag_cells` cells whose outermost are black; around it stand
    `QUIET_CELLS` white ones. All cells have whole pixels.

    Args:
        name: of the dictionary; see `dictionary_names`.
        tag_id: 0 … `dictionary_size` − 1.
        pixels_per_cell: side of a cell [px].

    Returns:
        (side, side), side = (`tag_cells` + 2·`QUIET_CELLS`)·pixels_per_cell.

    Raises:
        InputError: no such dictionary, no such tag, or not a legal size.
    """
    number = _whole("tag_id", tag_id, 0, dictionary_size(name) - 1)
    scale = _whole("pixels_per_cell", pixels_per_cell, 1, _MOST_PIXELS_PER_CELL)
    cells = cv2.aruco.generateImageMarker(dictionary(name), number, tag_cells(name))
    framed = np.pad(cells, QUIET_CELLS, constant_values=255)
    return np.repeat(np.repeat(framed, scale, axis=0), scale, axis=1)


def tag_cells(name: str) -> int:
    """Return the cells along a side of a tag's black square: the code's, and a black one on each side."""
    return int(dictionary(name).markerSize) + 2


def tag_picture_corners(name: str, *, pixels_per_cell: int = 8) -> FloatArray:
    """Return where the black square's corners lie in `tag_picture` (4, 2) [px].

    They lie on the outer edges of pixels. The order is that of `find_tags`: top left, top right, bottom
    right, bottom left of the tag as printed.
    """
    low = QUIET_CELLS * pixels_per_cell - 0.5
    high = low + tag_cells(name) * pixels_per_cell
    return np.array([[low, low], [high, low], [high, high], [low, high]])


def _whole(name: str, value: int, low: int, high: int) -> int:
    number = finite_number(name, value, minimum=low, maximum=high)
    return int(finite_number(name, value, minimum=int(number), maximum=int(number)))
