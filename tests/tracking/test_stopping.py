"""What the tracker refuses, and when it calls itself done."""

from types import SimpleNamespace

import numpy as np
import pytest
from kinematic_loop import FISHEYE, FRONT, WIDE, Loop, bent_path, plan_of, ring
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.errors import Divergence, FeatureLoss, InputError, ServoStop, SingularInteraction
from omniservo.servoing import RestToRestLaw
from omniservo.tracking import PathTracker, TrackerOptions
from omniservo.tracking.stop_criterion import StopCriterion

START = Loop(FISHEYE).look()
GOAL = Loop(FISHEYE, pose=bent_path()(1.0)).look()


def tracker_of(**options):
    return PathTracker(plan_of(), FISHEYE, options=TrackerOptions(**options))


def mask(*rows):
    valid = np.zeros(9, dtype=bool)
    valid[list(rows)] = True
    return valid


def test_four_points_are_enough_and_three_are_feature_loss():
    tracker = tracker_of()
    assert np.isfinite(tracker.step(0.0, START, mask(0, 2, 6, 7))).all()
    with pytest.raises(FeatureLoss, match="3 of 9 points are usable; at least 4"):
        tracker.step(0.01, START, mask(0, 2, 6))
    assert tracker.report.time == 0.0
    with pytest.raises(FeatureLoss, match="at least 6"):
        tracker_of(least_features=6).step(0.0, START, mask(0, 1, 2, 3, 4))


def test_no_point_left_is_feature_loss():
    with pytest.raises(FeatureLoss, match="0 of 9"):
        tracker_of().step(0.0, np.full((9, 2), np.nan), mask())


def test_what_a_lost_row_holds_does_not_matter():
    first, second = START.copy(), START.copy()
    first[3] = np.nan
    second[3] = (1e6, -1e6)
    valid = ~mask(3)
    np.testing.assert_array_equal(tracker_of().step(0.0, first, valid), tracker_of().step(0.0, second, valid))


def test_the_given_arrays_are_left_alone():
    pixels, valid = START.copy(), ~mask(3)
    pixels[5] = (1e4, 1e4)
    tracker_of().step(0.0, pixels, valid)
    np.testing.assert_array_equal(valid, ~mask(3))
    np.testing.assert_array_equal(pixels[[0, 1, 8]], START[[0, 1, 8]])


def test_a_pixel_outside_the_camera_domain_counts_as_lost():
    tracker = tracker_of()
    pixels = START.copy()
    pixels[5] = (1e4, 1e4)
    tracker.step(0.0, pixels)
    assert tracker.report.valid_count == 8
    assert not tracker.report.used[5]


def test_visible_points_on_one_line_are_singular():
    line = np.array([[0.05 * i, 0.01 * i, 0.4] for i in range(-2, 3)])
    plan = plan_of(np.vstack((line, [[0.0, 0.1, 0.3], [0.05, -0.1, 0.35]])))
    pixels = FISHEYE.project(plan.problem.points)[0]
    tracker = PathTracker(plan, FISHEYE)
    tracker.step(0.0, pixels)
    with pytest.raises(SingularInteraction, match="5 features do not determine"):
        tracker.step(0.01, pixels, np.arange(7) < 5)


def test_a_target_on_one_line_is_singular_at_the_first_image():
    line = np.array([[0.05 * i, 0.01 * i, 0.4] for i in range(-2, 3)])
    tracker = PathTracker(plan_of(line), FISHEYE)
    with pytest.raises(SingularInteraction):
        tracker.step(0.0, FISHEYE.project(line)[0])


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_number_that_is_not_finite_in_a_valid_row_is_refused_by_row(bad):
    tracker = tracker_of()
    tracker.step(0.0, START)
    pixels = START.copy()
    pixels[4, 1] = bad
    with pytest.raises(InputError, match="pixels: row 4"):
        tracker.step(0.01, pixels)
    assert tracker.report.time == 0.0
    assert np.isfinite(tracker.step(0.01, pixels, ~mask(4))).all()


