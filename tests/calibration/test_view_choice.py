"""Which views of a board are kept, and what is said to be missing: boards drawn by a pinhole's formula."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from omniservo.calibration import board_from_text
from omniservo.calibration.boards import BoardView
from omniservo.calibration.view_choice import ENOUGH, THIRDS, Appearance, ViewChoice, moved

SIZE, FOCAL = (900, 600), 600.0
BOARD = board_from_text("charuco:8x6:0.03:0.02:DICT_4X4_50")
NAMES = [name for row in THIRDS for name in row]
LIGHT = np.full((SIZE[1], SIZE[0]), 200, dtype=np.uint8)


def seen(u=450.0, v=300.0, distance=0.6, turn=(0.0, 0.0), roll=0.0):
    """The board's middle at a pixel, turned about the image's vertical and horizontal [deg]."""
    points = BOARD.points - 0.5 * (BOARD.points.min(0) + BOARD.points.max(0))
    rotation = Rotation.from_euler("zyx", [roll, *turn], degrees=True)
    x, y, z = rotation.apply(points).T + np.array([[0.0], [0.0], [distance]])
    pixels = np.column_stack([u + FOCAL * x / z, v + FOCAL * y / z])
    inside = ((pixels >= 0) & (pixels < SIZE)).all(1)
    return BoardView.of(BOARD, np.where(inside, np.arange(len(pixels)), -1), pixels)


def choice_after(*views):
    """A choice in a light room, for which each view stood still for two images."""
    choice = ViewChoice(SIZE)
    choice.light(LIGHT)
    for view in views:
        choice.judge(view)
        choice.judge(view)
    return choice


def everywhere():
    return [seen(u, v) for v in (100, 300, 500) for u in (150, 450, 750)]


def test_the_same_view_is_kept_once_and_only_when_it_stands_still():
    choice, view = ViewChoice(SIZE), seen()
    first = choice.judge(view)
    assert not first.kept
    assert "hold it still" in first.words
    assert choice.judge(view).kept
    again = [choice.judge(view) for _ in range(3)]
    assert not any(judgement.kept for judgement in again)
    assert "like a view that is kept" in again[0].words
    assert len(choice.kept) == 1


def test_a_moving_board_is_not_kept_until_it_stops():
    choice = ViewChoice(SIZE)
    walk = [choice.judge(seen(450 + 3 * k)) for k in range(5)]
    assert not any(judgement.kept for judgement in walk)
    assert "3.0 px" in walk[-1].words
    assert choice.judge(seen(462.5)).kept


def test_a_board_that_was_lost_in_between_does_not_stand_still():
    choice = ViewChoice(SIZE)
    choice.judge(seen())
    lost = choice.judge(BoardView.nothing("no corners"))
    assert (lost.kept, lost.words) == (False, "no board: no corners")
    assert not choice.judge(seen()).kept


@pytest.mark.parametrize(
    ("other", "kept"),
    [
        (seen(600), True),
        (seen(distance=0.4), True),
        (seen(turn=(35, 0)), True),
        (seen(turn=(0, 35)), True),
        (seen(460), False),
        (seen(distance=0.58), False),
        (seen(turn=(5, 0)), False),
    ],
)
def test_another_place_size_or_tilt_is_news(other, kept):
    choice = choice_after(seen(), other)
    assert len(choice.kept) == 1 + kept


def test_turns_about_two_axes_differ_where_the_tilt_is_the_same():
    assert len(choice_after(seen(turn=(35, 0)), seen(turn=(0, 35))).kept) == 2


@pytest.mark.parametrize(("turn", "about_vertical"), [((30, 0), True), ((0, -30), False)])
@pytest.mark.parametrize("roll", [0, 40, 90])
def test_tilt_and_axis_are_read_from_the_view(turn, about_vertical, roll):
    # rolled in its own plane first: axes of the image, not of the board
    points = BOARD.points - 0.5 * (BOARD.points.min(0) + BOARD.points.max(0))
    rotation = Rotation.from_euler("yx", turn, degrees=True) * Rotation.from_euler("z", roll, degrees=True)
    x, y, z = rotation.apply(points).T + np.array([[0.0], [0.0], [3.0]])
    view = BoardView.of(BOARD, np.arange(len(x)), np.column_stack([450 + FOCAL * x / z, 300 + FOCAL * y / z]))
    look = Appearance.of(view, SIZE)
    assert math.degrees(look.tilt) == pytest.approx(30.0, abs=2.0)
    assert look.about_vertical == about_vertical


def test_what_is_missing_is_said_in_words():
    words = choice_after().missing()
    assert [w for w in words if "board in the" in w] == [f"the board in the {name}" for name in NAMES]
    assert any("about the vertical" in w for w in words)
    assert any("about the horizontal" in w for w in words)
    assert any("nearer or farther" in w for w in words)
    assert words[-1] == f"{ENOUGH} more views"


@pytest.mark.parametrize(("place", "name"), list(enumerate(NAMES)))
def test_a_part_of_the_image_is_missing_until_the_board_was_there(place, name):
    views = everywhere()
    left_out = choice_after(*views[:place], *views[place + 1 :])
    assert [w for w in left_out.missing() if "board in the" in w] == [f"the board in the {name}"]
    left_out.judge(views[place])
    left_out.judge(views[place])
    assert not [w for w in left_out.missing() if "board in the" in w]


def test_tilts_sizes_and_number_end_the_list_one_by_one():
    choice = choice_after(*everywhere())
    assert len(choice.missing()) == 4
    assert choice.missing()[-1] == "1 more view"
    for view, word in (
        (seen(turn=(30, 0)), "vertical"),
        (seen(turn=(0, 30)), "horizontal"),
        (seen(distance=0.35), "nearer"),
    ):
        assert any(word in w for w in choice.missing())
        choice.judge(view)
        assert choice.judge(view).kept
        assert not any(word in w for w in choice.missing())
    assert choice.missing() == ()


def test_a_view_like_others_that_covers_a_missing_part_is_kept():
    choice = choice_after(seen(450, 300), seen(320, 300))
    assert any("middle of the left edge" in w for w in choice.missing())
    nearby = seen(250, 300)
    assert any(Appearance.of(nearby, SIZE).is_like(Appearance.of(k, SIZE)) for k in choice.kept)
    choice.judge(nearby)
    assert choice.judge(nearby).words == "kept: another part of the image"


def test_no_board_is_required_where_the_lens_shows_nothing():
    choice, image = ViewChoice(SIZE), LIGHT.copy()
    image[:200, :300] = 10
    choice.light(image)
    assert "the board in the upper left corner" not in choice.missing()
    assert math.isnan(choice.covered_thirds[0, 0])
    assert np.isfinite(choice.covered_thirds).sum() == 8


def test_few_points_or_points_on_a_line_are_not_kept():
    view = seen()
    few = BoardView(view.pixels[:5], view.object_points[:5], view.ids[:5])
    line = np.arange(7)  # the first row of corners
    on_a_line = BoardView(view.pixels[line], view.object_points[line], view.ids[line])
    for bad in (few, on_a_line):
        choice = ViewChoice(SIZE)
        choice.judge(bad)
        assert not choice.judge(bad).kept
        assert "points" in choice.judge(bad).words


def test_a_board_counted_from_its_other_end_does_not_move():
    view = replace(seen(), turnable=True)
    turned = BoardView(view.pixels[::-1], view.object_points, view.ids, turnable=True)
    assert moved(view, turned) == 0.0
    assert moved(seen(), turned) == 0.0
    assert moved(view, replace(turned, turnable=False)) > 50.0


def test_motion_is_of_the_points_that_both_images_show():
    view = seen()
    half = BoardView(view.pixels[::2] + 0.5, view.object_points[::2], view.ids[::2])
    assert moved(view, half) == pytest.approx(math.sqrt(0.5))
    other = BoardView(view.pixels[1::2], view.object_points[1::2], view.ids[1::2])
    assert math.isinf(moved(half, other))
