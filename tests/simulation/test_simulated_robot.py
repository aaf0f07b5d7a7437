"""The simulated robot is an arm driver and a camera source: time, motion, images, contacts."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

from omniservo.errors import InputError
from omniservo.robots import ArmDriver, CameraSource
from omniservo.scenes import SceneBox, Sensor
from omniservo.simulation import SimulatedRobot

SLOW = np.array([0.3, -0.2, 0.25, 0.4, -0.3, 0.5])  # [rad/s]


@pytest.fixture(scope="module")
def robot(make_scene):
    return SimulatedRobot(make_scene(boards=(), floor=None))


@pytest.fixture(autouse=True)
def start_anew(robot):
    robot.place(robot.world.scene.start_joints)


def test_it_is_an_arm_driver_and_a_camera_source(robot):
    assert isinstance(robot, ArmDriver)
    assert isinstance(robot, CameraSource)


def test_it_may_be_closed_more_than_once(robot):
    robot.close()
    robot.close()


def test_arm_that_is_not_commanded_does_not_sag(robot):
    robot.advance(2.0)
    state = robot.read()
    assert state.time == pytest.approx(2.0)
    np.testing.assert_allclose(state.joint_positions, robot.world.scene.start_joints, atol=1e-4)


def test_commanded_velocity_is_reached_and_integrated(robot):
    robot.command(SLOW)
    robot.advance(0.2)
    before = robot.read()
    robot.advance(0.3)
    after = robot.read()
    np.testing.assert_allclose(after.joint_velocities, SLOW, atol=2e-3)
    np.testing.assert_allclose(after.joint_positions - before.joint_positions, 0.3 * SLOW, atol=2e-4)


def test_acceleration_limit_holds_from_standstill(robot):
    acceleration = robot.world.scene.arm.joint_acceleration
    robot.command(robot.world.scene.arm.joint_speed)
    robot.advance(0.02)
    speed = robot.read().joint_velocities
    assert (speed < 1.15 * acceleration * 0.02).all()
    assert (speed > 0.5 * acceleration * 0.02).all()


def test_command_beyond_a_joint_speed_keeps_its_direction(robot):
    fast = robot.world.scene.arm.joint_speed * np.array([0, 0, 0, 0, 0, 2.0])
    fast[0] = 1.0
    robot.command(fast)
    robot.advance(0.45)
    np.testing.assert_allclose(robot.read().joint_velocities, fast / 2.0, atol=0.05)


def test_stop_ramps_down_to_standstill(robot):
    robot.command(SLOW)
    robot.advance(0.3)
    robot.stop()
    robot.advance(0.005)
    braking = np.abs(robot.read().joint_velocities)
    assert (braking < np.abs(SLOW)).all()
    assert (braking > 0.02).all()  # no jump: 5 ms are too short to stand
    robot.advance(0.3)
    np.testing.assert_allclose(robot.read().joint_velocities, 0.0, atol=1e-4)


def test_joint_stands_at_the_end_of_its_range(robot):
    near_end = robot.world.scene.start_joints.copy()
    near_end[4] = np.deg2rad(120.0)
    robot.place(near_end)
    robot.command([0, 0, 0, 0, 0.5, 0])
    robot.advance(0.5)
    assert robot.read().joint_positions[4] == pytest.approx(np.deg2rad(120.5), abs=1e-3)
    assert robot.read().joint_velocities[4] == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("bad", [[0, 0, 0], [0, 0, np.nan, 0, 0, 0], [np.inf] * 6])
def test_wrong_command_is_refused_and_the_old_one_stays(robot, bad):
    robot.command(SLOW)
    with pytest.raises(InputError, match="joint_velocities"):
        robot.command(bad)
    robot.advance(0.3)
    np.testing.assert_allclose(robot.read().joint_velocities, SLOW, atol=2e-3)


def test_time_does_not_run_backwards(robot):
    with pytest.raises(InputError, match="duration"):
        robot.advance(-0.1)


def test_thirds_of_a_tick_are_not_lost(robot):
    for _ in range(30):
        robot.advance(1.0 / 30.0)
    assert robot.time == pytest.approx(1.0, abs=1e-9)


def test_place_outside_the_range_is_refused(robot):
    with pytest.raises(InputError, match="leave the arm's range"):
        robot.place(np.deg2rad([0, 0, 0, 0, 130, 0]))


def test_first_frame_arrives_after_the_latency(robot):
    assert robot.image() is None
    robot.advance(0.019)
    assert robot.image() is None
    robot.advance(0.001)
    assert robot.image().time == 0.0


def test_frames_carry_the_time_of_their_exposure(robot):
    stamps = set()
    for _ in range(200):
        robot.advance(0.001)
        frame = robot.image() if robot.time >= 0.02 else None
        if frame is not None:
            age = robot.time - frame.time
            assert 0.02 - 1e-9 <= age < 0.02 + 1 / 30 + 0.0015
            stamps.add(round(frame.time, 6))
    assert sorted(stamps) == [0.0, 0.033, 0.067, 0.1, 0.133, 0.167]


def test_frame_shows_the_exposure_not_the_delivery(robot):
    robot.command([0, 0, 0, 0, -0.5, 0])
    robot.advance(0.1 + 0.02)
    frame = robot.image()
    assert frame.time == pytest.approx(0.1)
    exposed = robot.world_T_camera(frame.time)
    angle = (exposed.inv() * robot.world_T_camera()).rotation.magnitude()
    assert angle == pytest.approx(0.5 * 0.02, rel=0.05)


def test_truth_is_refused_for_a_time_without_exposure(robot):
    robot.advance(0.1)
    with pytest.raises(InputError, match="no frame was exposed"):
        robot.world_T_camera(0.0123)


def test_latency_that_is_no_whole_tick_rounds_up(make_scene):
    robot = SimulatedRobot(make_scene(sensor=Sensor(rate=50, latency=0.0102)))
    robot.advance(0.010)
    assert robot.image() is None
    robot.advance(0.001)
    assert robot.image().time == 0.0


def test_same_seed_gives_the_same_frames_whichever_are_looked_at(make_scene):
    first, second = (SimulatedRobot(make_scene(), seed=7) for _ in range(2))
    first.advance(0.02)
    first.image()
    for robot in (first, second):
        robot.advance(0.1 - robot.time + 0.02)
    np.testing.assert_array_equal(first.image().pixels, second.image().pixels)
    other = SimulatedRobot(make_scene(), seed=8)
    other.advance(0.12)
    assert (other.image().pixels != first.image().pixels).any()


def test_driving_into_an_obstacle_is_reported_and_the_obstacle_holds(make_scene):
    scene = make_scene(boards=(), dots=None)
    ahead = scene.world_T_camera(scene.start_joints).apply([0, 0, 0.05])
    post = SceneBox("post", RigidTransform.from_translation(ahead), [0.02, 0.06, 0.06])
    robot = SimulatedRobot(make_scene(boards=(), dots=None, obstacles=(post,)))
    gap = robot.arm_obstacle_distance()
    assert gap == pytest.approx(0.025, abs=1e-4)
    velocities = scene.arm.joint_velocities(scene.start_joints, [0, 0, 0.1, 0, 0, 0], scene.flange_T_camera)
    robot.command(velocities)
    robot.advance(0.15)
    assert robot.contacts() == frozenset()
    robot.advance(0.35)
    assert robot.contacts() == frozenset({("camera", "post")})
    assert -0.01 < robot.arm_obstacle_distance() < 0.0
    robot.place(scene.start_joints)
    assert robot.contacts() == frozenset()


def test_obstacles_put_elsewhere_leave_the_motion_and_the_frames_before_as_they_were(make_scene):
    block = SceneBox(
        "block", RigidTransform.from_translation([0.45, 0.05, 0.6]), [0.02, 0.02, 0.02], (0.0, 0.0, 0.0)
    )
    quiet = Sensor(rate=20, latency=0.03, noise=0.0, blur=0.0)
    scene = make_scene(obstacles=(block,), sensor=quiet, dots=None)
    still, changed = SimulatedRobot(scene), SimulatedRobot(scene)
    for robot in (still, changed):
        robot.command(SLOW)
        robot.advance(0.11)
    moved = SceneBox(
        "block", RigidTransform.from_translation([0.45, -0.15, 0.6]), [0.02] * 3, (0.0, 0.0, 0.0)
    )
    gap = changed.arm_obstacle_distance()
    changed.rearrange([moved])
    assert changed.arm_obstacle_distance() != pytest.approx(gap, abs=1e-3)
    for robot in (still, changed):
        robot.advance(0.025)  # the frame of 0.1 s is delivered
    assert changed.image().time == still.image().time
    np.testing.assert_array_equal(changed.image().pixels, still.image().pixels)
    for robot in (still, changed):
        robot.advance(0.1)
    assert changed.image().time == still.image().time
    assert (changed.image().pixels != still.image().pixels).any()
    np.testing.assert_allclose(changed.read().joint_positions, still.read().joint_positions, atol=1e-12)
    np.testing.assert_allclose(changed.read().joint_velocities, still.read().joint_velocities, atol=1e-10)