def test_time_must_not_run_backwards():
    tracker = tracker_of()
    tracker.step(0.5, Loop(FISHEYE, pose=bent_path()(RestToRestLaw(4.0)(0.5)[0])).look())
    with pytest.raises(InputError, match="must not run backwards"):
        tracker.step(0.49, START)
    with pytest.raises(InputError, match="time"):
        tracker.step(np.nan, START)


def test_the_reference_rests_before_the_start():
    twist = tracker_of().step(-0.02, START)
    np.testing.assert_allclose(twist, 0.0, atol=1e-10)


def test_a_camera_far_from_the_plan_is_divergence():
    aside = Loop(FISHEYE, pose=RigidTransform.from_components([0.1, 0, 0], Rotation.identity())).look()
    with pytest.raises(Divergence, match=r"px \(rms\) from where the plan has them; at most 25 px"):
        tracker_of().step(0.0, aside)
    tracker_of(divergence_px=200.0).step(0.0, aside)


def test_an_image_of_something_else_is_never_followed():
    rng = np.random.default_rng(1)
    for _ in range(50):
        with pytest.raises(ServoStop):
            tracker_of().step(0.0, rng.uniform(60, 380, (9, 2)))


def test_no_image_whatever_gives_a_twist_that_is_not_finite_or_too_fast():
    rng = np.random.default_rng(2)
    gave = 0
    for _ in range(400):
        tracker = tracker_of(divergence_px=1e6, max_linear_speed=0.2, max_angular_speed=0.5)
        pixels = START + rng.choice([0.1, 3.0, 30.0, 1e3]) * rng.standard_normal((9, 2))
        pixels[rng.random(9) < 0.1] = rng.choice([START[0], GOAL[3], [0.0, 0.0]])
        try:
            twist = tracker.step(rng.uniform(0, 5), pixels, rng.random(9) < 0.8)
        except ServoStop:
            continue
        gave += 1
        assert np.isfinite(twist).all()
        assert np.linalg.norm(twist[:3]) <= 0.2 * (1 + 1e-12)
        assert np.linalg.norm(twist[3:]) <= 0.5 * (1 + 1e-12)
    assert gave > 50


def test_speed_limits_keep_the_direction():
    aside = RigidTransform.from_components([0.01, 0.0, 0.01], Rotation.from_rotvec([0, 0.02, 0.03]))
    seen = Loop(FISHEYE, pose=aside).look()
    free = tracker_of(gain=20.0)
    wanted = free.step(0.0, seen)
    assert not free.report.limited
    tracker = tracker_of(gain=20.0, max_linear_speed=0.05, max_angular_speed=0.1)
    limited = tracker.step(0.0, seen)
    assert tracker.report.limited
    factor = np.linalg.norm(limited) / np.linalg.norm(wanted)
    assert factor < 1
    np.testing.assert_allclose(limited, factor * wanted, atol=1e-12)


def test_virtual_plane_features_refuse_a_target_past_90_degrees():
    points = ring([60, 95, 80, 75, 60, 70])
    with pytest.raises(InputError, match=r"point 1 is 9\d\.\d° from the optical axis .*use bearing"):
        PathTracker(
            plan_of(points, bent_path((0.0, 0.0, -0.05), (0.0, 0.0, 0.0), (0, 0, 0))),
            WIDE,
            options=TrackerOptions(feature="virtual-plane"),
        )


def test_a_pixel_past_90_degrees_has_no_virtual_plane_feature_and_counts_as_lost():
    tracker = tracker_of(feature="virtual-plane")
    pixels = START.copy()
    pixels[2] = FISHEYE.project([np.sin(np.radians(91.0)), 0.0, np.cos(np.radians(91.0))])[0]
    tracker.step(0.0, pixels)
    assert tracker.report.valid_count == 8


def test_done_needs_the_end_of_the_time_law():
    tracker = PathTracker(plan_of(), FISHEYE, time_law=RestToRestLaw(1.0),
                          options=TrackerOptions(settled_frames=3, divergence_px=1e3))  # fmt: skip
    for k in range(5):
        tracker.step(0.1 * k, GOAL)
        assert tracker.report.phase == "path"
    for k in range(3):
        assert not tracker.done
        tracker.step(1.0 + 0.1 * k, GOAL)
    assert tracker.done
    assert tracker.report.phase == "done"


