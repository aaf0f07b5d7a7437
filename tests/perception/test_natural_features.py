"""Natural features of rendered wide-angle pictures: found, matched, refined, or refused by name."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial import SphericalVoronoi
from textured_scenes import (
    Plate,
    cast,
    corner,
    facing_plate,
    picture,
    pose,
    relief,
    rough_texture,
    seen_again,
    tiles,
)

from omniservo.cameras import UnifiedCamera
from omniservo.errors import InputError
from omniservo.perception import (
    Features,
    ImagePoints,
    NaturalKind,
    find_features,
    match_features,
    match_images,
)
from omniservo.perception.field_views import REACH, _axes
from omniservo.perception.guided_matches import LEAST_GUIDES, guided_matches
from omniservo.perception.match_features import FeatureMatch
from omniservo.perception.refine_matches import refine_matches

CAMERA = UnifiedCamera(220.0, 221.0, 239.0, 162.0, 1.29, 480, 330, max_angle=np.radians(100.0))
HERE, THERE = pose([0.0, 0.0, 0.0]), pose([0.08, 0.03, 0.05], [3, -6, 8])


@pytest.fixture(scope="module")
def scene():
    rng = np.random.default_rng(5)
    plates = relief(rng)
    images = [picture(CAMERA, plates, w, rng, rays=2) for w in (HERE, THERE)]
    return plates, *images, match_images(CAMERA, *images)


def offsets(plates, match, there=THERE):
    truth = seen_again(CAMERA, plates, HERE, there, match.initial.pixels)
    return match.goal.pixels - truth


@pytest.mark.slow
def test_matched_pixels_show_the_same_point_of_the_surface(scene):
    plates, _, _, match = scene
    assert match.status == "ok"
    distance = np.linalg.norm(offsets(plates, match), axis=1)
    right = distance < 1.0  # NaN: nothing, or something in front
    assert len(match) > 300
    assert right.mean() > 0.97
    assert np.median(distance[right]) < 0.06
    assert np.percentile(distance[right], 90) < 0.15


def test_the_stated_covariance_is_about_the_true_one(scene):
    plates, _, _, match = scene
    error = offsets(plates, match)
    right = np.linalg.norm(error, axis=1) < 0.5
    # nearly the same shape in both pictures: what is uncertain is the difference
    covariance = (match.initial.covariance + match.goal.covariance)[right]
    squared = np.einsum("ni,nij,nj->n", error[right], np.linalg.inv(covariance), error[right])
    assert 0.3 < np.median(squared) / 1.386 < 2.0
    unlike = match.correlation[right] < 0.95  # the shape differs after all, and so does more than noise
    assert unlike.sum() > 25
    assert 0.5 < np.median(squared[unlike]) / 1.386 < 1.5


def test_a_long_lens_shows_as_many_features_as_a_shorter_one_with_the_same_image():
    image = rough_texture(np.random.default_rng(3), 512).astype(np.uint8)
    short, long = (
        find_features(image, UnifiedCamera(f, f, 255.5, 255.5, 0.0, 512, 512)) for f in (1000.0, 12000.0)
    )
    assert len(short) > 500
    assert len(long) > 0.9 * len(short)


def test_a_match_says_how_wide_its_window_is(scene):
    _, initial, goal, match = scene
    matched = NaturalKind().match(CAMERA, initial, goal)
    np.testing.assert_array_equal(matched.window, match.window)
    # Patches of 17 samples, a pixel apart at least, more for features of a larger scale.
    assert match.window.min() == pytest.approx(0.55 * 8, rel=0.2)
    assert match.window.max() < 3.0 * match.window.min()
    chosen = np.array([5, 2])
    np.testing.assert_array_equal(matched.where(chosen).window, match.window[chosen])


def test_few_pairs_among_many_features_are_too_few_unless_they_agree_on_one_motion(scene):
    _, initial, goal, match = scene
    a, b = find_features(initial, CAMERA), find_features(goal, CAMERA)
    least = math.ceil(min(len(a.points), len(b.points)) / 16)
    pairs = match_features(a, b).pairs
    assert 3 * least < len(match) < len(pairs)
    kept = refine_matches(CAMERA, initial, goal, a, b, FeatureMatch(pairs[: 2 * least], "ok", ""))
    few = refine_matches(CAMERA, initial, goal, a, b, FeatureMatch(pairs[: least - 1], "ok", ""))
    assert kept.status == few.status == "ok"
    scattered = a.points.pixels + np.random.default_rng(0).normal(0.0, 20.0, a.points.pixels.shape)
    elsewhere = replace(a, points=ImagePoints(scattered, a.points.covariance))
    few = refine_matches(CAMERA, initial, goal, elsewhere, b, FeatureMatch(pairs[: least - 1], "ok", ""))
    assert (few.status, len(few)) == ("too_few", 0)
    assert f"{least} are needed" in few.reason


def test_few_pairs_of_one_plane_among_many_features_are_believed(scene):
    """They agree with many motions: none is found, and they were refused however many of them agreed."""
    plates, initial, goal, _ = scene
    a, b = find_features(initial, CAMERA), find_features(goal, CAMERA)
    pairs = match_features(a, b).pairs
    plate = cast(plates, HERE, a.bearings[pairs[:, 0]])[1]
    few = pairs[plate == np.bincount(plate[plate >= 0]).argmax()][:30]
    assert len(few) < min(len(a.points), len(b.points)) / 16
    found = refine_matches(CAMERA, initial, goal, a, b, FeatureMatch(few, "ok", ""))
    assert found.status == "ok"
    assert len(found) >= 16


@pytest.mark.slow
def test_the_motion_of_clear_pairs_finds_a_third_more_of_a_turned_camera():
    rng, there = np.random.default_rng(5), pose([0.5, 0.1, 0.1], [5, -50, 30])
    plates = corner(rng)
    initial, goal = (picture(CAMERA, plates, w, rng, rays=2) for w in (HERE, there))
    a, b = find_features(initial, CAMERA), find_features(goal, CAMERA)
    clear = refine_matches(CAMERA, initial, goal, a, b, match_features(a, b))
    match = match_images(CAMERA, initial, goal)
    known = {tuple(p) for p in clear.initial.pixels}
    added = np.array([tuple(p) not in known for p in match.initial.pixels])
    assert len(match) > 1.3 * len(clear)
    distance = np.linalg.norm(offsets(plates, match, there), axis=1)
    assert (distance[added] < 1.0).mean() > 0.9
    assert (distance < 1.0).mean() > 0.97


def test_pairs_that_agree_on_no_motion_are_no_guide(scene):
    _, initial, goal, _ = scene
    a, b = find_features(initial, CAMERA), find_features(goal, CAMERA)
    few = FeatureMatch(match_features(a, b).pairs[: LEAST_GUIDES - 1], "ok", "")
    elsewhere = find_features(initial[::-1].copy(), CAMERA)
    assert len(guided_matches(CAMERA, initial, goal, a, b, few)) < LEAST_GUIDES
    wrong = FeatureMatch(np.tile(np.arange(40)[:, None], 2), "ok", "")
    assert guided_matches(CAMERA, initial, goal, elsewhere, b, wrong).status == "too_few"


def test_a_features_own_covariance_covers_where_it_is_found_again(scene):
    plates, initial, goal, _ = scene
    a, b = find_features(initial, CAMERA), find_features(goal, CAMERA)
    i, j = match_features(a, b).pairs.T
    error = b.points.pixels[j] - seen_again(CAMERA, plates, HERE, THERE, a.points.pixels[i])
    right = np.linalg.norm(error, axis=1) < 3.0
    covariance = (a.points.covariance[i] + b.points.covariance[j])[right]
    squared = np.einsum("ni,nij,nj->n", error[right], np.linalg.inv(covariance), error[right])
    assert 0.3 < np.median(squared) / 1.386 < 2.0


def test_pairs_are_one_to_one(scene):
    _, initial, goal, _ = scene
    a, b = find_features(initial, CAMERA), find_features(goal, CAMERA)
    pairs = match_features(a, b).pairs
    assert len(np.unique(pairs[:, 0])) == len(np.unique(pairs[:, 1])) == len(pairs)
    np.testing.assert_allclose(np.linalg.norm(a.descriptors, axis=1), 1.0, atol=1e-5)
    np.testing.assert_allclose((a.axes * a.bearings).sum(1), 0.0, atol=1e-12)


def test_a_place_of_the_goal_image_shows_one_point():
    camera = UnifiedCamera(2000.0, 2000.0, 99.5, 59.5, 0.0, 200, 120)
    half = cv2.GaussianBlur(np.random.default_rng(2).uniform(0, 255, (120, 100)), (0, 0), 2.0)
    twice = cv2.normalize(np.hstack([half, half]), None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
    features = find_features(twice, camera)
    apart = features.points.pixels[:, None] + [100.0, 0.0] - features.points.pixels
    left, right = np.argwhere(np.linalg.norm(apart, axis=2) < 0.1).T
    pairs = np.vstack([np.column_stack([left, left]), np.column_stack([right, left])])
    match = refine_matches(camera, twice, twice, features, features, FeatureMatch(pairs, "ok", ""))
    gaps = np.linalg.norm(match.goal.pixels[:, None] - match.goal.pixels, axis=2)
    assert len(match) > 10
    assert gaps[~np.eye(len(gaps), dtype=np.bool_)].min() > 1.0


def test_no_direction_is_farther_from_a_view_than_views_reach():
    axes = _axes()
    farthest = SphericalVoronoi(axes).vertices  # as far as any from the axes round them
    away = np.arccos((farthest @ axes.T).max(axis=1))
    assert REACH - math.radians(0.1) < away.max() < REACH


def test_no_feature_is_found_twice_where_views_meet():
    rng = np.random.default_rng(3)
    plates = [facing_plate(rough_texture(rng), 22.0)]  # views meet at 22.5°
    found = find_features(picture(CAMERA, plates, HERE, rays=2), CAMERA)
    gap = np.linalg.norm(found.points.pixels[:, None] - found.points.pixels, axis=2)
    near = np.triu((gap < 0.3) & (found.axes @ found.axes.T > 0.0), 1)
    length = np.linalg.norm(found.axes, axis=1)
    alike = found.axes @ found.axes.T > 0.95 * np.minimum.outer(length, length) ** 2
    i, j = np.nonzero(near & alike)
    assert len(found) > 200
    assert (found.descriptors[i] * found.descriptors[j]).sum(1).max(initial=0.0) < 0.97


@pytest.mark.slow
@pytest.mark.parametrize("angle", [60.0, 88.0])
def test_features_are_matched_wherever_the_lens_looks(angle):
    rng = np.random.default_rng(7)
    plates, there = [facing_plate(rough_texture(rng), angle)], pose([0.05, 0.03, 0.02], [3, 8, 8])
    match = match_images(CAMERA, *(picture(CAMERA, plates, w, rng, rays=2) for w in (HERE, there)))
    distance = np.linalg.norm(offsets(plates, match, there), axis=1)
    bearings = CAMERA.unproject(match.initial.pixels)[0]
    assert np.degrees(np.arccos(bearings[:, 2])).max() > angle
    assert np.median(distance[distance < 1.0]) < 0.06
    assert (distance < 1.0).mean() > 0.97
    if angle > 80.0:
        assert (bearings[:, 2] < 0.0).sum() > 10  # past 90° from the axis


@pytest.mark.slow
def test_a_pattern_that_repeats_is_ambiguous_however_well_its_shifted_copy_fits():
    rng = np.random.default_rng(32)
    plates = [Plate(pose([0.0, 0.0, 0.5]), (0.6, 0.6), tiles(rng, 32), 0.004)]
    for moved in (pose([0.128, 0.0, 0.0]), THERE):  # by one period, and by something else
        match = match_images(CAMERA, *(picture(CAMERA, plates, w, rng, rays=2) for w in (HERE, moved)))
        assert match.status == "ambiguous"
        assert "repeats" in match.reason
        assert len(match) == len(match.correlation) == 0


def test_a_small_repeated_part_does_not_spoil_the_rest():
    rng = np.random.default_rng(4)
    plates = relief(rng)
    plates[1] = Plate(plates[1].world_T_plate, (0.15, 0.15), tiles(rng, 32), 0.003)
    match = match_images(CAMERA, *(picture(CAMERA, plates, w, rng, rays=2) for w in (HERE, THERE)))
    distance = np.linalg.norm(offsets(plates, match), axis=1)
    assert match.status == "ok"
    assert (distance < 1.0).mean() > 0.95


@pytest.mark.slow
def test_pictures_of_different_places_or_of_nothing_have_too_few_pairs(scene):
    _, initial, _, _ = scene
    other = picture(CAMERA, relief(np.random.default_rng(77)), THERE, rays=2)
    assert match_images(CAMERA, initial, other).status == "too_few"
    flat = np.full_like(initial, 90)
    assert match_images(CAMERA, initial, flat).status == "too_few"
    assert match_images(CAMERA, flat, flat).status == "too_few"
    assert len(find_features(flat, CAMERA)) == 0


def test_the_same_picture_twice_is_matched_to_itself_without_any_motion(scene):
    _, initial, _, _ = scene
    match = match_images(CAMERA, initial, initial)
    assert match.status == "ok"
    assert np.abs(match.goal.pixels - match.initial.pixels).max() < 0.01


def test_motion_blur_costs_pairs_and_not_their_truth(scene):
    plates, initial, goal, sharp = scene
    blurred = cv2.blur(goal, (5, 1))
    match = match_images(CAMERA, initial, blurred)
    assert match.status in ("ok", "too_few")
    if match.status == "ok":
        distance = np.linalg.norm(offsets(plates, match), axis=1)
        assert len(match) < len(sharp)
        assert (distance < 1.5).mean() > 0.9


@pytest.mark.parametrize("image", [np.zeros((330, 479), np.uint8), np.zeros((330, 480)), "picture"])
def test_what_is_no_picture_of_the_camera_is_refused(image):
    with pytest.raises(InputError, match="image"):
        find_features(image, CAMERA)


def test_features_and_matches_keep_their_own_numbers():
    descriptors, pairs = np.full((2, 128), 1e-2, np.float32), np.array([[0, 1]])
    points = ImagePoints(np.zeros((2, 2)), np.tile(np.eye(2), (2, 1, 1)))
    found = Features(points, descriptors, np.ones(2), np.eye(3)[:2], np.eye(3)[1:])
    match = FeatureMatch(pairs, "ok", "one pair")
    descriptors[:], pairs[:] = 7.0, 7
    assert (found.descriptors == np.float32(1e-2)).all()
    assert match.pairs.tolist() == [[0, 1]]
