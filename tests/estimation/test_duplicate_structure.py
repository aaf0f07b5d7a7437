"""A structure that repeats, matched to what only looks like it: five matches of the background tell."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.tempting_scenes import CAMERAS, Scene, ahead, answered, cloud, estimate, lattice, motion
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import preset
from omniservo.estimation import estimate_two_view
from omniservo.estimation.matches import Matches
from omniservo.estimation.robust.two_view_fit import fit_two_views
from omniservo.estimation.status.duplicate_structure import duplicate_structure

LATTICES, BODIES = 4, 5
"""indices of lattices matched one period off as a whole, and of symmetric bodies, in `KINDS`"""


def pixels_of(camera, scene, noise, rng):
    """Noisy pixels of a scene in both views, (n, 4)."""
    views = [scene.before, scene.initial_T_goal.inv().apply(scene.after)]
    return np.hstack([camera.project(p)[0] + noise * rng.normal(size=(len(p), 2)) for p in views])


def turned_body(rng, background, part=7, fold=2):
    """A body of ``fold``-fold symmetry matched to its turned self, and points of the background."""
    seed = rng.uniform([0.02, -0.12, -0.1], [0.12, 0.12, 0.1], (part, 3))
    turns = [Rotation.from_rotvec([0.0, 0.0, 2.0 * np.pi * k / fold]) for k in range(fold)]
    body, turned = (np.concatenate([turns[(k + s) % fold].apply(seed) for k in range(fold)]) for s in (0, 1))
    pose, around = Rotation.from_rotvec([0.2, -0.3, 0.1]), cloud(rng, background)
    one, other = (pose.apply(p) + ahead(0.55) for p in (body, turned))
    return Scene(np.concatenate((one, around)), np.concatenate((other, around)), motion(rng), background)


def fitted(scene, rng, noise=0.05):
    """Matches of a scene and the fit to its body alone."""
    matches = Matches.of_pixels(preset("fe185"), pixels_of(preset("fe185"), scene, noise, rng))
    body = np.arange(matches.size) < matches.size - scene.right
    inside = fit_two_views(matches.where(body), 0, False)
    return matches, replace(inside, members=body)


@pytest.mark.parametrize("seed", range(6))
def test_five_right_matches_of_the_background_give_the_motion_under_which_the_body_is_turned(seed):
    rng = np.random.default_rng(seed)
    scene = turned_body(rng, 5)
    matches, fit = fitted(scene, rng)
    found = duplicate_structure(matches, fit)
    assert found is not None
    assert found.checked == 14
    assert found.doubles >= 12
    truth = scene.initial_T_goal
    direction = truth.translation / np.linalg.norm(truth.translation)
    assert np.degrees(np.arccos(found.motion.translation @ direction)) < 15.0
    turn = np.linalg.norm(
        Rotation.from_matrix(truth.rotation.as_matrix().T @ found.motion.rotation).as_rotvec()
    )
    assert np.degrees(turn) < 5.0


def test_four_matches_left_out_tell_nothing():
    rng = np.random.default_rng(0)
    assert duplicate_structure(*fitted(turned_body(rng, 4), rng)) is None


def seen_by(body, moved, around, scene_motion, background_motion):
    """A body, matched to ``moved``, as one motion shows it, and a background as another does."""
    shown = scene_motion.apply(background_motion.inv().apply(around))
    return Scene(np.concatenate((body, around)), np.concatenate((moved, shown)), scene_motion, len(around))


@pytest.mark.parametrize("count", [8, 14])
def test_a_body_without_symmetry_is_not_taken_onto_itself(count):
    for seed in range(30):
        rng = np.random.default_rng([count, seed])
        body, around = rng.uniform(-0.1, 0.1, (count, 3)) + ahead(0.55), cloud(rng, 9)
        assert (
            duplicate_structure(*fitted(seen_by(body, body, around, motion(rng), motion(rng)), rng)) is None
        )


def test_few_points_are_where_others_are_by_chance():
    for seed in range(40):
        rng = np.random.default_rng([8, seed])
        x, y = (a.ravel() for a in np.meshgrid(np.arange(4.0), np.arange(2.0)))
        places = np.column_stack([0.06 * x - 0.09, 0.06 * y - 0.03, rng.uniform(0.4, 0.7, 8)])
        places[:, :2] *= places[:, 2:] / 0.5
        scene = seen_by(places, places, cloud(rng, 9), motion(rng, 0.05, 0.1), motion(rng))
        assert duplicate_structure(*fitted(scene, rng)) is None


def test_points_of_the_same_motion_that_were_left_out_are_no_other_motion():
    for seed in range(6):
        rng = np.random.default_rng(seed)
        body, same = rng.uniform(-0.1, 0.1, (14, 3)) + ahead(0.55), motion(rng)
        assert duplicate_structure(*fitted(seen_by(body, body, cloud(rng, 6), same, same), rng)) is None


def test_a_symmetric_part_of_less_than_half_is_no_doubt():
    for seed in range(6):
        rng = np.random.default_rng(seed)
        scene = turned_body(rng, 6, part=6)
        rest = rng.uniform([-0.25, -0.2, 0.4], [-0.15, 0.2, 0.8], (16, 3))
        pose = Rotation.from_rotvec([0.2, -0.3, 0.1])
        half_a_turn = pose * Rotation.from_rotvec([0.0, 0.0, np.pi]) * pose.inv()
        turned = half_a_turn.apply(rest - ahead(0.55)) + ahead(0.55)
        both = Scene(np.r_[rest, scene.before], np.r_[turned, scene.after], scene.initial_T_goal, 6)
        assert duplicate_structure(*fitted(both, rng)) is None


def test_the_background_says_in_which_direction_the_camera_went():
    for seed in range(6):
        rng = np.random.default_rng(seed)
        scene = turned_body(rng, 6)
        truth = scene.initial_T_goal
        back = RigidTransform.from_components(-truth.translation, truth.rotation)
        body, around = slice(0, 14), scene.before[14:]
        scene = seen_by(scene.before[body], scene.after[body], around, truth, back)
        assert duplicate_structure(*fitted(scene, rng)) is None


def test_a_body_that_shrinks_to_one_place_is_not_taken_onto_itself():
    for seed in range(6):
        rng = np.random.default_rng(seed)
        body, scene_motion = rng.uniform(-0.1, 0.1, (14, 3)) + ahead(0.55), motion(rng)
        towards = scene_motion.inv().apply(body[0])
        away = RigidTransform.from_translation(-0.2 * towards / np.linalg.norm(towards))
        scene = seen_by(body, body, cloud(rng, 6), scene_motion, away)
        assert duplicate_structure(*fitted(scene, rng, 0.01)) is None


@pytest.mark.slow
def test_symmetric_bodies_matched_to_their_turned_selves_are_hardly_ever_answered():
    scenes = [answered(BODIES, k, 4711) for k in range(40)]
    tempting = [found.status for scene, found in scenes if scene.right >= 5]
    assert len(tempting) >= 25
    assert tempting.count("ok") <= 0.1 * len(tempting)


@pytest.mark.parametrize("k", [47, 72, 188])
def test_a_motion_that_bends_to_a_lattice_and_its_background_is_seen_by_the_lattice_alone(k):
    _, found = answered(LATTICES, k, 779)
    assert found.status == "ambiguous"
    assert "a structure that repeats" in found.message


def test_a_lattice_that_is_matched_rightly_is_answered_beside_a_few_wrong_matches():
    statuses = []
    for k in range(12):
        rng = np.random.default_rng([11, k])
        scene = lattice(rng, 0.0, 1e-9)
        after = scene.after.copy()
        after[-5:] = after[-5:][[1, 2, 3, 4, 0]]
        found = estimate(
            Scene(scene.before, after, scene.initial_T_goal, 0), preset(CAMERAS[k % 3]), 0.3, rng
        )
        if found is not None:
            statuses.append((found.status, found.message))
    assert len(statuses) >= 8
    assert not [message for status, message in statuses if "repeats" in message]
    assert sum(status == "ok" for status, _ in statuses) > 0.5 * len(statuses)


def test_both_motions_are_given_and_said():
    rng = np.random.default_rng(3)
    pixels = pixels_of(preset("fe185"), turned_body(rng, 5, part=10), 0.05, rng)
    found = estimate_two_view(preset("fe185"), pixels[:, :2], pixels[:, 2:], noise=0.05)
    assert found.status == "ambiguous"
    assert "with which five of 5 outliers agree, 18 of 20 inliers are seen where others are" in found.message
    assert len(found.alternatives) == 2