def test_the_same_image_does_not_count_twice():
    tracker = PathTracker(plan_of(), FISHEYE, time_law=RestToRestLaw(1.0),
                          options=TrackerOptions(settled_frames=3))  # fmt: skip
    for _ in range(10):
        tracker.step(2.0, GOAL)
    assert not tracker.done


def test_a_frame_off_the_goal_image_starts_the_count_again():
    options = TrackerOptions(settled_frames=3)
    tracker = PathTracker(plan_of(), FISHEYE, time_law=RestToRestLaw(1.0), options=options)
    for time, offset in ((2.0, 0.0), (2.1, 0.0), (2.2, 1.0), (2.3, 0.0), (2.4, 0.0)):
        tracker.step(time, GOAL + offset)
        assert not tracker.done
    tracker.step(2.5, GOAL)
    assert tracker.done


def test_a_pose_off_the_goal_is_not_done_even_where_the_pixels_agree():
    goal = np.array([0.1, 0.2, 0.3, np.sqrt(1 - 0.14), 1.0, 2.0, 3.0])
    options = TrackerOptions(settled_frames=2)
    beside = goal + np.array([0, 0, 0, 0, 1e-3, 0, 0])
    turned = np.concatenate(
        ((Rotation.from_quat(goal[:4]) * Rotation.from_rotvec([0, 5e-3, 0])).as_quat(), goal[4:])
    )
    for pose, done in ((goal, True), (beside, False), (turned, False)):
        for sign in (1.0, -1.0):
            stop = StopCriterion(goal, options)
            same = np.concatenate((sign * pose[:4], pose[4:]))
            stop.holds(0.0, 0.0, same)
            assert stop.holds(1.0, 0.0, same) is done


def test_an_error_that_is_no_number_is_not_near():
    goal = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    stop = StopCriterion(goal, TrackerOptions(settled_frames=1))
    assert not stop.holds(0.0, np.nan, goal)
    assert stop.holds(1.0, 0.0, goal)


