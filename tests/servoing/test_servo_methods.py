"""Every servo method: its interaction matrix by finite differences, its way to the goal, what it refuses."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.errors import FeatureLoss, InputError, SingularInteraction
from omniservo.run_methods import METHODS
from omniservo.servoing import (
    SERVO_METHODS,
    AdaptiveGain,
    HybridServoOptions,
    ImageServo,
    ImageServoOptions,
    PoseServo,
    PoseServoOptions,
    ServoMeasurement,
    SphericalServoOptions,
    SwitchedServo,
    SwitchedServoOptions,
    servo_method,
)
from omniservo.servoing.rotation_vector import rotation_vector
from omniservo.servoing.spherical_servo import MOST_TRIANGLES, _triangles

TARGET = np.array(
    [[0.1 * i, 0.08 * k, 0.6 - 0.15 * abs(i) + 0.05 * i * k] for k in (-1, 0, 1) for i in (-1, 0, 1)]
)
ASIDE = RigidTransform.from_components([0.05, -0.02, -0.1], Rotation.from_rotvec([0.1, 0.2, 0.3]))
HOME = RigidTransform.identity()
EXACT = sorted(set(SERVO_METHODS) - {"ibvs-desired", "ibvs-mean", "switched"})
"""whose matrix is that of the current view"""
IN_ANY_DIRECTION = ("bearing", "spherical", "pbvs", "pbvs-target")


def seen(points, goal_T_camera):
    """The measurement of points (n, 3), given in the goal's camera frame."""
    now = goal_T_camera.inv().apply(points)
    distances, goal_distances = np.linalg.norm(now, axis=1), np.linalg.norm(points, axis=1)
    return ServoMeasurement(
        0.0,
        now / distances[:, None],
        distances,
        points / goal_distances[:, None],
        goal_distances,
        goal_T_camera.as_matrix(),
    )


def moved(pose, twist, seconds):
    return pose * RigidTransform.from_exp_coords(np.concatenate((twist[3:], twist[:3])) * seconds)


def differences(method, points, pose):
    """de/d(twist) by central differences of a rigid motion, (k, 6)."""
    step, columns = 1e-6, []
    for axis in np.eye(6):
        after, before = (method.error(seen(points, moved(pose, axis, s * step)))[0] for s in (1, -1))
        columns.append((after - before) / (2.0 * step))
    return np.stack(columns, axis=-1)


def numbers(low, high, count):
    return st.lists(st.floats(low, high), min_size=count, max_size=count).map(np.array)


@pytest.mark.parametrize("name", EXACT)
@settings(max_examples=15, deadline=None, derandomize=True)
@given(
    offsets=numbers(-0.2, 0.2, 21),
    shift=numbers(-0.3, 0.3, 3),
    turn=numbers(-0.6, 0.6, 3),
    middle=numbers(-0.4, 0.4, 2),
)
def test_the_interaction_matrix_is_the_derivative_of_the_error(name, offsets, shift, turn, middle):
    method, points = servo_method(name, 1.0), offsets.reshape(7, 3) + np.array([*middle, 1.3])
    pose = RigidTransform.from_components(shift, Rotation.from_rotvec(turn))
    try:
        error, matrix = method.error(seen(points, pose))
        expected = differences(method, points, pose)
    except FeatureLoss:
        assume(False)
    assume(expected.shape == matrix.shape)  # a triangle on the brink of being too thin
    assert len(error) == len(matrix)
    np.testing.assert_allclose(matrix, expected, atol=2e-6 * np.abs(matrix).max())


@pytest.mark.parametrize("name", IN_ANY_DIRECTION)
def test_it_holds_past_90_degrees_and_behind_the_camera_and_for_half_a_turn(name):
    rng, method = np.random.default_rng(5), servo_method(name, 1.0)
    for angle in (0.0, 1e-9, 1e-3, 2.0, 3.1):
        directions = rng.standard_normal((8, 3))
        points = directions / np.linalg.norm(directions, axis=1)[:, None] * rng.uniform(0.5, 3.0, (8, 1))
        axis = rng.standard_normal(3)
        turn = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis))
        pose = RigidTransform.from_components(rng.uniform(-0.1, 0.1, 3), turn)
        _, matrix = method.error(seen(points, pose))
        expected = differences(method, points, pose)
        np.testing.assert_allclose(matrix, expected, atol=1e-6 * np.abs(matrix).max())


