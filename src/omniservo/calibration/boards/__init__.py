"""Calibration boards, and their points in images of any central camera."""

from omniservo.calibration.boards.board import AprilGrid, Board, CharucoBoard, Checkerboard, CircleGrid
from omniservo.calibration.boards.board_text import board_from_text
from omniservo.calibration.boards.board_view import BoardView
from omniservo.calibration.boards.find_board import find_board
from omniservo.files.image_files import read_grey_image

__all__ = [
    "AprilGrid",
    "Board",
    "BoardView",
    "CharucoBoard",
    "Checkerboard",
    "CircleGrid",
    "board_from_text",
    "find_board",
    "read_grey_image",
]
