"""Circle grids in rendered pictures; a lens moves a disc's centroid away from the image of its centre."""

import cv2
import numpy as np
import pytest
from tests.calibration.rendered_boards import around, facing, render, true_pixels

from omniservo.calibration.boards import CircleGrid, find_board
from omniservo.calibration.boards.board_pose import board_pose
from omniservo.cameras import preset

SYMMETRIC = CircleGrid(8, 5, 0.03, 0.018)
ASYMMETRIC = CircleGrid(4, 9, 0.018, 0.014, "asymmetric")
VIEWS = [  # camera, direction of the board's middle, distance
    ("fe185", (0, 0, 1), 0.15),
    ("fe185", (1, 0.1, 0.5), 0.25),
    ("para-catadioptric", (-1, 0.3, 0.3), 0.25),
    ("hyper-catadioptric", (1, 0.6, 0.3), 0.25),
    ("perspective", (0.1, 0, 1), 0.3),
]


def error_of(view, pixels):
    """Distances [px]; a grid that looks the same turned may have been counted from its other end."""
    ways = (pixels, pixels[::-1]) if view.turnable else (pixels,)
    return min((np.linalg.norm(view.pixels - way[view.ids], axis=1) for way in ways), key=np.median)


@pytest.mark.parametrize("board", [SYMMETRIC, ASYMMETRIC], ids=["symmetric", "asymmetric"])
@pytest.mark.parametrize(("name", "direction", "distance"), VIEWS)
def test_with_a_camera_centres_lie_within_hundredths_of_a_pixel(board, name, direction, distance):
    camera = preset(name)
    pose = facing(board, direction, distance, (0.3, 0.2), 0.4)
    camera = around(camera, board, pose)
    view = find_board(render(camera, board, pose), board, camera)
    pixels, seen = true_pixels(camera, board, pose)
    error = error_of(view, pixels)
    assert len(view) >= 0.9 * seen.sum()
    assert np.median(error) < 0.02
    assert error.max() < 0.06
    assert view.turnable == (board is SYMMETRIC)


def test_without_a_camera_centroids_are_off_by_what_the_lens_does():
    camera = preset("perspective")
    pose = facing(SYMMETRIC, (0.1, 0, 1), 0.3, (0.5, 0.3), 0.4)
    camera = around(camera, SYMMETRIC, pose)
    image = render(camera, SYMMETRIC, pose)
    pixels, _ = true_pixels(camera, SYMMETRIC, pose)
    without = np.median(error_of(find_board(image, SYMMETRIC), pixels))
    corrected = np.median(error_of(find_board(image, SYMMETRIC, camera), pixels))
    assert without > 0.1
    assert corrected < 0.1 * without


def test_discs_of_hundreds_of_pixels_are_found():
    """Such as a camera of ten megapixels shows: none was found above 200."""
    board, spacing, radius = CircleGrid(4, 3, 0.03, 0.02), 420, 140
    image = np.full((1350, 1800), 215, dtype=np.uint8)
    centres = [200, 180] + spacing * board.places.astype(int)
    for centre in centres.tolist():
        cv2.circle(image, centre, radius, 20, -1)
    image = cv2.GaussianBlur(image, (0, 0), 1.5)
    view = find_board(image, board)
    assert len(view) == 12, view.reason
    assert np.abs(view.pixels - centres[view.ids]).max() < 0.05


@pytest.mark.parametrize("board", [SYMMETRIC, ASYMMETRIC], ids=["symmetric", "asymmetric"])
def test_light_discs_on_a_dark_board_are_found_where_dark_ones_are(board):
    camera = preset("perspective")
    image = render(camera, board, facing(board, (0.1, 0, 1), 0.35, (0.3, 0.2), 0.4))
    dark, light = find_board(image, board), find_board(255 - image, board)
    assert len(dark) == len(board.points)
    np.testing.assert_array_equal(light.ids, dark.ids)
    np.testing.assert_allclose(light.pixels, dark.pixels, atol=0.02)


def test_without_this_grid_there_is_a_reason():
    camera = preset("perspective")
    image = render(camera, SYMMETRIC, facing(SYMMETRIC, (0, 0, 1), 0.35))
    other = find_board(image, CircleGrid(9, 7, 0.03, 0.018))
    assert other.reason.startswith("a grid of 8×5 discs (40 in all) was found, not 9×7 discs (symmetric)")
    empty = find_board(np.full((480, 640), 200, dtype=np.uint8), SYMMETRIC)
    assert empty.reason == "no grid of 8×5 discs (symmetric)"


@pytest.mark.parametrize("name", ["fe185", "hyper-catadioptric", "perspective"])
def test_the_boards_pose_comes_back_from_its_pixels(name):
    camera = preset(name)
    direction = (0.1, 0, 1) if name == "perspective" else (1, 0.1, 0.4)
    pose = facing(SYMMETRIC, direction, 0.4, (0.3, 0.2), 0.4)
    camera = around(camera, SYMMETRIC, pose)
    pixels, seen = true_pixels(camera, SYMMETRIC, pose)
    assert seen.all()
    found = board_pose(camera, pixels, SYMMETRIC.points)
    off = found.inv() * pose
    assert np.linalg.norm(off.translation) < 1e-7
    assert off.rotation.magnitude() < 1e-6
