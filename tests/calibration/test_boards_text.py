"""Boards from text and from Kalibr's files: their points, and what is said of wrong ones."""

import numpy as np
import pytest

from omniservo.calibration.boards import (
    AprilGrid,
    CharucoBoard,
    Checkerboard,
    CircleGrid,
    board_from_text,
    find_board,
)
from omniservo.errors import InputError

GOOD = {
    "checkerboard:8x6:0.042": Checkerboard(8, 6, 0.042),
    "charuco:8x6:0.04:0.03:DICT_4X4_50": CharucoBoard(8, 6, 0.04, 0.03, "DICT_4X4_50"),
    "charuco:8x6:0.04:0.03:5x5_100": CharucoBoard(8, 6, 0.04, 0.03, "DICT_5X5_100"),
    "aprilgrid:6x5:0.088:0.3": AprilGrid(6, 5, 0.088, 0.3),
    "circles:7x5:0.03:0.02": CircleGrid(7, 5, 0.03, 0.02),
    "acircles:4x11:0.02:0.015": CircleGrid(4, 11, 0.02, 0.015, "asymmetric"),
}
BAD = {
    "chess:8x6:0.042": "'chess:8x6:0.042': no such kind; legal: checkerboard:",
    "checkerboard:8x6": "1 parts after checkerboard; legal: checkerboard:8x6:0.042",
    "checkerboard:8:0.04": "size: '8' given; legal: columns x rows",
    "checkerboard:1x6:0.04": "columns: 1 given; legal: a whole number from 2 to 100",
    "checkerboard:8x600:0.04": "rows: 600 given",
    "checkerboard:8x6:wide": "square: 'wide' given; a number is needed",
    "checkerboard:8x6:-1": "square: -1 given; legal: >= 0.0001 and <= 100",
    "checkerboard:8x6:nan": "square: 'nan' given",
    "charuco:8x6:0.04:0.05:DICT_4X4_50": "marker: 0.05 given; legal: less than the square, 0.04",
    "charuco:8x6:0.04:0.03:DICT_9X9": "dictionary: 'DICT_9X9' given; legal: 4x4_100",
    "aprilgrid:30x30:0.02:0.3": "tags: 30×30 given; legal: at most 587",
    "aprilgrid:6x6:0.088:0": "spacing ratio: 0 given",
    "circles:7x5:0.03:0.03": "diameter: 0.03 given; legal: less than 0.027",
    "": "no such kind",
}


@pytest.mark.parametrize("text", GOOD)
def test_a_text_is_its_board(text):
    assert board_from_text(text) == GOOD[text]


@pytest.mark.parametrize("text", BAD)
def test_a_wrong_part_is_named_with_what_is_legal(text):
    with pytest.raises(InputError) as error:
        board_from_text(text)
    assert BAD[text] in str(error.value)


def test_points_are_where_the_definitions_say():
    assert np.allclose(
        Checkerboard(8, 6, 0.042).points[[0, 1, 8, 47]] / 0.042, [[0, 0, 0], [1, 0, 0], [0, 1, 0], [7, 5, 0]]
    )
    charuco = CharucoBoard(8, 6, 0.04, 0.03, "DICT_4X4_50")
    assert len(charuco.points) == 35
    assert np.allclose(charuco.points[[0, 7]], [[0.04, 0.04, 0], [0.04, 0.08, 0]])
    grid = AprilGrid(6, 6, 0.088, 0.3)
    assert len(grid.points) == 144
    assert np.allclose(grid.points[[0, 2, 4, 24]] / 0.088, [[0, 0, 0], [1, 1, 0], [1.3, 0, 0], [0, 1.3, 0]])
    asymmetric = CircleGrid(4, 11, 0.02, 0.015, "asymmetric").points / 0.02
    assert np.allclose(asymmetric[[0, 1, 4, 43]], [[0, 0, 0], [2, 0, 0], [1, 1, 0], [6, 10, 0]])


def test_charuco_points_are_opencvs():
    import cv2

    ours = CharucoBoard(8, 6, 0.04, 0.03, "DICT_4X4_50")
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    theirs = cv2.aruco.CharucoBoard((8, 6), 0.04, 0.03, dictionary)
    assert np.allclose(ours.points, theirs.getChessboardCorners(), atol=1e-7)
    corners = 0.04 * ours.marker_corners
    assert np.allclose(corners, np.array(theirs.getObjPoints())[..., :2], atol=1e-7)


def test_writing_to_points_changes_no_board():
    board = Checkerboard(8, 6, 0.042)
    before = board.points.copy()
    board.points[:] = 1.0
    np.testing.assert_array_equal(board.points, before)


def test_kalibrs_targets_are_read(tmp_path):
    grid = tmp_path / "april.yaml"
    grid.write_text("target_type: 'aprilgrid'\ntagCols: 6\ntagRows: 6\ntagSize: 0.088\ntagSpacing: 0.3\n")
    assert board_from_text(str(grid)) == AprilGrid(6, 6, 0.088, 0.3)
    chess = tmp_path / "chess.yaml"
    lines = ["target_type: 'checkerboard'", "targetCols: 6", "targetRows: 7"]
    chess.write_text("\n".join([*lines, "rowSpacingMeters: 0.06", "colSpacingMeters: 0.06"]))
    assert board_from_text(str(chess)) == Checkerboard(6, 7, 0.06)
    chess.write_text("\n".join([*lines, "rowSpacingMeters: 0.06", "colSpacingMeters: 0.05"]))
    with pytest.raises(InputError, match=r"chess\.yaml: rowSpacingMeters: 0\.06 given; legal: as col"):
        board_from_text(str(chess))
    chess.write_text("target_type: 'assymetric'\n")
    with pytest.raises(InputError, match=r"target_type: 'assymetric' given; legal: checkerboard, aprilgrid"):
        board_from_text(str(chess))
    grid.write_text("target_type: 'aprilgrid'\ntagCols: 6\n")
    with pytest.raises(InputError, match=r"tagRows: missing"):
        board_from_text(str(grid))


@pytest.mark.slow
@pytest.mark.parametrize(
    "text", ["checkerboard:8x6:0.042", "charuco:7x5:0.035:0.026:DICT_4X4_50", "aprilgrid:6x6:0.088:0.3",
             "circles:7x5:0.03:0.02", "acircles:4x11:0.02:0.015"]
)  # fmt: skip
def test_noise_shows_no_board(text):
    """It has tens of thousands of small squares and discs, which must neither be a board nor take minutes."""
    noise = np.random.default_rng(0).integers(0, 256, (720, 960), dtype=np.uint8)
    view = find_board(noise, board_from_text(text))
    assert not view.found
    assert view.reason