def test_the_mean_matrix_is_the_mean_and_the_desired_one_that_of_the_goal():
    view = seen(TARGET, ASIDE)
    goal = seen(TARGET, HOME)
    matrix = {
        name: ImageServo(ImageServoOptions(matrix=name)).error(view)[1]
        for name in ("current", "desired", "mean")
    }
    np.testing.assert_array_equal(matrix["desired"], ImageServo().error(goal)[1])
    np.testing.assert_allclose(matrix["mean"], 0.5 * (matrix["current"] + matrix["desired"]), atol=1e-15)


@pytest.mark.parametrize("name", SERVO_METHODS)
@pytest.mark.parametrize("turn", [(0.1, -0.2, 0.3), (-0.05, 0.1, 1.3)])
def test_every_method_reaches_the_goal(name, turn):
    method = servo_method(name, AdaptiveGain(4.0, 1.0, 3.0))
    pose = RigidTransform.from_components([0.08, -0.05, -0.15], Rotation.from_rotvec(turn))
    for _ in range(300):
        pose = moved(pose, method.step(seen(TARGET, pose)), 0.05)
    assert np.linalg.norm(pose.translation) < 1e-6
    assert pose.rotation.magnitude() < 1e-6


@pytest.mark.parametrize("name", SERVO_METHODS)
def test_at_the_goal_nothing_moves(name):
    np.testing.assert_allclose(servo_method(name, 1.0).step(seen(TARGET, HOME)), 0.0, atol=1e-12)


def test_the_camera_goes_straight_in_space_and_the_target_straight_in_the_image_of_the_other():
    start = RigidTransform.from_components([0.1, -0.08, -0.2], Rotation.from_rotvec([0.2, -0.3, 0.6]))
    for translation in ("camera", "target"):
        method, pose, places, middles = PoseServo(PoseServoOptions(translation=translation)), start, [], []
        for _ in range(200):
            pose = moved(pose, method.step(seen(TARGET, pose)), 0.02)
            places.append(pose.translation)
            middles.append(pose.inv().apply(TARGET.mean(axis=0)) - TARGET.mean(axis=0))
        straight = {"camera": np.array(places), "target": np.array(middles)}
        off = {
            k: np.linalg.norm(np.cross(v, v[0]), axis=1).max() / np.linalg.norm(v[0])
            for k, v in straight.items()
        }
        other = "target" if translation == "camera" else "camera"
        assert off[translation] < 0.002 < 0.01 < off[other]


@pytest.mark.parametrize("turn", [(0.3, -0.2, 0.5), (0.0, 0.0, np.pi - 0.01)])
def test_on_the_sphere_a_turn_of_the_camera_alone_asks_for_no_translation(turn):
    twist = servo_method("spherical", 1.0).step(
        seen(TARGET, RigidTransform.from_rotation(Rotation.from_rotvec(turn)))
    )
    np.testing.assert_allclose(twist, [0.0, 0.0, 0.0, *(-np.array(turn))], atol=1e-9)


def test_on_the_sphere_a_turn_is_no_reflection_where_all_bearings_lie_in_one_plane():
    rng, method = np.random.default_rng(3), servo_method("spherical", 1.0)
    around = np.array([0.0, 1.1, 2.5, 3.6, 5.0])
    ring = np.column_stack((np.cos(around), np.sin(around), np.zeros(5)))
    for _ in range(10):
        turn = rng.uniform(-1.0, 1.0, 3)
        turned = RigidTransform.from_rotation(Rotation.from_rotvec(turn))
        np.testing.assert_allclose(method.error(seen(ring, turned))[0][-3:], turn, atol=1e-9)


def test_half_a_turn_about_the_axis_lets_image_points_retreat_and_position_based_servoing_turn():
    half = RigidTransform.from_rotation(Rotation.from_rotvec([0.0, 0.0, np.pi - 1e-3]))
    assert servo_method("ibvs", 1.0).step(seen(TARGET, half))[2] < -0.3
    assert np.abs(servo_method("pbvs", 1.0).step(seen(TARGET, half))[:3]).max() < 1e-9


