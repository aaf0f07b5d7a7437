import json

import numpy as np
import pytest

from omniservo.cameras import UnifiedCamera
from omniservo.errors import InputError
from omniservo.estimation import (
    TwoViewEstimate,
    estimate_known_target,
    estimate_two_view,
    estimate_views,
    refine_pose,
)


@pytest.fixture
def pixels(make_scene):
    scene = make_scene(np.random.default_rng(61))
    return scene.camera, scene.pixels_initial, scene.pixels_goal


@pytest.mark.parametrize(
    ("initial", "goal", "message"),
    [
        (np.zeros((9, 3)), np.zeros((9, 2)), r"pixels_initial: shape \(9, 3\)"),
        (np.zeros((9, 2)), np.zeros((8, 2)), "9 and 8 rows"),
        (np.zeros((0, 2)), np.zeros((0, 2)), "no pixel"),
        (np.zeros((9, 2)), np.full((9, 2), np.nan), "pixels_goal: nan at index"),
        ("dots", np.zeros((9, 2)), "pixels_initial: 'dots'"),
    ],
)
def test_wrong_pixels_are_named(fisheye, initial, goal, message):
    with pytest.raises(InputError, match=message):
        estimate_two_view(fisheye, initial, goal)


def masked(array):
    """The array with a pixel that was not found in its first row, under whose mask stands some number."""
    pixels = np.ma.masked_array(array, mask=np.zeros(array.shape, dtype=bool), copy=True)
    pixels[(0,) * (array.ndim - 1)] = 7.0
    pixels[(0,) * (array.ndim - 1)] = np.ma.masked
    return pixels


def test_pixels_under_a_mask_are_refused_where_they_would_be_read(make_scene):
    """NumPy hands out the numbers below; they were taken for the pixels."""
    scene = make_scene(np.random.default_rng(61))
    camera, points, goal = scene.camera, scene.points, scene.pixels_goal
    both, use = np.stack([scene.pixels_initial, goal]), np.ones((2, len(points)), dtype=bool)
    use[0, 0] = False
    calls = (
        lambda some: estimate_known_target(camera, points, masked(both[0]), goal, visible=some),
        lambda some: estimate_views(camera, masked(both), visible=some),
        lambda some: estimate_views(
            camera, both, noise=masked(np.ones((2, len(points), 1)))[..., 0], visible=some
        ),
        lambda some: refine_pose(camera, points, masked(goal), scene.initial_T_goal, some[0]),
    )
    for call in calls:
        with pytest.raises(InputError, match="masked entr"):
            call(~np.zeros_like(use))
        call(use)


def test_a_masked_statement_of_what_is_seen_is_refused(make_scene):
    scene = make_scene(np.random.default_rng(61))
    camera, points, goal = scene.camera, scene.points, scene.pixels_goal
    both = np.stack([scene.pixels_initial, goal])
    seen = np.ma.masked_array(np.ones((2, len(points)), dtype=bool), mask=np.arange(2 * len(points)) < 1)
    for call in (
        lambda: estimate_known_target(camera, points, *both, visible=seen),
        lambda: estimate_views(camera, both, visible=seen),
        lambda: refine_pose(camera, points, goal, scene.initial_T_goal, seen[0]),
    ):
        with pytest.raises(InputError, match="1 masked entries given"):
            call()


def test_a_pixel_outside_the_domain_is_named_with_its_index(pixels):
    camera, initial, goal = pixels
    goal = goal.copy()
    goal[4] = [2000.0, 100.0]
    with pytest.raises(InputError, match=r"pixels_goal: \(2000, 100\) at index 4"):
        estimate_two_view(camera, initial, goal, robust=False)


@pytest.mark.parametrize(
    ("scale", "message"),
    [
        (0.0, "scale"),
        (-1.0, "scale"),
        (float("nan"), "scale"),
        (1e-300, r"scale: 1e-300 given; legal: >= 1e-09 and <= 1e\+09"),
        (1e300, r"scale: 1e\+300 given"),
        (((0, 1), 1e300), r"metres: 1e\+300 given"),
        ("big", "scale"),
        (((0, 9), 0.1), "index 9"),
        (((-1, 2), 0.1), "index -1"),
        (((0.5, 2), 0.1), "index 0.5"),
        (((3, 3), 0.1), "two different points"),
        (((0, 1), 0.0), "metres"),
        (((0, 1, 2), 0.1), "legal"),
        ((0.1, 0.2), "legal"),
    ],
)
def test_an_illegal_scale_says_what_is_legal(pixels, scale, message):
    with pytest.raises(InputError, match=message):
        estimate_two_view(*pixels, scale=scale)


