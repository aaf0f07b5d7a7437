"""The dictionaries of square tags by name, and how their tags are printed: OpenCV's, and AprilTag 3's own.

The codes of the AprilTag 3 families are those of AprilRobotics' library (BSD-2-Clause, 2013-2016, The
Regents of the University of Michigan); ``python -m benchmarks.april_tag_codes`` wrote ``april_tags.npz``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np

from omniservo.errors import InputError, spelled
from omniservo.geometry.arrays import BoolArray, IntArray

APRIL_TAGS_3 = ("tagCircle21h7", "tagCircle49h12", "tagCustom48h12", "tagStandard41h12", "tagStandard52h13")
"""families with code outside the square whose corners count, which is bright inside and dark outside"""
CODES_FILE = Path(__file__).with_name("april_tags.npz")
CODE_STEP = 982_451_653
"""The generator of these families tries codes that are so far apart, modulo 2^bits; the file has how many
steps each code comes after the one before."""

_PREFIXES = (("DICT_APRILTAG_", "tag"), ("DICT_", ""))


@dataclass(frozen=True, eq=False)
class TagLayout:
    """The cells of a dictionary's tags as printed, a square grid, all of one size."""

    border: int
    """along a side of the square whose corners are the tag's"""
    bright_inside: bool
    """whether that square is bright inside its rim and dark outside; the other way round if not"""
    frame: BoolArray
    """(cells, cells) dark cells, the same of every tag"""
    code: BoolArray
    """(cells, cells) cells that tell the tags apart"""
    printed: BoolArray
    """(cells, cells) the others, corners of round tags, are whatever the tag lies on"""

    @property
    def cells(self) -> int:
        """Along a side of the whole print."""
        return len(self.frame)

    @property
    def square(self) -> BoolArray:
        """(cells, cells) those of the square."""
        return _square(self.cells, self.border)

    @property
    def read(self) -> BoolArray:
        """(cells, cells) that a reader must find as printed: all but the white around a dark square."""
        return self.printed & (self.square | self.bright_inside)


def dictionary_names() -> tuple[str, ...]:
    """Return the names of all: 4x4_50 … 7x7_1000, aruco_original, tag16h5 … tag36h11, tagStandard41h12 …."""
    return tuple(sorted({*map(_short, _opencv_names()), *APRIL_TAGS_3}))


def dictionary_name(name: str) -> str:
    """Return the name, as tag36h11, of a dictionary given by it or OpenCV's, as DICT_4X4_50, in any case.

    Raises:
        InputError: no such dictionary.
    """
    wanted = name.lower() if isinstance(name, str) else ""
    for known in APRIL_TAGS_3:
        if wanted == known.lower():
            return known
    for known in _opencv_names():
        if wanted in (known.lower(), _short(known)):
            return _short(known)
    raise InputError(f"dictionary: {spelled(name)} given; legal: {', '.join(dictionary_names())}")


def opencv_name(name: str) -> str:
    """Return OpenCV's name, as DICT_4X4_50, of a dictionary given as of `dictionary_name`.

    Raises:
        InputError: no such dictionary, or OpenCV does not have it.
    """
    short = dictionary_name(name)
    if short in APRIL_TAGS_3:
        legal = ", ".join(known for known in dictionary_names() if known not in APRIL_TAGS_3)
        raise InputError(f"dictionary: {spelled(name)} given, which no board has; legal: {legal}")
    return next(known for known in _opencv_names() if _short(known) == short)


def dictionary(name: str) -> Any:
    """Return the ``cv2.aruco.Dictionary`` of this name; see `opencv_name`."""
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, opencv_name(name)))


def dictionary_size(name: str) -> int:
    """Return how many tags a dictionary has: ids are 0 … this − 1."""
    short = dictionary_name(name)
    return len(_family(short).codes if short in APRIL_TAGS_3 else dictionary(short).bytesList)


def tag_layout(name: str) -> TagLayout:
    """Return how the tags of the dictionary of this name are printed, the dark squares with white around.

    Raises:
        InputError: no such dictionary.
    """
    return _layout(dictionary_name(name))


def dark_cells(name: str, numbers: IntArray) -> BoolArray:
    """Return which cells of these tags (n,) are dark (n, cells, cells), rows from the top as printed.

    Raises:
        InputError: no such dictionary.
    """
    short, layout = dictionary_name(name), tag_layout(name)
    if short not in APRIL_TAGS_3:
        known, side = dictionary(short), layout.border
        tags = [cv2.aruco.generateImageMarker(known, int(k), side) < 128 for k in numbers]
        return np.pad(np.reshape(tags, (len(tags), side, side)), ((0, 0), (1, 1), (1, 1)))
    family = _family(short)
    dark = np.repeat(layout.frame[None], len(numbers), axis=0)
    first = len(family.places) - 1
    for bit, (x, y) in enumerate(family.places):
        dark[:, y, x] = family.codes[numbers] >> np.uint64(first - bit) & np.uint64(1) == 0
    return dark


class _Family(NamedTuple):
    codes: Any
    """(tags,) uint64"""
    places: IntArray
    """(bits, 2) x and y of the cells in the whole print, from a code's highest bit on; 1 is bright"""
    border: int
    cells: int


@lru_cache(maxsize=len(APRIL_TAGS_3))
def _family(name: str) -> _Family:
    with np.load(CODES_FILE) as file:
        steps, places = file[f"{name}_steps"], file[f"{name}_places"].astype(np.int64)
        border, cells, first = map(int, file[f"{name}_numbers"])
    after = np.cumsum(steps.astype(np.uint64)) * np.uint64(CODE_STEP) + np.uint64(first)
    return _Family(after & np.uint64(2 ** len(places) - 1), places, border, cells)


@lru_cache(maxsize=16)
def _layout(name: str) -> TagLayout:
    if name not in APRIL_TAGS_3:
        border = int(dictionary(name).markerSize) + 2
        cells = border + 2
        code = _square(cells, border - 2)
        return TagLayout(border, False, _square(cells, border) & ~code, code, _square(cells, cells))
    family = _family(name)
    cells, border = family.cells, family.border
    code = np.zeros((cells, cells), dtype=np.bool_)
    code[family.places[:, 1], family.places[:, 0]] = True
    rings = _square(cells, border + 2) & ~_square(cells, border - 2)
    return TagLayout(border, True, rings & ~_square(cells, border), code, code | rings)


def _square(cells: int, side: int) -> BoolArray:
    """(cells, cells) where a square of this side in the middle is."""
    inside = np.abs(2 * np.arange(cells) + 1 - cells) < side
    return inside[:, None] & inside


def _opencv_names() -> tuple[str, ...]:
    return tuple(name for name in dir(cv2.aruco) if name.startswith("DICT_"))


def _short(name: str) -> str:
    prefix, short = next(pair for pair in _PREFIXES if name.startswith(pair[0]))
    return short + name.removeprefix(prefix).lower()
