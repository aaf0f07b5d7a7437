"""What an affinity misses of a plane that stands askew is taken off the places of patches."""

from __future__ import annotations

import sys

import numpy as np
import pytest
import textured_scenes as scenes
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo import preset
from omniservo.perception import match_images
from omniservo.perception.align_patches import Alignment, window, window_variance
from omniservo.perception.perspective_bias import without_perspective_bias
from omniservo.perception.tangent_patches import TangentFrames, grid

PITCH = 0.006
"""[rad] of a sample, about a pixel of the small fisheyes"""
VARIANCE = window_variance(8) * PITCH**2
AXES = ("bearings", "first")
GOAL = RigidTransform.from_components([0.05, -0.1, 0.15], Rotation.from_rotvec([0.1, 0.2, 0.4]))


def plane(rng, count, tilt, depth=0.5, width=0.25):
    """Bearings (n, 3) to random points of a plane, and those of the same points from the goal camera."""
    turned = Rotation.from_rotvec(tilt)
    points = turned.apply(np.column_stack((rng.uniform(-width, width, (count, 2)), np.zeros(count))))
    points += [0.0, 0.0, depth]
    there = GOAL.inv().apply(points)
    return (
        points,
        turned.apply([0.0, 0.0, 1.0]),
        *(p / np.linalg.norm(p, axis=1)[:, None] for p in (points, there)),
    )


