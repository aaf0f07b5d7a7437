"""The inner corners of a checkerboard, in any central camera's image, without knowing the camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omniservo.calibration.boards.board import Checkerboard
from omniservo.calibration.boards.board_view import BoardView
from omniservo.calibration.boards.corners import Corners
from omniservo.calibration.boards.place_pattern import counted_size, place_pattern
from omniservo.calibration.boards.saddle_candidates import Saddles, saddle_candidates
from omniservo.calibration.boards.saddle_lattices import Lattice, saddle_lattices
from omniservo.geometry.arrays import ByteArray, FloatArray, IntArray

REACH = (0.65, 0.65)
"""a corner's window, in squares"""
_SCALES = ((1.0, 0.5, 0.25), (2.0, 1.0))
_TRIED = 6  # patterns of an image
_LEAST_CHAINED = 0.2  # of the board's corners: smaller patterns are not looked at
_PAD = 3  # columns and rows around the pattern in which its continuation is searched


@dataclass(frozen=True)
class _Pattern:
    keys: IntArray
    pixels: FloatArray
    contrast: FloatArray


def checkerboard_corners(image: ByteArray, board: Checkerboard) -> Corners:
    """Return the board's places, where nothing is known yet."""
    return Corners(image, board.places, 1.0 - 2.0 * (board.places.sum(axis=1) % 2), REACH)


def find_checkerboard(image: ByteArray, board: Checkerboard, *, mirrored: bool = False) -> BoardView:
    """Find the board: candidates, chains along edges, growth over the whole board, and its place by counting.

    Args:
        image: (height, width) grey values.
        board: what is looked for.
        mirrored: whether the camera shows the world reflected.
    """
    largest = _Pattern(np.zeros((0, 2), dtype=np.int64), np.zeros((0, 2)), np.zeros(0))
    chained = 0
    lattice_of_board = board.places.astype(np.int64)
    for scales in _SCALES:
        saddles = saddle_candidates(image, scales)
        for lattice in saddle_lattices(image, saddles)[:_TRIED]:
            chained = max(chained, len(lattice))
            if len(lattice) < _LEAST_CHAINED * len(lattice_of_board):
                break
            pattern = _whole_pattern(image, saddles, lattice, mirrored)
            placing = place_pattern(pattern.keys, pattern.pixels, lattice_of_board, pattern.contrast)
            if placing is not None:
                return BoardView.of(board, placing.ids, pattern.pixels, turnable=placing.turnable)
            if len(pattern.keys) > len(largest.keys):
                largest = pattern
    return BoardView.nothing(_reason(largest, chained, board))


def _whole_pattern(image: ByteArray, saddles: Saddles, lattice: Lattice, mirrored: bool) -> _Pattern:
    """Refine the chained candidates, and search on around them."""
    keys = np.array(list(lattice), dtype=np.int64)
    if mirrored:
        keys[:, 0] *= -1
    low, high = keys.min(axis=0) - _PAD, keys.max(axis=0) + _PAD
    row, column = np.mgrid[low[1] : high[1] + 1, low[0] : high[0] + 1]
    places = np.stack([column.ravel(), row.ravel()], axis=1)
    signs = 1.0 - 2.0 * (places.sum(axis=1) % 2)
    corners = Corners(image, places.astype(np.float64), signs, REACH)
    at = (keys[:, 1] - low[1]) * (high[0] - low[0] + 1) + keys[:, 0] - low[0]
    corners.pixels[at] = saddles.pixels[list(lattice.values())]
    corners.complete()
    known = corners.known
    return _Pattern(places[known], corners.pixels[known], corners.contrast[known])


def _reason(pattern: _Pattern, chained: int, board: Checkerboard) -> str:
    needed = f"{board.columns}×{board.rows} inner corners"
    if len(pattern.keys) >= 4:
        columns, rows = counted_size(pattern.keys)
        return (
            f"a chequered pattern of {columns}×{rows} inner corners ({len(pattern.keys)} in all) was found, "
            f"not {needed}: another board, or too small a part of it"
        )
    if chained >= _LEAST_CHAINED * len(board.places):
        return f"no chequered pattern of {needed} that can be measured: something else, or blurred, or faint"
    return f"no chequered pattern of {needed}"
