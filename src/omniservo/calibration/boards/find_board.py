"""A board's points in one image: what calibration starts from."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from omniservo.calibration.boards.board import AprilGrid, Board, CharucoBoard, Checkerboard, CircleGrid
from omniservo.calibration.boards.board_view import BoardView
from omniservo.calibration.boards.corners import Corners
from omniservo.calibration.boards.find_checkerboard import checkerboard_corners, find_checkerboard
from omniservo.calibration.boards.find_circles import find_circles
from omniservo.calibration.boards.find_tagged import (
    aprilgrid_corners,
    charuco_corners,
    find_aprilgrid,
    find_charuco,
)
from omniservo.calibration.boards.measure_again import measure_again
from omniservo.cameras.models.central_model import CentralModel
from omniservo.errors import InputError, spelled
from omniservo.geometry.arrays import ByteArray

_LEAST_SIDE = 16


def find_board(image: Any, board: Board, camera: CentralModel | None = None) -> BoardView:
    """Find a board's points; every point is measured in the image, none is made up.

    Args:
        image: (height, width) grey or (height, width, 3 or 4) red, green, blue; uint8.
        board: what to look for.
        camera: the camera, where it is already known: it says whether the image is mirrored, leaves out
            what lies beyond the lens's rim, finds missing corners from the board's pose, and corrects the
            centres of circles.

    Returns:
        The points found, or the reason why there are none.

    Raises:
        InputError: not such an image, not a board, or an image that is not of the camera's size.
    """
    grey = grey_image(image)
    if camera is not None and grey.shape != (camera.height, camera.width):
        raise InputError(
            f"image: {grey.shape[1]}×{grey.shape[0]} given; the camera's is {camera.width}×{camera.height}"
        )
    view, corners = _found(grey, board, camera)
    if camera is None or corners is None or not view.found:
        return view
    return measure_again(view, board, corners, camera)


def _found(grey: ByteArray, board: Board, camera: CentralModel | None) -> tuple[BoardView, Corners | None]:
    """The view, and for boards with corners their places for a second look."""
    mirrored = camera is not None and shows_mirrored(camera)
    if isinstance(board, Checkerboard):
        return find_checkerboard(grey, board, mirrored=mirrored), checkerboard_corners(grey, board)
    if isinstance(board, CharucoBoard):
        return find_charuco(grey, board), charuco_corners(grey, board)
    if isinstance(board, AprilGrid):
        return find_aprilgrid(grey, board), aprilgrid_corners(grey, board)
    if isinstance(board, CircleGrid):
        dark = find_circles(grey, board, camera, mirrored=mirrored)
        light = dark if dark.found else find_circles(255 - grey, board, camera, mirrored=mirrored)
        return light if light.found else dark, None
    raise InputError(f"board: {spelled(board)} given; legal: what board_from_text returns")


def grey_image(image: Any) -> ByteArray:
    """Return an image as grey values (height, width).

    Raises:
        InputError: not uint8, of another shape, or smaller than 16 × 16.
    """
    if (
        not isinstance(image, np.ndarray)
        or image.dtype != np.uint8
        or not (image.ndim == 2 or (image.ndim == 3 and image.shape[2] in (1, 3, 4)))
        or min(image.shape[:2]) < _LEAST_SIDE
    ):
        given = f"{image.dtype} {image.shape}" if isinstance(image, np.ndarray) else type(image).__name__
        legal = f"uint8 (height, width) or with 3 or 4 colours, sides of at least {_LEAST_SIDE}"
        raise InputError(f"image: {given} given; legal: {legal}")
    if image.ndim == 3 and image.shape[2] == 1:
        image = image[:, :, 0]
    if image.ndim == 3:
        code = cv2.COLOR_RGB2GRAY if image.shape[2] == 3 else cv2.COLOR_RGBA2GRAY
        image = cv2.cvtColor(np.ascontiguousarray(image), code)
    # a copy of its own: kernels would be compiled once more for arrays that cannot be written to
    return np.array(image, order="C")


def shows_mirrored(camera: CentralModel) -> bool:
    """Whether a camera's image shows the world reflected: one of its focal lengths is negative."""
    ahead = camera.project(np.array([[0.0, 0.0, 1.0], [1e-4, 0.0, 1.0], [0.0, 1e-4, 1.0]]))[0]
    across = ahead[1:] - ahead[0]
    return bool(across[0, 0] * across[1, 1] < across[0, 1] * across[1, 0])