def test_the_switched_law_leaves_the_image_when_the_pose_runs_away_and_comes_back_for_the_image():
    half = RigidTransform.from_rotation(Rotation.from_rotvec([0.0, 0.0, np.pi - 1e-3]))
    method, pose, modes = SwitchedServo(), half, []
    for _ in range(400):
        pose = moved(pose, method.step(seen(TARGET, pose)), 0.02)
        modes.append(method.mode)
    assert modes[0] == "image"
    assert "pose" in modes
    assert np.linalg.norm(pose.translation) < 1e-3
    aside = RigidTransform.from_components([0.3, 0.0, 0.0], Rotation.identity())
    method = SwitchedServo()
    method.step(seen(TARGET, aside))
    method.mode = "pose"
    method.step(seen(TARGET, RigidTransform.from_components([0.6, 0.0, 0.0], Rotation.identity())))
    assert method.mode == "image"


def behind(view, rows):
    """The view with the points ``rows`` behind the camera, now."""
    bearings = view.bearings.copy()
    bearings[rows, 2] *= -1.0
    return replace(view, bearings=bearings)


def test_points_behind_the_image_plane_are_not_used_and_too_few_are_a_named_stop():
    view = seen(
        TARGET, RigidTransform.from_components([0.02, 0.01, -0.05], Rotation.from_rotvec([0.0, 0.1, 0.2]))
    )
    error, matrix = ImageServo().error(behind(view, [0, 3]))
    assert error.shape == (14,)
    assert matrix.shape == (14, 6)
    with pytest.raises(FeatureLoss, match="3 of 9 points are seen in front of the image plane"):
        ImageServo().step(behind(view, slice(0, 6)))
    with pytest.raises(FeatureLoss, match=r"none of 9 points lies in front.*2½-D"):
        servo_method("hybrid-2.5d", 1.0).step(behind(view, slice(None)))
    with pytest.raises(FeatureLoss, match="triangles that are wide enough"):
        servo_method("spherical", 1.0).step(seen(TARGET[[0, 0, 2, 6]], HOME))


@pytest.mark.parametrize("name", ["ibvs", "bearing", "spherical"])
def test_points_on_one_line_are_a_named_stop(name):
    line = np.array([[0.05 * i, 0.0, 0.5] for i in range(-3, 4)])
    with pytest.raises(SingularInteraction):
        servo_method(name, 1.0).step(seen(line, HOME))


def test_2_d_takes_a_point_in_front_where_the_middle_one_is_not():
    view, method = seen(TARGET, ASIDE), servo_method("hybrid-2.5d", 1.0)
    middle = method.error(view)[0][:2]
    np.testing.assert_allclose(
        middle, (view.points[4, :2] / view.points[4, 2]) - TARGET[4, :2] / TARGET[4, 2]
    )
    assert np.abs(method.error(behind(view, [4]))[0][:2] - middle).max() > 1e-4


def test_a_wrong_distance_changes_the_way_of_what_uses_it_and_nothing_else():
    view = seen(TARGET, ASIDE)
    wrong = replace(view, distances=1.3 * view.distances)
    changed = {
        name for name in SERVO_METHODS
        if np.abs(servo_method(name, 1.0).step(wrong) - servo_method(name, 1.0).step(view)).max() > 1e-6
    }  # fmt: skip
    assert changed == {"ibvs", "ibvs-mean", "bearing", "spherical", "hybrid-2.5d", "switched"}


