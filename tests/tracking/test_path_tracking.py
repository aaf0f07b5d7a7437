"""The tracker in closed loop with a camera that moves exactly as told."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.lens_conversions import PUBLISHED
from kinematic_loop import (
    FISHEYE,
    FRONT,
    HYPERBOLIC,
    PARABOLIC,
    PERSPECTIVE,
    WIDE,
    Loop,
    Path,
    bent_path,
    plan_of,
    ring,
)
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.servoing import BearingFeatures, ExponentialLaw, RestToRestLaw
from omniservo.tracking import PathTracker, TrackerOptions
from omniservo.tracking.path_state import path_state

PAST_90 = ring([60, 95, 110, 75, 100, 115, 85, 70, 105])
SHORT = bent_path(translation=(0.05, -0.08, 0.06), bend=(0.02, 0.03, 0.02))

TINY = bent_path((0.03, -0.02, 0.05), (0.02, -0.05, 0.1), (0.01, 0.01, 0.01))

EXACT = TrackerOptions(delay=0.005, tolerance_px=1e-7)
"""The twist acts for 10 ms from the exposure on: 5 ms on average."""

SCENES = {
    "perspective": (PERSPECTIVE, FRONT, bent_path((5e-5, -0.1, 0.1))),
    "fisheye": (FISHEYE, FRONT, bent_path()),
    "fisheye past 90 degrees": (WIDE, PAST_90, SHORT),
    "parabolic mirror": (PARABOLIC, ring([60, 95, 80, 75, 100, 105, 85, 70, 95]), SHORT),
    "Kannala-Brandt": (PUBLISHED["RealSense T265, fisheye"], FRONT, bent_path()),
    "OCam past 90 degrees": (PUBLISHED["Kodak, OCam, 235°"], PAST_90, SHORT),
    "five coefficients": (PUBLISHED["RealSense, colour"], 0.4 * FRONT + np.array([0.0, 0.02, 0.4]), TINY),
    "hyperbolic mirror": (HYPERBOLIC, ring([60, 95, 80, 75, 100, 105, 85, 70, 95]), SHORT),
}


@pytest.mark.parametrize("scene", SCENES)
def test_follows_the_path_and_ends_on_the_goal_image(scene):
    camera, points, path = SCENES[scene]
    loop = Loop(camera, points)
    tracker = PathTracker(plan_of(points, path), camera, options=EXACT)
    loop.run(tracker, path, 8.0)
    assert tracker.done
    assert tracker.report.goal_error_px < 1e-6
    assert max(loop.deviations) < 2e-5
    goal = path(1.0)
    assert np.linalg.norm(loop.pose.translation - goal.translation) < 1e-6
    assert (loop.pose.rotation.inv() * goal.rotation).magnitude() < 1e-6


@pytest.mark.parametrize("scene", ["perspective", "fisheye"])
def test_virtual_plane_features_do_the_same_in_front_of_the_camera(scene):
    camera, points, path = SCENES[scene]
    loop = Loop(camera, points)
    tracker = PathTracker(plan_of(points, path), camera, options=replace(EXACT, feature="virtual-plane"))
    loop.run(tracker, path, 8.0)
    assert tracker.done
    assert tracker.report.goal_error_px < 1e-6
    assert max(loop.deviations) < 2e-5


@pytest.mark.parametrize("feature", ["bearing", "virtual-plane"])
@pytest.mark.parametrize("delay", [0.0, 0.05])
def test_on_the_path_the_twist_is_the_planned_twist(feature, delay):
    path = bent_path()
    law = RestToRestLaw(4.0)
    for time in np.linspace(0.1, 3.9, 12):
        tracker = PathTracker(
            plan_of(), FISHEYE, time_law=law, options=TrackerOptions(feature=feature, delay=delay)
        )
        seen = Loop(FISHEYE, pose=path(law(time)[0])).look()
        w, w_dot = law(time + delay)
        planned = np.empty(6)
        path_state(np.ascontiguousarray(path.rotation), path.translation.copy(), w, np.empty(7), planned)
        np.testing.assert_allclose(tracker.step(time, seen), w_dot * planned, atol=1e-12)


def test_feed_forward_is_the_derivative_of_the_reference():
    path, feature = bent_path(), BearingFeatures()
    for w in np.linspace(0.01, 0.99, 9):
        step = 1e-6
        after = feature.value(path(w + step).inv().apply(FRONT))[0]
        before = feature.value(path(w - step).inv().apply(FRONT))[0]
        interaction, _ = feature.interaction(path(w).inv().apply(FRONT))
        np.testing.assert_allclose(interaction @ path.twist(w), (after - before) / (2 * step), atol=1e-8)


def test_the_stated_delay_is_compensated():
    path = bent_path()
    deviations = {}
    for stated in (0.0, 0.055):
        loop = Loop(FISHEYE, delay=5)
        tracker = PathTracker(plan_of(), FISHEYE, options=TrackerOptions(delay=stated))
        loop.run(tracker, path, 8.0)
        assert tracker.done
        deviations[stated] = max(loop.deviations)
    assert deviations[0.0] > 1e-3
    assert deviations[0.055] < 0.05 * deviations[0.0]


def test_pixel_noise_moves_the_camera_by_millimetres():
    path = bent_path()
    loop = Loop(FISHEYE, noise=0.5)
    tracker = PathTracker(plan_of(), FISHEYE, options=TrackerOptions(tolerance_px=0.8, tolerance_m=0.02))
    loop.run(tracker, path, 8.0)
    assert max(loop.deviations) < 6e-3
    assert max(loop.errors) < 2.0


@pytest.mark.parametrize("scale", [1.1, 0.8])
def test_a_wrong_scale_costs_millimetres_on_the_way_and_nothing_at_the_end(scale):
    """All distances 10% too long or 20% too short: the plan in its own, wrong metres, under 0.5 px noise."""
    path = bent_path()
    believed = Path(path.rotation, scale * path.translation)
    loop = Loop(FISHEYE, noise=0.5)
    options = TrackerOptions(tolerance_px=1e-9)
    tracker = PathTracker(plan_of(scale * FRONT, believed), FISHEYE, options=options)
    loop.run(tracker, path, 4.0)
    assert 2e-3 < max(loop.deviations) < 12e-3
    loop.noise = 0.0
    loop.run(tracker, path, 10.0, start=4.0)
    assert loop.errors[-1] < 1e-6
    assert loop.deviations[-1] < 1e-7


@pytest.mark.slow
def test_a_badly_wrong_structure_still_ends_on_the_goal_image():
    """Every other point 10% too far, the rest 20% too near: 13 px that no pose explains."""
    path = bent_path()
    structure = FRONT * np.where(np.arange(9) % 2, 1.1, 0.8)[:, None]
    goal_pixels = Loop(FISHEYE, pose=path(1.0)).look()
    loop = Loop(FISHEYE)
    options = TrackerOptions(tolerance_px=1e-9)
    tracker = PathTracker(plan_of(structure), FISHEYE, goal_pixels=goal_pixels, options=options)
    loop.run(tracker, path, 20.0)
    assert tracker.report.goal_error_px < 1e-4
    assert np.linalg.norm(loop.pose.translation - path(1.0).translation) < 1e-6


def test_a_slightly_wrong_estimate_tracks_closely_and_ends_exactly():
    rng = np.random.default_rng(3)
    path = bent_path()
    structure = FRONT * (1.0 + 0.01 * rng.standard_normal((9, 1)))
    goal_pixels = Loop(FISHEYE, pose=path(1.0)).look()
    loop = Loop(FISHEYE)
    tracker = PathTracker(plan_of(structure), FISHEYE, goal_pixels=goal_pixels)
    loop.run(tracker, path, 10.0)
    assert tracker.done
    assert max(loop.deviations) < 0.01
    assert np.linalg.norm(loop.pose.translation - path(1.0).translation) < 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("feature", ["bearing", "virtual-plane"])
def test_the_twist_has_no_jump_where_the_goal_image_takes_over(feature):
    path = bent_path()
    shifted = Loop(FISHEYE, pose=path(1.0)).look() + 2.0 * np.random.default_rng(4).standard_normal((9, 2))
    tracker = PathTracker(plan_of(), FISHEYE, goal_pixels=shifted, options=TrackerOptions(feature=feature))
    loop = Loop(FISHEYE, period=0.002)
    loop.run(tracker, path, 5.0)
    jumps = np.abs(np.diff(loop.twists, axis=0)).max(axis=1)
    # A planned acceleration of 0.12 m/s² and 0.2 rad/s² is 0.4e-3 a period; a jump would stand out.
    assert jumps.max() < 1e-3


def test_exponential_law_ends_too():
    path = bent_path()
    loop = Loop(FISHEYE)
    tracker = PathTracker(plan_of(), FISHEYE, time_law=ExponentialLaw(1.0))
    loop.run(tracker, path, 15.0)
    assert tracker.done
    assert tracker.report.goal_error_px < 0.1
    assert max(loop.deviations) < 2e-3


def test_a_start_beside_the_path_is_led_back_to_it():
    path = bent_path()
    aside = RigidTransform.from_components([0.01, -0.01, 0.005], Rotation.from_rotvec([0.02, 0.03, -0.05]))
    loop = Loop(FISHEYE, pose=aside)
    tracker = PathTracker(plan_of(), FISHEYE)
    loop.run(tracker, path, 10.0)
    assert tracker.done
    assert loop.deviations[300] < 1e-4


def test_points_come_and_go_without_harm():
    path = bent_path()
    rng = np.random.default_rng(5)

    def lost(step):
        valid = np.zeros(9, dtype=bool)
        valid[rng.permutation(9)[: rng.integers(5, 10)]] = True
        return valid

    loop = Loop(FISHEYE, noise=0.02)
    tracker = PathTracker(plan_of(), FISHEYE)
    loop.run(tracker, path, 8.0, lost)
    assert tracker.done
    assert max(loop.deviations) < 2e-3


def test_prediction_meets_the_next_image():
    path = bent_path()
    loop = Loop(FISHEYE)
    tracker = PathTracker(plan_of(), FISHEYE)
    first, valid = tracker.predict(0.0)
    assert valid.all()
    np.testing.assert_allclose(first, loop.look(), atol=1e-9)
    gaps = []
    for k in range(300):
        expected, valid = tracker.predict(0.01 * k)
        seen = loop.look()
        assert valid.all()
        gaps.append(np.abs(expected - seen).max())
        twist = tracker.step(0.01 * k, seen)
        loop.pose = loop.pose * RigidTransform.from_exp_coords(np.concatenate((twist[3:], twist[:3])) * 0.01)
    assert max(gaps) < 0.05
    assert tracker.predict(3.0)[0].shape == (9, 2)
    assert path(0.0).translation.any() == np.False_


def test_pose_in_the_report_is_the_camera_pose():
    path = bent_path()
    tracker = PathTracker(plan_of(), FISHEYE)
    pose = path(0.3) * RigidTransform.from_translation([0.002, 0.0, -0.001])
    tracker.step(1.7, Loop(FISHEYE, pose=pose).look())
    seen = tracker.report.initial_T_camera
    np.testing.assert_allclose(seen.as_matrix(), pose.as_matrix(), atol=1e-9)
    assert tracker.report.pose_rms_px < 1e-9
    assert tracker.report.valid_count == 9
