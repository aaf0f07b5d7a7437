"""The law of a motion holds the region of 5 σ, and what a part of the matches would say alone."""

import math

import numpy as np
import pytest
from benchmarks.tempting_scenes import answered, is_sure_and_wrong
from scipy.spatial.transform import Rotation

from omniservo.cameras import preset
from omniservo.estimation import estimate_two_view
from omniservo.estimation.refinement.epipolar_refinement import essential_matrix, sampson_cost
from omniservo.estimation.refinement.motion_search import Minimum
from omniservo.estimation.uncertainty import likelihood_region
from omniservo.estimation.uncertainty.likelihood_region import STRAIGHT, motion_offsets, walk_to_tips
from omniservo.estimation.uncertainty.sure_region import Doubt

SMALL_BASELINE, LATTICE = 1, 3


@pytest.mark.parametrize(("seed", "k"), [(77001, 23), (101, 208), (104, 65), (104, 102)])
def test_a_valley_that_bends_only_beyond_95_percent_is_held(seed, k):
    """The best motion is 7 to 25° off; the truth leaves 13 to 20 σ² more, which 5 σ of five numbers allow."""
    scene, found = answered(SMALL_BASELINE, k, seed)
    assert found.status == "ok"
    assert not is_sure_and_wrong(found, scene.initial_T_goal)


@pytest.mark.parametrize(("seed", "k"), [(77001, 731), (90210, 500), (102, 987)])
def test_an_answer_that_two_motions_would_explain_better_holds_what_the_rest_alone_says(seed, k):
    """Chance brings what two motions explain better with less than 5%, but more than what refuses."""
    scene, found = answered(LATTICE, k, seed)
    assert found.status == "ok"
    assert not is_sure_and_wrong(found, scene.initial_T_goal)


def test_many_exact_points_leave_the_law_as_it_was(make_scene):
    scene = make_scene(np.random.default_rng(3), n=200)
    pixels = scene.noisy(np.random.default_rng(4), 0.02)
    found = estimate_two_view(scene.camera, *pixels, noise=0.02)
    assert len(found.uncertainty.noise) == 5  # ‖t‖ is held: five directions, and none that stretches


@pytest.mark.parametrize(("n", "k"), [(6, 497), (6, 848), (8, 137), (9, 720)])
def test_few_points_of_little_relief_hold_what_is_likely_about_another_minimum(n, k, make_view, fisheye):
    """It was stretched to the other minimum alone: the truth near that one lay beyond 5 σ, by 3° and more."""
    rng = np.random.default_rng([k, n])
    points = np.array([0.0, 0.0, 0.5]) + rng.uniform(-1, 1, (n, 3)) * (0.25, 0.25, 0.05)
    way = rng.normal(size=3)
    turn = Rotation.from_rotvec(rng.uniform(-0.5, 0.5, 3))
    scene = make_view(fisheye, points, turn, 0.3 * way / np.linalg.norm(way))
    found = estimate_two_view(scene.camera, *scene.noisy(rng, 0.5), noise=0.5)
    assert found.status == "ok"
    assert not is_sure_and_wrong(found, scene.initial_T_goal)


def test_the_tips_of_a_region_lie_in_it(make_view, fisheye, monkeypatch):
    """The cost bends away from its model: walked by that alone, tips had up to 400 times the room."""
    excess = []

    def watched(bearings, jacobians, rotation, translation, ways, cost, room, quantile):
        motions = walk_to_tips(bearings, jacobians, rotation, translation, ways, cost, room, quantile)
        for motion in zip(*motions, strict=True):
            essential_matrix(*motion, essential := np.empty((3, 3)))
            excess.append((sampson_cost(bearings, jacobians, math.inf, essential) - cost) / room)
        return motions

    monkeypatch.setattr(likelihood_region, "walk_to_tips", watched)
    for k in range(30):
        rng = np.random.default_rng([6, k])
        points = np.array([0.0, 0.0, 0.5]) + rng.uniform(-1, 1, (6, 3)) * (0.25, 0.25, 0.2)
        turn, way = Rotation.from_rotvec(rng.uniform(-0.5, 0.5, 3)), rng.normal(size=3)
        scene = make_view(fisheye, points, turn, 0.3 * way / np.linalg.norm(way))
        _ = estimate_two_view(scene.camera, *scene.noisy(rng, 0.5), noise=0.5).covariance
    assert len(excess) >= 100
    assert max(excess) < 1.0 + STRAIGHT + 1e-9
    assert np.median(excess) > 0.95


def test_the_tips_of_a_doubt_lie_on_its_ellipsoid():
    rng = np.random.default_rng(5)
    translation = np.array([0.0, 0.6, 0.8])
    across = np.eye(3) - np.outer(translation, translation)
    root = np.zeros((6, 6))
    root[:3], root[3:] = 1e-3 * across @ rng.normal(size=(3, 6)), 1e-3 * rng.normal(size=(3, 6))
    best = Minimum(1.0, np.eye(3), translation, np.empty((0, 3)), True)
    tips = Doubt(best, root @ root.T).tips(16.0)
    assert len(tips) == 11
    assert tips[0] is best
    rotations, translations = (
        np.stack([t.rotation for t in tips[1:]]),
        np.stack([t.translation for t in tips[1:]]),
    )
    offsets = motion_offsets(best.rotation, translation, rotations, translations)
    inverse = np.linalg.pinv(root @ root.T, rcond=1e-9)
    squares = np.einsum("ki,ij,kj->k", offsets, inverse, offsets)
    np.testing.assert_allclose(np.sqrt(squares), 4.0, rtol=0.02)


@pytest.mark.slow
def test_noise_of_half_a_pixel_is_not_doubted_more_often_than_said():
    """Where nothing is stated, one honest answer in twenty takes some of its noise for a common one."""
    camera, wider = preset("perspective"), 0
    points = np.random.default_rng(6).uniform([-0.3, -0.2, 0.4], [0.3, 0.2, 0.8], (40, 3))
    images = [camera.project(points)[0], camera.project(points - [0.15, 0.05, 0.02])[0]]
    for seed in range(60):
        rng = np.random.default_rng([6, seed])
        pixels = [p + 0.5 * rng.normal(size=p.shape) for p in images]
        unstated, stated = (estimate_two_view(camera, *pixels, noise=n) for n in (None, 0.5))
        ratio = np.trace(unstated.covariance[3:, 3:]) / np.trace(stated.covariance[3:, 3:])
        wider += math.sqrt(ratio) > 1.6
    assert wider <= 12


def test_a_far_rival_of_many_points_must_be_a_thousand_times_less_likely():
    """It is 110 times less likely of 58 points, 110° off in direction, and the right one."""
    scene, found = answered(SMALL_BASELINE, 549, 77001)
    assert found.status == "ambiguous"
    direction = scene.initial_T_goal.translation / np.linalg.norm(scene.initial_T_goal.translation)
    assert max(pose.translation @ direction for pose in found.alternatives) > math.cos(math.radians(6.0))