def test_the_adaptive_gain_goes_from_one_value_to_the_other_at_the_stated_slope():
    gain = AdaptiveGain(4.0, 0.4, 30.0)
    assert gain(np.zeros(6)) == pytest.approx(4.0)
    assert gain(np.full(6, 1e3)) == pytest.approx(0.4)
    step = 1e-7
    assert (gain(np.array([0.0, 0, -step, 0, 0, 0])) - 4.0) / step == pytest.approx(-30.0, rel=1e-5)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: servo_method("ibsv", 1.0), "legal: ibvs, .*did you mean 'ibvs'"),
        (lambda: servo_method("ibvs", 0.0), "gain"),
        (lambda: servo_method("spherical", np.nan), "gain"),
        (lambda: servo_method("pbvs", "fast"), "gain: 'fast' given"),
        (lambda: HybridServoOptions(gain=-1.0), "gain"),
        (lambda: SphericalServoOptions(gain=np.inf), "gain"),
        (lambda: PoseServoOptions(translation="object"), "legal: camera, target"),
        (lambda: ImageServoOptions(matrix="average"), "legal: current, desired, mean"),
        (lambda: ImageServoOptions(feature="corner"), "feature"),
        (lambda: SwitchedServoOptions(most_pose_error=1.0), "most_pose_error"),
        (lambda: AdaptiveGain(0.4, 4.0, 30.0), "at_zero"),
        (lambda: AdaptiveGain(4.0, 0.0, 30.0), "at_infinity"),
        (lambda: AdaptiveGain(4.0, 0.4, -1.0), "slope_at_zero"),
    ],
)
def test_wrong_options_are_named(make, message):
    with pytest.raises(InputError, match=message):
        make()


def test_every_method_of_a_run_is_planned_or_has_its_law():
    assert {method.name for method in METHODS.values() if method.plans is None} == set(SERVO_METHODS)


@pytest.mark.parametrize("angle", [0.0, 1e-300, 1e-12, 1e-3, 1.0, 3.1, np.pi - 1e-9, np.pi])
def test_a_rotation_s_vector_is_scipy_s(angle):
    rotation = Rotation.from_rotvec(angle * np.array([0.48, -0.6, 0.64]))
    found = rotation_vector(rotation.as_matrix())
    assert np.linalg.norm(found) <= np.pi + 1e-15
    assert (Rotation.from_rotvec(found).inv() * rotation).magnitude() < 1e-15


def test_of_many_points_the_triangles_are_even_ones_and_found_without_listing_all():
    for count in (2, 3, 9, 10, 25):
        every = np.array(list(combinations(range(count), 3)), dtype=np.int64).reshape(-1, 3)
        even = np.linspace(0, len(every) - 1, min(len(every), MOST_TRIANGLES)).round().astype(np.int64)
        np.testing.assert_array_equal(_triangles(count)[:3].T, every[even])
    corners = _triangles(5000)[:3]  # there are 2e10
    assert (np.diff(corners, axis=0) > 0).all()
    assert corners[:, 0].tolist() == [0, 1, 2]
    assert corners[:, -1].tolist() == [4997, 4998, 4999]


@pytest.mark.parametrize("gain", [np.float32(2.0), np.int64(2), 2])
def test_a_gain_is_any_number(gain):
    assert ImageServoOptions(gain=gain).gain == 2.0


def test_the_adaptive_gain_is_of_the_largest_component_whichever_it_is():
    gain = AdaptiveGain(4.0, 0.4, 30.0)
    expected = 3.6 * np.exp(-30.0 * 0.2 / 3.6) + 0.4
    for place in range(6):
        twist = np.full(6, 0.15)
        twist[place] = -0.2
        assert gain(twist) == pytest.approx(expected, rel=1e-14)


def test_2_d_needs_its_point_in_front_in_the_goal_image_too_and_the_middle_is_that_of_all_points():
    view, method = seen(TARGET, ASIDE), servo_method("hybrid-2.5d", 1.0)
    goal_bearings = view.goal_bearings.copy()
    goal_bearings[:8, 2] *= -1.0
    errors = view.points[:, :2] / view.points[:, 2:] - TARGET[:, :2] / TARGET[:, 2:]
    only = method.error(replace(view, goal_bearings=goal_bearings))[0][:2]
    np.testing.assert_allclose(only, errors[8], atol=1e-12)
    aside = method.error(behind(view, [4, 5, 6, 7, 8]))[0][:2]
    rest = [0, 1, 2, 3]
    middle = np.linalg.norm(view.goal_points[rest] - view.goal_points.mean(axis=0), axis=1)
    own = np.linalg.norm(view.goal_points[rest] - view.goal_points[rest].mean(axis=0), axis=1)
    assert middle.argmin() != own.argmin()
    np.testing.assert_allclose(aside, errors[rest[middle.argmin()]], atol=1e-12)