@pytest.mark.parametrize(("option", "value"), [("method", "plane"), ("rotation", "euler")])
def test_an_unknown_option_lists_the_legal_ones(pixels, option, value):
    with pytest.raises(InputError, match=f"{option}: '{value}' given; legal:"):
        estimate_two_view(*pixels, **{option: value})


def test_the_virtual_plane_refuses_a_pixel_past_90_degrees(fisheye, pixels):
    _, initial, goal = pixels
    initial = initial.copy()
    initial[3] = fisheye.project(np.array([1.0, 0.0, -0.05]))[0]
    with pytest.raises(InputError, match=r"pixels_initial: index 3 is 90° or more"):
        estimate_two_view(fisheye, initial, goal, method="virtual-plane")


def test_a_rejected_scale_point_is_no_pose(make_scene):
    rng = np.random.default_rng(62)
    scene = make_scene(rng, n=60)
    initial, goal = scene.noisy(rng, 0.05)
    goal[7] += [30.0, 30.0]
    goal[8] += [-30.0, 30.0]
    estimate = estimate_two_view(scene.camera, initial, goal, scale=((7, 20), 0.1))
    assert estimate.status in ("ok", "not_converged")
    if estimate.status == "not_converged":
        assert "point 7" in estimate.message


def same(one: TwoViewEstimate, other: TwoViewEstimate):
    for name in ("status", "message", "is_metric", "seconds"):
        assert getattr(one, name) == getattr(other, name)
    for name in (
        "points",
        "covariance",
        "points_covariance",
        "inliers",
        "residuals_px",
        "rms_px",
        "noise_px",
    ):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    if one.initial_T_goal is None:
        assert other.initial_T_goal is None
    else:
        np.testing.assert_allclose(
            one.initial_T_goal.as_matrix(), other.initial_T_goal.as_matrix(), atol=1e-15
        )


def test_a_saved_estimate_comes_back_as_it_was(tmp_path, pixels, make_scene):
    rng = np.random.default_rng(63)
    scene = make_scene(rng, n=50)
    initial, goal = scene.noisy(rng, 0.1)
    goal[:10] = rng.uniform(100, 400, (10, 2))
    camera = pixels[0]
    for number, estimate in enumerate(
        (
            estimate_two_view(*pixels, scale=0.2),
            estimate_two_view(scene.camera, initial, goal),
            estimate_two_view(camera, pixels[1], pixels[1]),
            estimate_two_view(camera, pixels[1][:3], pixels[2][:3]),
        )
    ):
        path = tmp_path / f"{number}.json"
        estimate.save(path)
        same(estimate, TwoViewEstimate.load(path))
        assert json.loads(path.read_text())["format"] == "omniservo.estimate/1"
        with pytest.raises(InputError, match="exists"):
            estimate.save(path)
        estimate.save(path, force=True)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": "omniservo.estimate/2"}, "format"),
        ({"status": "fine"}, "status: 'fine'"),
        ({"status": "ambiguous"}, "goal"),
        ({"goal": None}, "goal"),
        ({"goal": {"translation": [0, 0, 1]}}, "translation and quaternion"),
        ({"goal": {"translation": [0, 0, 1], "quaternion": [0, 0, 0, 2]}}, "norm 2"),
        ({"points": [[1, 2, 3]]}, "points"),
        ({"points": "many"}, "points"),
        ({"points": [[1, 2, True]] * 9}, "points: an array of numbers"),
        ({"rms_px": "1"}, "rms_px: an array of numbers"),
        ({"noise_px": True}, "noise_px: an array of numbers"),
        ({"inliers": [1] * 9}, "inliers"),
        ({"colour": 1}, "colour: unknown"),
        ({"seconds": -1.0}, "seconds"),
        ({"rms_px": float("inf")}, "rms_px"),
        ({"noise_px": 10**400}, "noise_px"),
    ],
)
def test_a_broken_file_is_named_by_its_field(pixels, change, message):
    fields = estimate_two_view(*pixels).to_dict() | change
    with pytest.raises(InputError, match=message):
        TwoViewEstimate.from_dict(fields, "file.json")


def test_a_missing_field_is_named(pixels):
    fields = estimate_two_view(*pixels).to_dict()
    del fields["covariance"]
    with pytest.raises(InputError, match="covariance: missing"):
        TwoViewEstimate.from_dict(fields)


def test_the_camera_limits_which_pixels_count():
    narrow = UnifiedCamera(296.9, 298.4, 316.8, 254.9, 1.291, 659, 432, max_angle=0.5)
    with pytest.raises(InputError, match="28.6° from the axis"):
        estimate_two_view(narrow, np.full((9, 2), 30.0), np.full((9, 2), 300.0))
