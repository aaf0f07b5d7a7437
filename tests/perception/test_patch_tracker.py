"""Points of a textured scene followed along a path, lost where they cannot be seen, and found again."""

import numpy as np
import pytest
from textured_scenes import Plate, picture, pose, relief, seen_again, tiles

from omniservo.cameras import UnifiedCamera
from omniservo.errors import InputError
from omniservo.perception import PatchTracker, match_images

CAMERA = UnifiedCamera(220.0, 221.0, 239.0, 162.0, 1.29, 480, 330, max_angle=np.radians(100.0))


def on_the_way(s):
    return pose(s * np.array([0.2, -0.05, 0.15]), s * np.array([5.0, -15.0, 25.0]))


@pytest.fixture(scope="module")
def scene():
    rng = np.random.default_rng(7)
    plates = relief(rng)
    images = {s: picture(CAMERA, plates, on_the_way(s), rng, rays=2) for s in (0.0, 0.3, 0.6, 1.0)}
    match = match_images(CAMERA, images[0.0], images[1.0])
    truth = seen_again(CAMERA, plates, on_the_way(0.0), on_the_way(1.0), match.initial.pixels)
    right = np.flatnonzero(np.linalg.norm(truth - match.goal.pixels, axis=1) < 0.5)
    rows = np.random.default_rng(1).choice(right, 40, replace=False)
    return plates, images, match.initial.pixels[rows], match.goal.pixels[rows]


def truth(scene, s):
    return seen_again(CAMERA, scene[0], on_the_way(0.0), on_the_way(s), scene[2])


def near(pixels, seed, sigma=3.0):
    return pixels + np.clip(np.random.default_rng(seed).normal(0.0, sigma, pixels.shape), -8.0, 8.0)


@pytest.mark.parametrize("goal", [False, True])
def test_points_are_followed_to_a_tenth_of_a_pixel(scene, goal):
    _, images, initial, final = scene
    extra = {"goal_image": images[1.0], "pixels_goal": final} if goal else {}
    tracker = PatchTracker(CAMERA, images[0.0], initial, **extra)
    assert tracker.trackable.sum() >= 38
    for seed, s in enumerate((0.0, 0.3, 0.6, 1.0)):
        true = truth(scene, s)
        pixels, valid = tracker.update(images[s], near(true, seed))
        error = np.linalg.norm(pixels - true, axis=1)[valid]
        assert valid.sum() >= 0.8 * np.isfinite(true).all(1).sum()
        assert np.nanmedian(error) < 0.1
        assert np.nanmean(error < 0.5) > 0.9
        assert np.isnan(pixels[~valid]).all()


def test_nothing_drifts(scene):
    _, images, initial, _ = scene
    tracker = PatchTracker(CAMERA, images[0.0], initial)
    for _ in range(4):
        for s in (0.3, 0.6, 0.3):
            tracker.update(images[s], truth(scene, s))
    pixels, valid = tracker.update(images[0.0], near(initial, 5, 1.0))
    assert valid.sum() >= 36
    assert np.linalg.norm(pixels - initial, axis=1)[valid].max() < 0.02


def test_what_is_covered_is_lost_and_found_again_when_it_is_seen(scene):
    _, images, initial, _ = scene
    tracker = PatchTracker(CAMERA, images[0.0], initial)
    covered = images[0.3].copy()
    covered[:, 240:] = 90
    true = truth(scene, 0.3)
    hidden = true[:, 0] > 238.0
    _, valid = tracker.update(covered, true)
    assert hidden.sum() > 5
    assert not valid[hidden].any()
    assert valid[true[:, 0] < 225.0].mean() > 0.8
    _, valid = tracker.update(images[0.3], true)
    assert valid[hidden].mean() > 0.8


def test_a_point_is_not_looked_for_beyond_its_gate_or_without_a_prediction(scene):
    _, images, initial, _ = scene
    tracker = PatchTracker(CAMERA, images[0.0], initial, gate_px=6.0)
    far = initial + 9.0
    far[0] = np.nan
    pixels, valid = tracker.update(images[0.0], far)
    assert not valid.any()
    assert np.isnan(pixels).all()


def test_a_patch_with_a_twin_in_the_gate_is_lost_rather_than_mistaken():
    rng = np.random.default_rng(3)
    texture = tiles(rng, 16)
    plates = [Plate(pose([0.0, 0.0, 0.5]), (0.6, 0.6), texture, 0.0022)]  # a period is about 10 px
    image = picture(CAMERA, plates, pose([0.0, 0.0, 0.0]), rays=2)
    u, v = np.meshgrid(np.arange(180.0, 300.0, 17.0), np.arange(110.0, 220.0, 17.0))
    points = np.stack([u.ravel(), v.ravel()], axis=1)
    tracker = PatchTracker(CAMERA, image, points)
    pixels, valid = tracker.update(image, points + np.array([6.0, 0.0]))
    assert np.linalg.norm(pixels - points, axis=1)[valid].max(initial=0.0) < 1.0
    assert valid.mean() < 0.5


def test_points_outside_the_picture_or_on_a_flat_wall_cannot_be_tracked(scene):
    _, images, initial, _ = scene
    flat = images[0.0].copy()
    flat[100:150, 100:150] = 77
    points = np.array([[2.0, 3.0], [125.0, 125.0], [np.nan, 5.0], initial[0]])
    assert PatchTracker(CAMERA, flat, points).trackable[:3].tolist() == [False, False, False]
    assert PatchTracker(CAMERA, images[0.0], points).trackable[3]


def test_wrong_arguments_are_named(scene):
    _, images, initial, final = scene
    with pytest.raises(InputError, match="both"):
        PatchTracker(CAMERA, images[0.0], initial, goal_image=images[1.0])
    with pytest.raises(InputError, match="pixels_goal: 3 rows"):
        PatchTracker(CAMERA, images[0.0], initial, goal_image=images[1.0], pixels_goal=final[:3])
    with pytest.raises(InputError, match="pixels: shape"):
        PatchTracker(CAMERA, images[0.0], initial[:, :1])
    with pytest.raises(InputError, match="gate_px"):
        PatchTracker(CAMERA, images[0.0], initial, gate_px=0.0)
    with pytest.raises(InputError, match="predicted_pixels"):
        PatchTracker(CAMERA, images[0.0], initial).update(images[0.0], initial[:3])
    with pytest.raises(InputError, match="image"):
        PatchTracker(CAMERA, images[0.0], initial).update(images[0.0][:-1], initial)


def test_a_single_point_at_the_rim_of_the_lens_is_lost(scene):
    _, images, initial, _ = scene
    rim, _ = CAMERA.project(np.array([[np.sin(a := CAMERA.max_angle - 1e-6), 0.0, np.cos(a)]]))
    pixels, valid = PatchTracker(CAMERA, images[0.0], initial[:1]).update(images[0.0], rim)
    assert np.isnan(pixels).all()
    assert not valid.any()


def test_no_points_are_followed_to_none(scene):
    pixels, valid = PatchTracker(CAMERA, scene[1][0.0], np.empty((0, 2))).update(
        scene[1][0.3], np.empty((0, 2))
    )
    assert pixels.shape == (0, 2)
    assert valid.shape == (0,)