def laid_on(points, normal, before, after):
    """Places and affinities that fit best on a plane's patches, and the true places."""
    motion = GOAL.inv().as_matrix()
    homography = motion[:3, :3] + np.outer(motion[:3, 3], normal) / (points @ normal)[:, None, None]
    weight, samples = window(8), PITCH * grid(8)
    rays = np.einsum("nij,nkj->nki", homography, before.directions(np.tile(samples, (len(points), 1, 1))))
    b, e, f = after.bearings, after.first, after.second
    depth = np.einsum("nki,ni->nk", rays, b)
    seen = np.stack([np.einsum("nki,ni->nk", rays, a) / depth for a in (e, f)], axis=2)
    design = np.column_stack((samples, np.ones(len(samples))))
    fitted = np.linalg.solve(design.T @ (weight[:, None] * design), design.T @ (weight[:, None] * seen))
    middle = seen[:, len(samples) // 2]
    return fitted[:, 2], np.swapaxes(fitted[:, :2], 1, 2), middle


def alignment(places, affinities):
    n = len(places)
    return Alignment(places, affinities, np.zeros((n, 2, 2)), np.ones(n), np.ones(n, dtype=bool))


@pytest.mark.parametrize("tilt", [[0.9, 0.0, 0.0], [-0.5, 0.7, 0.3], [0.0, 1.1, 0.0]])
def test_the_places_of_a_plane_that_stands_askew_are_those_of_its_homography(tilt):
    rng = np.random.default_rng(3)
    points, normal, bearings, there = plane(rng, 200, tilt)
    guessed = there + rng.uniform(-3.0, 3.0, there.shape) * PITCH
    guessed /= np.linalg.norm(guessed, axis=1)[:, None]
    before, after = TangentFrames.at(bearings), TangentFrames.at(guessed)
    places, affinities, truth = laid_on(points, normal, before, after)
    found = without_perspective_bias(
        alignment(places, affinities), before, after, np.full(200, VARIANCE), np.ones(200, dtype=bool)
    )
    off, left = (np.linalg.norm(p - truth, axis=1) / PITCH for p in (places, found.places))
    assert np.median(off) > 0.02, "nothing to take off"
    assert np.median(left) < 0.15 * np.median(off)


def test_neighbours_on_another_surface_do_not_tell_how_a_patch_stands():
    rng = np.random.default_rng(4)
    planes = [
        plane(rng, 120, tilt, depth) for tilt, depth in (([0.9, 0.0, 0.0], 0.5), ([-0.9, 0.2, 0.0], 0.9))
    ]
    parts = []
    for points, normal, bearings, there in planes:
        before, after = TangentFrames.at(bearings), TangentFrames.at(there)
        parts.append((before, after, *laid_on(points, normal, before, after)))
    before, after = (
        TangentFrames(
            *(np.concatenate([getattr(p[k], name) for p in parts]) for name in ("bearings", "first"))
        )
        for k in (0, 1)
    )
    places, affinities, truth = (np.concatenate([p[k] for p in parts]) for k in (2, 3, 4))
    found = without_perspective_bias(
        alignment(places, affinities), before, after, np.full(240, VARIANCE), np.ones(240, dtype=bool)
    )
    off, left = (np.linalg.norm(p - truth, axis=1) for p in (places, found.places))
    assert np.median(left) < 0.4 * np.median(off)


def test_wrong_matches_among_the_neighbours_do_no_harm():
    rng = np.random.default_rng(8)
    points, normal, bearings, there = plane(rng, 200, [0.9, 0.0, 0.0])
    before, after = TangentFrames.at(bearings), TangentFrames.at(there)
    places, affinities, truth = laid_on(points, normal, before, after)
    wrong = np.arange(200) % 5 == 0
    places[wrong] += rng.normal(0.0, 0.1, (40, 2))
    found = without_perspective_bias(
        alignment(places, affinities), before, after, np.full(200, VARIANCE), np.ones(200, dtype=bool)
    )
    off, left = (np.linalg.norm(p - truth, axis=1)[~wrong] for p in (places, found.places))
    assert np.median(left) < 0.3 * np.median(off)


def test_a_camera_that_only_turned_has_nothing_to_take_off():
    """Rotations map tangent planes to tangent planes by isometries."""
    rng = np.random.default_rng(9)
    bearings = plane(rng, 100, [0.9, 0.0, 0.0])[2]
    turned = GOAL.rotation.inv().apply(bearings)
    before = TangentFrames.at(bearings)
    after = TangentFrames(turned, GOAL.rotation.inv().apply(before.first))
    still = alignment(np.zeros((100, 2)), np.tile(np.eye(2), (100, 1, 1)))
    found = without_perspective_bias(still, before, after, np.full(100, VARIANCE), np.ones(100, dtype=bool))
    assert np.abs(found.places).max() < 1e-12


def test_the_same_match_twice_and_matches_behind_do_no_harm():
    """A feature of two orientations is matched twice; a wrong match may lie beyond 90° in the goal image."""
    rng = np.random.default_rng(10)
    points, normal, bearings, there = plane(rng, 40, [0.9, 0.0, 0.0])
    twice = np.concatenate((np.arange(40), np.arange(40)))
    amid = bearings.mean(axis=0) / np.linalg.norm(bearings.mean(axis=0))
    before, after = (
        TangentFrames.at(np.vstack((b[twice], one))) for b, one in ((bearings, amid), (there, -there[:1]))
    )
    places, affinities, truth = laid_on(points, normal, before[np.arange(40)], after[np.arange(40)])
    all_places = np.vstack((places[twice], [[0.0, 0.0]]))
    shapes = np.concatenate((affinities[twice], np.eye(2)[None]))
    found = without_perspective_bias(
        alignment(all_places, shapes), before, after, np.full(81, VARIANCE), np.ones(81, dtype=bool)
    )
    off, left = (np.linalg.norm(p - truth, axis=1) for p in (places, found.places[:40]))
    assert np.median(left) < 0.5 * np.median(off)
    assert np.isfinite(found.places).all()


def test_a_patch_without_neighbours_stays_where_it_is():
    """Those that are left out do not count, however many there are."""
    rng = np.random.default_rng(5)
    points, normal, bearings, there = plane(rng, 30, [0.9, 0.0, 0.0])
    before, after = TangentFrames.at(bearings), TangentFrames.at(there)
    places, affinities, _ = laid_on(points, normal, before, after)
    for good in (np.arange(30) == 7, np.zeros(30, dtype=bool)):
        found = without_perspective_bias(
            alignment(places, affinities), before, after, np.full(30, VARIANCE), good
        )
        assert (found.places == places).all()


def test_neighbours_far_away_say_nothing_and_two_that_disagree_little():
    """Ten windows away a neighbour may be on any surface; the scale changes by more than affinities state."""
    for apart, most in ((11.0, 0.0), (0.5, 0.02)):
        bearings = np.array([[0.0, 0.0, 1.0], [apart * np.sqrt(VARIANCE), 0.0, 1.0]])
        bearings /= np.linalg.norm(bearings, axis=1)[:, None]
        frames, grown = TangentFrames.at(bearings), np.tile(1.06 * np.eye(2), (2, 1, 1))
        found = without_perspective_bias(
            alignment(np.zeros((2, 2)), grown), frames, frames, np.full(2, VARIANCE), np.ones(2, dtype=bool)
        )
        assert np.linalg.norm(found.places, axis=1).max() <= most * PITCH


def test_left_out_patches_stay_and_say_nothing_of_the_others():
    rng = np.random.default_rng(7)
    points, normal, bearings, there = plane(rng, 80, [0.9, 0.0, 0.0])
    before, after = TangentFrames.at(bearings), TangentFrames.at(there)
    places, affinities, _ = laid_on(points, normal, before, after)
    good, variance = np.arange(80) < 60, np.full(80, VARIANCE)
    astray = np.where(good[:, None], places, np.nan)
    found = without_perspective_bias(alignment(astray, affinities), before, after, variance, good)
    assert np.isnan(found.places[~good]).all()
    alone = without_perspective_bias(
        alignment(places[good], affinities[good]), before[good], after[good], variance[good], good[good]
    )
    np.testing.assert_allclose(found.places[good], alone.places, rtol=1e-12)


@pytest.mark.slow
def test_matches_of_a_picture_of_a_plate_askew_no_longer_err_alike(monkeypatch):
    camera, rng = preset("fe185"), np.random.default_rng(6)
    plate = scenes.Plate(
        scenes.pose([0.0, 0.05, 0.45], [55.0, 10.0, 0.0]), (0.3, 0.3), scenes.rough_texture(rng), 0.0025
    )
    here, there = scenes.pose([0.0, 0.0, 0.0]), scenes.pose([0.03, 0.12, 0.08], [4.0, -6.0, 10.0])
    pictures = [scenes.picture(camera, [plate], pose, rng) for pose in (here, there)]

    def shared_error() -> np.ndarray:
        match = match_images(camera, *pictures)
        assert match.status == "ok"
        off = match.goal.pixels - scenes.seen_again(camera, [plate], here, there, match.initial.pixels)
        return np.nanmedian(off, axis=0)

    corrected = shared_error()
    module = sys.modules["omniservo.perception.refine_matches"]
    monkeypatch.setattr(module, "without_perspective_bias", lambda found, *rest: found)
    before = shared_error()
    assert np.linalg.norm(before) > 0.03, "nothing to take off"
    assert np.linalg.norm(corrected) < 0.2 * np.linalg.norm(before)
    assert corrected @ before > 0.0, "more is taken off than there was"