def test_noise_around_the_goal_pose_averages_out():
    goal = np.array([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
    stop = StopCriterion(goal, TrackerOptions(settled_frames=4))
    results = [stop.holds(k, 0.0, goal + np.array([0, 0, 0, 0, (-1) ** k * 2e-3, 0, 0])) for k in range(4)]
    assert results == [False, False, False, True]


@pytest.mark.parametrize(
    ("pixels", "valid", "message"),
    [
        (START[:5], None, r"pixels: shape \(5, 2\) given; \(9, 2\)"),
        (START, np.ones(9), "valid: float64"),
        (START, np.ones(5, dtype=bool), r"valid: bool \(5,\)"),
    ],
)
def test_wrong_shapes_are_named(pixels, valid, message):
    with pytest.raises(InputError, match=message):
        tracker_of().step(0.0, pixels, valid)


def test_a_plan_without_a_path_is_refused():
    plan = SimpleNamespace(path=None, status="infeasible", problem=SimpleNamespace(points=FRONT))
    with pytest.raises(InputError, match="plan: status 'infeasible' without a path"):
        PathTracker(plan, FISHEYE)


def test_a_target_of_three_points_is_refused():
    with pytest.raises(InputError, match="plan: 3 points; at least 4"):
        PathTracker(plan_of(FRONT[:3]), FISHEYE)


@pytest.mark.parametrize(
    ("goal_pixels", "message"),
    [
        (GOAL[:4], r"goal_pixels: shape \(4, 2\)"),
        (np.where(np.arange(18).reshape(9, 2) == 7, np.nan, GOAL), r"goal_pixels: nan at index \(3, 1\)"),
        (np.where(np.arange(18).reshape(9, 2) == 6, 1e5, GOAL), "goal_pixels: row 3"),
    ],
)
def test_wrong_goal_pixels_are_named(goal_pixels, message):
    with pytest.raises(InputError, match=message):
        PathTracker(plan_of(), FISHEYE, goal_pixels=goal_pixels)


@pytest.mark.parametrize(
    "options",
    [
        {"feature": "corner"},
        {"gain": 0.0},
        {"gain": np.nan},
        {"delay": -0.1},
        {"least_features": 3},
        {"least_features": 4.5},
        {"settled_frames": 0},
        {"divergence_px": np.inf},
        {"tolerance_px": 0.0},
        {"max_angular_speed": -1.0},
    ],
)
def test_wrong_options_are_named(options):
    with pytest.raises(InputError, match=next(iter(options))):
        TrackerOptions(**options)


def test_a_reference_outside_the_camera_domain_is_left_out_of_the_error():
    points = np.vstack((FRONT, [[0.5 * np.sin(np.radians(92.4)), 0.0, 0.5 * np.cos(np.radians(92.4))]]))
    path = bent_path((0.0, 0.0, 0.02), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    path.rotation[:3, 0] = 0.0
    path.rotation[:, 1] = 0.0
    seen, _ = FISHEYE.project(points)
    goal = FISHEYE.project(points - [0.0, 0.0, 1e-4])[0]
    with pytest.raises(InputError, match="goal_pixels: missing, and the plan's end does not see point 9"):
        PathTracker(plan_of(points, path), FISHEYE)
    tracker = PathTracker(plan_of(points, path), FISHEYE, goal_pixels=goal)
    tracker.step(1.2, seen)
    assert np.isnan(tracker.report.reference_pixels[9]).all()
    assert np.isfinite(tracker.report.reference_pixels[:9]).all()
    assert 0.0 < tracker.report.error_px < 25.0


def test_the_same_image_again_makes_no_pose_surer():
    tracker, noisy = tracker_of(), START + 0.3 * np.random.default_rng(0).standard_normal(START.shape)
    found = []
    for _ in range(3):
        tracker.step(0.0, noisy)
        found.append((tracker.report.filtered_pose, tracker.report.filtered_covariance))
    for pose, covariance in found[1:]:
        np.testing.assert_array_equal(pose, found[0][0])
        np.testing.assert_array_equal(covariance, found[0][1])
    tracker.step(1e-3, noisy)
    assert np.trace(tracker.report.filtered_covariance) < np.trace(found[0][1])


def test_what_is_written_to_a_report_changes_nothing_of_the_tracker():
    tracker = tracker_of()
    tracker.step(0.0, START)
    expected = tracker.predict(0.01)[0]
    tracker.report.filtered_pose[4:] += 0.1
    tracker.report.filtered_covariance[:] = 0.0
    np.testing.assert_array_equal(tracker.predict(0.01)[0], expected)


def test_masked_pixels_are_refused_and_not_taken_for_seen():
    masked = np.ma.array(START, mask=np.zeros_like(START, dtype=bool))
    tracker_of().step(0.0, masked)
    masked[2] = np.ma.masked
    with pytest.raises(InputError, match="pixels: 2 masked entries given; mark a lost point in valid"):
        tracker_of().step(0.0, masked)


@pytest.mark.parametrize("axis", np.vstack([np.eye(6), np.ones(6)]), ids=[*"xyz", *"abc", "all"])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_it_is_near_up_to_the_stated_length_and_angle_about_any_axis(axis, sign):
    goal = RigidTransform.from_components([0.1, -0.2, 0.3], Rotation.from_rotvec([0.5, -1.2, 2.0]))
    options = TrackerOptions(settled_frames=1, tolerance_m=2e-3, tolerance_rad=5e-3)
    away, turned = (part / max(np.linalg.norm(part), 1.0) for part in (axis[:3], axis[3:]))

    def row(share):
        pose = RigidTransform.from_components(
            goal.translation + share * 2e-3 * away,
            goal.rotation * Rotation.from_rotvec(share * 5e-3 * turned),
        )
        return np.concatenate((sign * pose.rotation.as_quat(), pose.translation))

    stop = StopCriterion(np.concatenate((goal.rotation.as_quat(), goal.translation)), options)
    assert [stop.holds(time, 0.0, row(share)) for time, share in enumerate((0.0, 0.98, 1.02))] == [
        True,
        True,
        False,
    ]
