"""ChArUco boards and AprilGrids in rendered pictures whose corners are known."""

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform
from tests.calibration.rendered_boards import around, facing, render, true_pixels

from omniservo.calibration.boards import AprilGrid, CharucoBoard, find_board
from omniservo.cameras import UnifiedCamera, preset

CHARUCO = CharucoBoard(8, 6, 0.03, 0.022, "DICT_4X4_50")
APRIL = AprilGrid(5, 4, 0.03, 0.3)
VIEWS = [  # camera, direction of the board's middle, distance
    ("fe185", (0, 0, 1), 0.15),
    ("para-catadioptric", (-1, 0.3, 0.3), 0.25),
    ("perspective", (0.1, 0, 1), 0.3),
]


@pytest.mark.parametrize("board", [CHARUCO, APRIL], ids=["charuco", "aprilgrid"])
@pytest.mark.parametrize(("name", "direction", "distance"), VIEWS)
def test_corners_lie_within_hundredths_of_a_pixel_and_have_their_right_names(
    board, name, direction, distance
):
    camera = preset(name)
    pose = facing(board, direction, distance, (0.2, 0.1), 0.4)
    camera = around(camera, board, pose)
    view = find_board(render(camera, board, pose), board)
    pixels, seen = true_pixels(camera, board, pose)
    error = np.linalg.norm(view.pixels - pixels[view.ids], axis=1)
    assert len(view) >= 0.97 * seen.sum()
    assert np.median(error) < 0.05
    assert error.max() < 0.3
    assert view.mirrored is False
    assert not view.turnable


@pytest.mark.parametrize("board", [CHARUCO, APRIL], ids=["charuco", "aprilgrid"])
def test_a_part_of_the_board_is_enough(board):
    camera = preset("fe185")
    pose = facing(board, (1, 0.1, 0.5), 0.08, (0.2, 0.1), 0.4)
    camera = around(camera, board, pose)
    view = find_board(render(camera, board, pose), board)
    pixels, seen = true_pixels(camera, board, pose)
    assert 4 <= seen.sum() < 0.8 * len(seen)
    assert 0.8 * seen.sum() <= len(view) <= seen.sum()
    assert np.median(np.linalg.norm(view.pixels - pixels[view.ids], axis=1)) < 0.05


@pytest.mark.parametrize("board", [CHARUCO, APRIL], ids=["charuco", "aprilgrid"])
def test_a_mirror_image_is_named_and_its_points_keep_their_names(board):
    camera = preset("hyper-catadioptric")
    pose = facing(board, (1, 0.6, 0.3), 0.22)
    camera = around(camera, board, pose)
    view = find_board(render(camera, board, pose), board)
    pixels, _ = true_pixels(camera, board, pose)
    assert view.mirrored is True
    assert np.median(np.linalg.norm(view.pixels - pixels[view.ids], axis=1)) < 0.05


def test_codes_with_kalibrs_border_and_with_opencvs_are_read():
    camera = preset("perspective")
    pose = facing(APRIL, (0, 0, 1), 0.3)
    camera = around(camera, APRIL, pose)
    pixels, seen = true_pixels(camera, APRIL, pose)
    for border in (1, 2):
        view = find_board(render(camera, APRIL, pose, tag_border=border), APRIL)
        assert len(view) == seen.sum() == 80
        assert np.linalg.norm(view.pixels - pixels[view.ids], axis=1).max() < 0.1


def test_opencvs_own_drawing_of_a_charuco_board_is_found():
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    drawing = cv2.aruco.CharucoBoard((8, 6), 0.03, 0.022, dictionary).generateImage((640, 480), marginSize=0)
    image = np.full((560, 720), 255, dtype=np.uint8)
    image[40:520, 40:680] = drawing
    view = find_board(image, CHARUCO)
    # 80 px a square; the drawing's pixel 0 begins at −½
    expected = CHARUCO.points[:, :2] / 0.03 * 80 + 40 - 0.5
    assert len(view) == 35
    assert np.abs(view.pixels - expected[view.ids]).max() < 0.05


@pytest.mark.parametrize("size", [(8, 6), (7, 6)])
def test_a_board_as_opencv_printed_it_before_4_6_has_its_corners_where_the_new_one_has_them(size):
    square, pixels_a_square, margin = 0.04, 80, 20
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    drawn = cv2.aruco.CharucoBoard(size, square, 0.03, dictionary)
    sheet = tuple(pixels_a_square * count + 2 * margin for count in size)
    camera = UnifiedCamera(700.0, 700.0, 379.5, 359.5, 0.0, 760, 720)
    board = CharucoBoard(*size, square, 0.03, "DICT_4X4_50")
    camera_T_board = facing(board, (0.0, 0.0, 1.0), 0.45, (0.3, -0.2), 0.2)
    K = np.array([[700.0, 0.0, 379.5], [0.0, 700.0, 359.5], [0.0, 0.0, 1.0]])
    pose = camera_T_board.as_matrix()[:3, [0, 1, 3]]
    to_sheet = np.array([[square / pixels_a_square, 0, 0], [0, square / pixels_a_square, 0], [0, 0, 1.0]])
    to_sheet[:2, 2] = square * (0.5 - margin) / pixels_a_square  # of the first pixel's centre
    for legacy in (False, True):
        drawn.setLegacyPattern(legacy)
        print_out = drawn.generateImage(sheet, marginSize=margin)
        image = cv2.warpPerspective(print_out, K @ pose @ to_sheet, (760, 720), borderValue=128)
        image = cv2.GaussianBlur(image, (0, 0), 0.8)
        for known in (None, camera):
            view = find_board(image, board, known)
            assert len(view) == len(board.points)
            true = camera.project(camera_T_board.apply(view.object_points))[0]
            assert np.linalg.norm(view.pixels - true, axis=1).max() < 0.1


def test_without_this_board_there_is_a_reason():
    camera = UnifiedCamera(300, 300, 199.5, 149.5, 0.0, 400, 300)
    far = RigidTransform.from_translation([5.0, 0.0, 1.0])
    nothing = find_board(render(camera, CHARUCO, far), CHARUCO)
    assert nothing.reason == "no marker of DICT_4X4_50 with a number of this board"
    other = find_board(render(camera, APRIL, facing(APRIL, (0, 0, 1), 0.3)), CHARUCO)
    assert not other.found


@pytest.mark.parametrize(
    ("board", "turned"),
    [(CHARUCO, CharucoBoard(6, 8, 0.03, 0.022, "DICT_4X4_50")), (APRIL, AprilGrid(4, 5, 0.03, 0.3))],
    ids=["charuco", "aprilgrid"],
)
@pytest.mark.parametrize("tilt", [(0.0, 0.0), (0.3, -0.2), (-0.4, 0.3)])
def test_a_board_with_columns_and_rows_exchanged_is_not_found_and_said(board, turned, tilt):
    camera = preset("perspective")
    image = render(camera, board, facing(board, (0, 0, 1), 0.35, tilt, 0.7))
    assert find_board(image, board).found
    view = find_board(image, turned)
    assert not view.found
    assert "are columns and rows exchanged?" in view.reason
