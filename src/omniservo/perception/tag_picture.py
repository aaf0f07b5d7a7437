"""The image of a tag, to print it or to put it into a rendered scene."""

from __future__ import annotations

import numpy as np

from omniservo.geometry.arrays import ByteArray, FloatArray, finite_number
from omniservo.tag_dictionaries import dark_cells, dictionary_size, tag_layout

_MOST_PIXELS_PER_CELL = 1000


def tag_picture(name: str, tag_id: int, *, pixels_per_cell: int = 8) -> ByteArray:
    """Return a tag as it is printed, dark 0 and bright 255.

    The tag is a square of cells, all of whole pixels. In the middle is a square of `tag_cells` × `tag_cells`
    of them, whose outermost are black and which has a ring of white ones around it; of an AprilTag 3 family
    the outermost are white, and around stand a black ring and more of the code.

    Args:
        name: of the dictionary; see `dictionary_names`.
        tag_id: 0 … `dictionary_size` − 1.
        pixels_per_cell: side of a cell [px].

    Returns:
        (side, side), side = `TagLayout.cells`·pixels_per_cell.

    Raises:
        InputError: no such dictionary, no such tag, or not a legal size.
    """
    number = _whole("tag_id", tag_id, 0, dictionary_size(name) - 1)
    scale = _whole("pixels_per_cell", pixels_per_cell, 1, _MOST_PIXELS_PER_CELL)
    cells = np.where(dark_cells(name, np.array([number]))[0], 0, 255).astype(np.uint8)
    return np.repeat(np.repeat(cells, scale, axis=0), scale, axis=1)


def tag_cells(name: str) -> int:
    """Return the cells along a side of the square whose corners are a tag's, of which `tag_picture` tells."""
    return tag_layout(name).border


def tag_picture_corners(name: str, *, pixels_per_cell: int = 8) -> FloatArray:
    """Return where the square's corners lie in `tag_picture` (4, 2) [px].

    They lie on the outer edges of pixels. The order is that of `find_tags`: top left, top right, bottom
    right, bottom left of the tag as printed.

    Raises:
        InputError: no such dictionary, or not a legal size.
    """
    layout, scale = tag_layout(name), _whole("pixels_per_cell", pixels_per_cell, 1, _MOST_PIXELS_PER_CELL)
    low = (layout.cells - layout.border) // 2 * scale - 0.5
    high = low + layout.border * scale
    return np.array([[low, low], [high, low], [high, high], [low, high]])


def _whole(name: str, value: int, low: int, high: int) -> int:
    number = finite_number(name, value, minimum=low, maximum=high)
    return int(finite_number(name, value, minimum=int(number), maximum=int(number)))
