"""ChArUco boards and AprilGrids: markers say which part is seen, corners are measured on edges."""

from __future__ import annotations

import numpy as np

from omniservo.calibration.boards.board import AprilGrid, CharucoBoard
from omniservo.calibration.boards.board_view import BoardView
from omniservo.calibration.boards.corners import Corners
from omniservo.calibration.boards.find_markers import Markers, find_markers
from omniservo.calibration.boards.local_map import local_map
from omniservo.geometry.arrays import BoolArray, ByteArray, FloatArray

_APRILTAG = "DICT_APRILTAG_36h11"
_APRILTAG_CELLS = 6
_WITHIN = 0.85  # of a one-coloured strip: what of it belongs to a corner's window
_ALONG = 0.65  # squares
_MOST_OFF = 0.5  # sides of a marker, from where the others say it is
_LEAST_CORNERS = 4
_LEAST_AGREEING = 0.5  # share of the markers: with fewer the board is another one


def charuco_corners(image: ByteArray, board: CharucoBoard) -> Corners:
    """Return the board's places, where nothing is known yet."""
    # bright squares are one-coloured up to their marker, so a corner's window is a cross
    margin = 0.5 * (1.0 - board.marker / board.square)
    signs = 1.0 - 2.0 * (board.places.sum(axis=1) % 2)  # of one image all may be the other way round
    return Corners(image, board.places, signs, (_ALONG, _WITHIN * margin))


def aprilgrid_corners(image: ByteArray, board: AprilGrid, border: int = 1) -> Corners:
    """Return the board's places, where nothing is known yet; ``border`` of the codes in cells."""
    signs = np.tile([-1.0, 1.0, -1.0, 1.0], board.columns * board.rows)
    strip = min(border / (_APRILTAG_CELLS + 2 * border), board.ratio)
    return Corners(image, board.places, signs, (_WITHIN * board.ratio, _WITHIN * strip))


def find_charuco(image: ByteArray, board: CharucoBoard) -> BoardView:
    """Find the chessboard corners of a ChArUco board, also of a part of it and of its mirror image.

    A board with an even number of rows is read as OpenCV printed it before 4.6 where more markers are there.
    """
    markers = find_markers(image, board.dictionary, len(board.marker_corners), borders=(1,))
    places = board.marker_corners[markers.numbers]
    good = _agreeing(places, markers.corners)
    if board.rows % 2 == 0 and not good.all():
        older = board.legacy_marker_corners[markers.numbers]
        there = _agreeing(older, markers.corners)
        if there.sum() > good.sum():
            places, good = older, there
    return _measured(board, charuco_corners(image, board), markers, places, good, board.dictionary)


def find_aprilgrid(image: ByteArray, board: AprilGrid) -> BoardView:
    """Find the corners of an AprilGrid's tags, also of a part of it and of its mirror image."""
    markers = find_markers(image, _APRILTAG, board.columns * board.rows)
    # a reader's first corner is the top left one of the code as printed: here the fourth
    places = _turned_to_fit(board.places.reshape(-1, 4, 2)[markers.numbers][:, ::-1], markers)
    good = _agreeing(places, markers.corners)
    return _measured(board, aprilgrid_corners(image, board, markers.border), markers, places, good, _APRILTAG)


def _turned_to_fit(places: FloatArray, markers: Markers) -> FloatArray:
    """Turn all codes by the same multiple of 90°, so that neighbours agree: printers differ in what is up."""
    if len(markers) < 2:
        return places
    turns = [np.roll(places, k, axis=1) for k in range(4)]
    return min(turns, key=lambda turned: _roughness(turned.reshape(-1, 2), markers.corners.reshape(-1, 2)))


def _roughness(places: FloatArray, pixels: FloatArray) -> float:
    """Mean squared distance of pixels from an affine map of their places [px²]."""
    design = np.column_stack([places, np.ones(len(places))])
    return float(((design @ np.linalg.lstsq(design, pixels, rcond=None)[0] - pixels) ** 2).mean())


def _measured(
    board: AprilGrid | CharucoBoard,
    corners: Corners,
    markers: Markers,
    places: FloatArray,
    good: BoolArray,
    name: str,
) -> BoardView:
    if not len(places):
        return BoardView.nothing(f"no marker of {name} with a number of this board")
    if good.sum() < _LEAST_AGREEING * len(good):
        return BoardView.nothing(
            f"{len(good)} markers of {name}, but {int((~good).sum())} of them not where a board of"
            f" {board.columns}x{board.rows} has them; are columns and rows exchanged?"
        )
    pixels, _, ok = local_map(
        places[good].reshape(-1, 2), markers.corners[good].reshape(-1, 2), corners.places
    )
    corners.pixels[ok] = pixels[ok]
    corners.complete()
    known = np.flatnonzero(corners.known)
    if len(known) < _LEAST_CORNERS:
        found = f"{int(good.sum())} markers of {name}, but {len(known)} corners"
        return BoardView.nothing(f"{found} that can be measured; {_LEAST_CORNERS} are needed")
    return BoardView.of(board, known, corners.pixels[known], mirrored=markers.mirrored)


def _agreeing(places: FloatArray, corners: FloatArray) -> BoolArray:
    """(m,) markers that are where the others say: a wrong number stands elsewhere."""
    good = np.ones(len(places), dtype=bool)
    if len(places) < 4:
        return good
    for k in range(len(places)):
        others = np.arange(len(places)) != k
        predicted, _, ok = local_map(
            places[others].reshape(-1, 2), corners[others].reshape(-1, 2), places[k].mean(axis=0)[None]
        )
        side = np.linalg.norm(corners[k, 0] - corners[k, 2]) / np.sqrt(2.0)
        off = float(np.linalg.norm(predicted[0] - corners[k].mean(axis=0)))
        good[k] = not ok[0] or off <= _MOST_OFF * side
    return good
