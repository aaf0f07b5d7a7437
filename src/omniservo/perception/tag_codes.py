"""The codes of a dictionary as dark cells, and which code a reading of grey values is most like."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from omniservo.geometry.arrays import BoolArray, FloatArray, IntArray
from omniservo.tag_dictionaries import TagLayout, dark_cells, dictionary_name, dictionary_size, tag_layout

_LEAST_AGREEMENT = 0.5
"""correlation of grey values with their code; a random pattern of 16 cells has 0.5 with the best of 50"""


@dataclass(frozen=True, eq=False)
class TagCodes:
    """Every tag of a dictionary."""

    layout: TagLayout
    dark: BoolArray
    """(tags, cells, cells) rows from the top of the tag as printed"""
    signs: npt.NDArray[np.float32]
    """(tags, bits) of the code's cells, row by row, +1 bright and −1 dark, less their mean and of length 1;
    0 where corners cannot be distinguished"""
    turns: IntArray
    """(4, bits) turned k times by 90°, so that its corner k comes first, the tag has in its j-th cell what it
    had in the cell ``turns[k, j]``"""

    @property
    def edge(self) -> float:
        """Half the side of the square whose corners count, where that of the whole print is 1."""
        return self.layout.border / self.layout.cells


def tag_codes(name: str) -> TagCodes:
    """Return the codes of the dictionary of this name.

    Raises:
        InputError: no such dictionary.
    """
    return _codes(dictionary_name(name))


@lru_cache(maxsize=8)
def _codes(name: str) -> TagCodes:
    layout = tag_layout(name)
    dark = dark_cells(name, np.arange(dictionary_size(name)))
    codes = dark[:, layout.code]
    signs = 1.0 - 2.0 * codes.astype(np.float32)
    signs -= signs.mean(axis=1, keepdims=True)
    places = np.full(layout.code.shape, -1)
    places[layout.code] = np.arange(signs.shape[1])
    # np.rot90 turns counter-clockwise: the top right corner comes to the top left
    turns = np.stack([np.rot90(places, k)[layout.code] for k in range(4)])
    # a code of one grey cannot be told from a blank, nor the corners of one that looks the same when turned
    same = np.any([(codes[:, turn] == codes).all(axis=1) for turn in turns[1:]], axis=0)
    length = np.where(same[:, None], 0.0, np.linalg.norm(signs, axis=1, keepdims=True))
    return TagCodes(layout, dark, np.where(length > 0.0, signs / np.maximum(length, 1e-9), 0.0), turns)


def likeliest_code(codes: TagCodes, greys: FloatArray) -> tuple[int, int] | None:
    """Return (id, k) of the code most correlated with the grey values, or None where none is.

    Args:
        codes: of the dictionary.
        greys: (bits,) grey values of the code's cells, row by row from a square's first corner. That
            corner is corner k of the tag.
    """
    varied = greys - greys.mean()
    length = float(np.linalg.norm(varied))
    if length < 1e-9:
        return None
    seen = np.empty((len(greys), 4), dtype=np.float32)
    for k, turn in enumerate(codes.turns):
        seen[turn, k] = varied / length
    agreement = codes.signs @ seen
    best = int(agreement.argmax())
    return divmod(best, 4) if agreement.flat[best] >= _LEAST_AGREEMENT else None
