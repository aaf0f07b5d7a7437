from dataclasses import fields

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from tests.tracking.kinematic_loop import HYPERBOLIC, PARABOLIC, PERSPECTIVE, WIDE

from omniservo.cameras import preset
from omniservo.errors import Divergence, FeatureLoss, InputError, NotFinite
from omniservo.servoing import SERVO_METHODS, servo_method
from omniservo.tracking import GoalServo, GoalServoOptions
from omniservo.tracking.goal_servo import SETTLED_FRAMES

CAMERA = preset("fe185")
POINTS = np.array(
    [[x, y, 0.4 - 0.3 * abs(x)] for x in (-0.08, 0.0, 0.09) for y in (-0.07, 0.01, 0.06)], dtype=np.float64
)
GOAL = RigidTransform.from_components([0.03, -0.05, 0.1], Rotation.from_rotvec([0.1, -0.2, 0.15]))
EVERYTHING = np.ones(len(POINTS), dtype=np.bool_)
EXACTLY = GoalServoOptions(tolerance_px=1e-3)


def seen_from(initial_T_camera, camera=CAMERA, points=POINTS):
    pixels, valid = camera.project(initial_T_camera.inv().apply(points))
    assert valid.all()
    return pixels


def servo(name="ibvs", camera=CAMERA, points=POINTS, **kwargs):
    return GoalServo(
        camera, points, seen_from(GOAL, camera, points), method=servo_method(name, 2.0),
        initial_T_goal=RigidTransform.identity(), **{"options": EXACTLY} | kwargs,
    )  # fmt: skip


def led(controller, camera=CAMERA, points=POINTS, period=0.02):
    """Where the camera is led from the initial image: its pose at the end."""
    pose = RigidTransform.identity()
    for k in range(2000):
        expected, ok = controller.predict(k * period)
        assert ok.all()
        if k:
            assert np.abs(expected - seen_from(pose, camera, points)).max() < 1e-6
        twist = controller.step(k * period, seen_from(pose, camera, points), EVERYTHING)
        turn = Rotation.from_rotvec(twist[3:] * period)
        pose = pose * RigidTransform.from_components(twist[:3] * period, turn)
        if controller.done:
            break
    return pose


def test_the_camera_arrives_where_the_goal_image_was_taken():
    controller = servo()
    gap = GOAL.inv() * led(controller)
    assert controller.done
    assert np.linalg.norm(gap.translation) < 1e-5
    assert gap.rotation.magnitude() < 1e-5
    assert np.isnan(controller.report.w)
    with pytest.warns(DeprecationWarning, match="GoalServoReport.matrix is called pose_matrix now"):
        assert controller.report.matrix is controller.report.pose_matrix


@pytest.mark.parametrize("name", SERVO_METHODS)
@pytest.mark.parametrize("camera", [PERSPECTIVE, PARABOLIC, HYPERBOLIC, WIDE], ids=lambda c: f"xi={c.xi}")
def test_every_method_arrives_with_every_central_camera(name, camera):
    controller = servo(name, camera)
    gap = GOAL.inv() * led(controller, camera, period=0.1)
    assert controller.done
    assert np.linalg.norm(gap.translation) < 2e-5
    assert gap.rotation.magnitude() < 5e-5


@pytest.mark.parametrize("name", ["bearing", "spherical", "pbvs", "pbvs-target"])
def test_what_needs_no_image_plane_arrives_with_the_target_all_round_past_90_degrees(name):
    around = np.linspace(0.0, 2.0 * np.pi, 9, endpoint=False)
    rising = np.radians([95.0, 105.0, 98.0, 110.0, 100.0, 96.0, 108.0, 101.0, 112.0])
    ring = np.column_stack((np.sin(rising) * np.cos(around), np.sin(rising) * np.sin(around), np.cos(rising)))
    points = ring * np.linspace(0.6, 0.9, 9)[:, None]
    assert (GOAL.inv().apply(points)[:, 2] < 0.0).sum() >= 7
    controller = servo(name, WIDE, points)
    gap = GOAL.inv() * led(controller, WIDE, points, period=0.1)
    assert np.linalg.norm(gap.translation) < 1e-4
    assert gap.rotation.magnitude() < 1e-4
    with pytest.raises(FeatureLoss, match="in front of the image plane"):
        servo("ibvs", WIDE, points).step(0.0, seen_from(RigidTransform.identity(), WIDE, points), EVERYTHING)


STANDING = np.zeros(6)


class Noted:
    """Keeps what a method is given."""

    def __init__(self, twist=STANDING):
        self.twist, self.given = twist, []

    def step(self, seen):
        self.given.append(seen)
        return self.twist


