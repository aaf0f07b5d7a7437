"""The codes of a dictionary as dark cells, and which code a reading of grey values is most like."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.perception.tag_picture import tag_cells
from omniservo.tag_dictionaries import dictionary, dictionary_size, opencv_name

_LEAST_AGREEMENT = 0.5
"""correlation of grey values with their code; a random pattern of 16 cells has 0.5 with the best of 50"""


@dataclass(frozen=True, eq=False)
class TagCodes:
    """Every tag of a dictionary."""

    cells: int
    """along a side, with the dark border"""
    dark: BoolArray
    """(tags, cells, cells) rows from the top of the tag as printed"""
    signs: FloatArray
    """(4·tags, (cells−2)²) of the code's cells, +1 bright and −1 dark, less their mean and of length 1; row
    4·id + k is the tag turned k times by 90° so that its corner k comes first"""


def tag_codes(name: str) -> TagCodes:
    """Return the codes of the dictionary of this name.

    Raises:
        InputError: no such dictionary.
    """
    return _codes(opencv_name(name))


@lru_cache(maxsize=8)
def _codes(name: str) -> TagCodes:
    cells = tag_cells(name)
    known = dictionary(name)
    tags = [cv2.aruco.generateImageMarker(known, k, cells) < 128 for k in range(dictionary_size(name))]
    dark = np.stack(tags)
    # np.rot90 turns counter-clockwise: the top right corner comes to the top left
    turned = np.stack([np.rot90(dark, k, axes=(1, 2)) for k in range(4)], axis=1)
    inner = turned[:, :, 1:-1, 1:-1].reshape(4 * len(dark), -1)
    signs = 1.0 - 2.0 * inner
    signs -= signs.mean(axis=1, keepdims=True)
    # a code of one grey cannot be told from a blank
    length = np.linalg.norm(signs, axis=1, keepdims=True)
    return TagCodes(cells, dark, np.where(length > 0.0, signs / np.maximum(length, 1e-9), 0.0))


def likeliest_code(codes: TagCodes, greys: FloatArray) -> tuple[int, int] | None:
    """Return (id, k) of the code most correlated with the grey values, or None where none is.

    Args:
        codes: of the dictionary.
        greys: ((cells−2)²,) grey values of the code's cells, row by row from a square's first corner. That
            corner is corner k of the tag.
    """
    varied = greys - greys.mean()
    length = float(np.linalg.norm(varied))
    if length < 1e-9:
        return None
    agreement = codes.signs @ (varied / length)
    best = int(agreement.argmax())
    return divmod(best, 4) if agreement[best] >= _LEAST_AGREEMENT else None