def test_image_points_must_be_in_front_in_the_goal_image_too():
    view = seen(TARGET, ASIDE)
    goal_bearings = view.goal_bearings.copy()
    goal_bearings[[0, 3], 2] *= -1.0
    error, _ = ImageServo().error(replace(view, goal_bearings=goal_bearings))
    assert error.shape == (14,)
    assert np.isfinite(error).all()


def test_triangles_that_are_thin_in_either_image_are_not_used():
    method = servo_method("spherical", 1.0)
    thin = np.array([[0.0, 0.0, 1.0], [0.3, 0.0, 1.0], [0.0, 0.3, 1.0], [0.3, 0.3, 1.0], [0.15, 0.01, 1.0]])
    wide = thin.copy()
    wide[4] = [0.15, 0.15, 0.9]
    for now, goal in ((thin, thin), (thin, wide), (wide, thin)):
        view = replace(seen(goal, HOME), bearings=seen(now, HOME).bearings)
        used = [
            k for k in combinations(range(5), 3)
            if all(area(b, k) > 0.1 * max(area(b, j) for j in combinations(range(5), 3))
                   for b in (view.bearings, view.goal_bearings))
        ]  # fmt: skip
        assert len(method.error(view)[0]) == len(used) + 3 < 13


def area(bearings, corners):
    a, b, c = bearings[list(corners)]
    return 0.5 * np.linalg.norm(np.cross(b - a, c - a))


class TestSwitching:
    """From the image to the pose and back, each by its own bound and with its own gain."""

    START = RigidTransform.from_components([0.1, 0.0, 0.0], Rotation.from_rotvec([0.0, 0.0, 0.5]))

    def mode_after(self, servo, mode, pose):
        servo.step(seen(TARGET, self.START))
        servo.mode = mode
        twist = servo.step(seen(TARGET, pose))
        return servo.mode, twist

    @pytest.mark.parametrize("share", [1.4, 1.6])
    def test_the_image_is_left_by_the_distance_over_the_targets_and_the_turn(self, share):
        servo = SwitchedServo(SwitchedServoOptions(most_pose_error=1.5, most_image_error=9.0))
        mean = np.linalg.norm(TARGET, axis=1).mean()
        size = share * np.hypot(0.1 / mean, 0.5)
        for shift in (0.0, 0.8 * size * mean):
            turn = np.sqrt(size**2 - (shift / mean) ** 2)
            pose = RigidTransform.from_components([0.0, shift, 0.0], Rotation.from_rotvec([turn, 0.0, 0.0]))
            assert self.mode_after(servo, "image", pose)[0] == ("pose" if share > 1.5 else "image")

    @pytest.mark.parametrize("share", [1.9, 2.1])
    def test_the_pose_is_left_by_the_rms_of_the_image_however_many_points_there_are(self, share):
        def rms(points, pose):
            return np.sqrt(np.mean(ImageServo().error(seen(points, pose))[0] ** 2))

        servo = SwitchedServo(SwitchedServoOptions(most_pose_error=9.0, most_image_error=2.0))
        few, low, high = TARGET[[0, 2, 6, 8]], 0.0, 1.0
        for _ in range(60):
            shift = 0.5 * (low + high)
            away = RigidTransform.from_translation([shift, 0.0, 0.0])
            larger = rms(few, away) > share * rms(TARGET, self.START)
            low, high = (low, shift) if larger else (shift, high)
        servo.step(seen(TARGET, self.START))
        servo.mode = "pose"
        servo.step(seen(few, away))
        assert servo.mode == ("image" if share > 2.0 else "pose")

    def test_each_law_has_its_own_gain(self):
        options = SwitchedServoOptions(ImageServoOptions(gain=0.5), PoseServoOptions(gain=2.0))
        for mode, method in (("image", ImageServo(options.image)), ("pose", PoseServo(options.pose))):
            found, twist = self.mode_after(SwitchedServo(options), mode, self.START)
            assert found == mode
            np.testing.assert_array_equal(twist, method.step(seen(TARGET, self.START)))

    def test_bounds_are_above_one(self):
        with pytest.raises(InputError, match="most_image_error"):
            SwitchedServoOptions(most_image_error=1.0)
