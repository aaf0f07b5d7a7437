"""The second look at a board: with a camera, missing corners are searched where they must be."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np

from omniservo.calibration.boards.board import Board
from omniservo.calibration.boards.board_pose import board_pose
from omniservo.calibration.boards.board_view import BoardView
from omniservo.calibration.boards.corners import Corners
from omniservo.cameras.image_mask import distance_beyond
from omniservo.cameras.models.central_model import CentralModel
from omniservo.geometry.arrays import BoolArray, FloatArray, IntArray

_STEP = 0.05  # of the pitch: for the map's derivative
_RIM = 2  # [px] the lens's rim is blurred over
_AT_ONCE = 2**18  # pixels: the whole of a large image takes gigabytes


def measure_again(view: BoardView, board: Board, corners: Corners, camera: CentralModel) -> BoardView:
    """Return the view with its corners fitted again and the missing ones searched from the board's pose.

    Pixels that the camera cannot see with (beyond the lens's rim, in the dead zone or the mask) no longer
    count, so corners beside them are not pulled away.

    Args:
        view: what was found without the camera.
        board: that was found.
        corners: the board's places, empty.
        camera: that took the image.
    """
    corners.pixels[view.ids] = view.pixels
    corners.seen = _seen(camera)
    corners.refine()
    known = corners.known
    pose = board_pose(camera, corners.pixels[known], board.points[known]) if known.any() else None
    if pose is None:
        return view

    def seen_at(places: FloatArray) -> tuple[FloatArray, BoolArray]:
        flat = np.column_stack([board.pitch * places, np.zeros(len(places))])
        pixels, valid = camera.project(pose.apply(flat))
        return pixels, valid & camera.in_image(pixels)

    pixels, ok = seen_at(corners.places)
    sides = [seen_at(corners.places + _STEP * np.array(s)) for s in ([1, 0], [-1, 0], [0, 1], [0, -1])]
    for _, valid in sides:
        ok &= valid
    x, y = ((sides[k][0] - sides[k + 1][0]) / (2 * _STEP) for k in (0, 2))
    corners.search(np.flatnonzero(ok & ~known), pixels, np.stack([x, y], axis=2))
    corners.drop_strays()
    corners.refine()
    found = np.flatnonzero(corners.known)
    return BoardView.of(board, found, corners.pixels[found], mirrored=view.mirrored, turnable=view.turnable)


@lru_cache(maxsize=2)  # a calibration looks at many images of one camera
def _seen(camera: CentralModel) -> BoolArray:
    """(height, width) pixels that the camera sees with, a little away from the rest; read-only."""
    rows = max(1, _AT_ONCE // camera.width)
    seen = np.concatenate(
        [_sees(camera, np.arange(v, min(v + rows, camera.height))) for v in range(0, camera.height, rows)]
    )
    kernel = np.ones((2 * _RIM + 1, 2 * _RIM + 1), np.uint8)
    inner = cv2.erode(seen.astype(np.uint8), kernel, borderType=cv2.BORDER_CONSTANT, borderValue=1) > 0
    inner.setflags(write=False)
    return np.asarray(inner)


def _sees(camera: CentralModel, rows: IntArray) -> BoolArray:
    """(n, width) which pixels of the image's ``rows`` (n,) the camera sees with."""
    pixels = np.stack(np.meshgrid(np.arange(camera.width), rows), axis=-1).reshape(-1, 2).astype(np.float64)
    seen = camera.unproject(pixels)[1]
    zone = camera.dead_zone
    if zone is not None:
        seen = seen & (np.linalg.norm(pixels - np.asarray(zone.center), axis=1) > zone.radius)
    if camera.mask:
        seen = seen & (distance_beyond(camera.mask, pixels) > 0.0)
    return np.asarray(seen.reshape(len(rows), camera.width))