def test_what_a_method_is_given_is_what_the_images_say_of_the_points_in_both():
    method, now = (
        Noted(),
        RigidTransform.from_components([0.01, 0.02, 0.03], Rotation.from_rotvec([0.1, 0, 0])),
    )
    controller = GoalServo(CAMERA, POINTS, seen_from(GOAL), method=method, initial_T_goal=GOAL)
    valid = EVERYTHING.copy()
    valid[[2, 5]] = False
    pixels = seen_from(now)
    pixels[~valid] = np.nan
    controller.step(0.5, pixels, valid)
    (seen,) = method.given
    assert seen.time == 0.5
    np.testing.assert_allclose(seen.points, now.inv().apply(POINTS)[valid], atol=1e-8)
    np.testing.assert_allclose(seen.goal_points, GOAL.inv().apply(POINTS)[valid], atol=1e-8)
    for poses in (
        (seen.goal_T_camera, GOAL.inv() * now),
        (controller.goal.goal_T_camera, RigidTransform.identity()),
    ):
        np.testing.assert_allclose(poses[0].as_matrix(), poses[1].as_matrix(), atol=1e-8)
    np.testing.assert_allclose(controller.goal.points, GOAL.inv().apply(POINTS), atol=1e-8)
    assert {field.name for field in fields(seen)} == {
        "time", "bearings", "distances", "goal_bearings", "goal_distances", "pose_matrix"
    }  # fmt: skip


def test_the_twist_is_scaled_as_a_whole_to_the_speed_limits_and_said():
    method = Noted(np.array([3.0, 4.0, 0.0, 0.1, 0.0, 0.0]))
    controller = GoalServo(CAMERA, POINTS, seen_from(GOAL), method=method, initial_T_goal=GOAL)
    twist = controller.step(0.0, seen_from(GOAL), EVERYTHING)
    np.testing.assert_allclose(twist, [0.6, 0.8, 0.0, 0.02, 0.0, 0.0])
    assert controller.report.limited


@pytest.mark.parametrize(
    "twist",
    [
        np.full(6, np.nan), np.zeros(5), np.full(6, np.inf), None, "slowly", [1.0, [2.0]], {}, [1j] * 6,
        np.ma.array(np.ones(6), mask=[1, 0, 0, 0, 0, 0]),
    ],
)  # fmt: skip
def test_a_method_that_gives_no_six_finite_numbers_is_a_named_stop(twist):
    controller = GoalServo(CAMERA, POINTS, seen_from(GOAL), method=Noted(twist), initial_T_goal=GOAL)
    with pytest.raises(NotFinite, match="Noted gives the twist"):
        controller.step(0.0, seen_from(GOAL), EVERYTHING)


def test_three_points_are_a_feature_loss():
    valid = np.arange(len(POINTS)) < 3
    with pytest.raises(FeatureLoss, match="3 points"):
        servo().step(0.0, seen_from(RigidTransform.identity()), valid)


def test_an_image_that_no_pose_explains_is_a_divergence_or_stays_finite():
    pixels = np.full((len(POINTS), 2), [300.0, 200.0])
    with pytest.raises(Divergence):
        servo().step(0.0, pixels, EVERYTHING)


@pytest.mark.parametrize(
    ("points", "pixels", "options", "message"),
    [
        (POINTS, np.zeros((3, 2)), {}, r"goal_pixels: shape \(3, 2\)"),
        (POINTS, np.full((9, 2), np.nan), {}, "goal_pixels: nan"),
        (POINTS, np.full((9, 2), 1e6), {}, "goal_pixels: row 0, .* outside the camera's domain"),
        (POINTS[:, :2], np.zeros((9, 2)), {}, "points: shape"),
        (POINTS, np.zeros((9, 2)), {"tolerance_px": 0.0}, "tolerance_px"),
        (POINTS, np.zeros((9, 2)), {"max_linear_speed": np.nan}, "max_linear_speed"),
    ],
)
def test_a_wrong_call_is_named(points, pixels, options, message):
    with pytest.raises(InputError, match=message):
        GoalServo(CAMERA, points, pixels, options=GoalServoOptions(**options))


def test_what_is_written_to_twist_and_report_changes_nothing_of_the_servo():
    controller, start = servo(), seen_from(RigidTransform.identity())
    twist = controller.step(0.0, start, EVERYTHING)
    expected, error = controller.predict(0.1)[0], controller.report.goal_error_px
    twist *= 0.0
    controller.report.pose_matrix[:3, 3] += 1.0
    controller.report.reference_pixels[:] = 0.0
    np.testing.assert_array_equal(controller.predict(0.1)[0], expected)
    controller.step(0.1, start, EVERYTHING)
    assert controller.report.goal_error_px == pytest.approx(error)


def test_the_same_image_does_not_count_twice():
    controller = servo(options=GoalServoOptions(tolerance_px=1e3))
    start = seen_from(RigidTransform.identity())
    for _ in range(SETTLED_FRAMES):
        controller.step(0.0, start, EVERYTHING)
    assert not controller.done
    for k in range(1, SETTLED_FRAMES):
        controller.step(0.02 * k, start, EVERYTHING)
    assert controller.done


def test_a_time_that_is_no_number_is_refused():
    with pytest.raises(InputError, match="time: nan given"):
        servo().step(np.nan, seen_from(RigidTransform.identity()), EVERYTHING)
