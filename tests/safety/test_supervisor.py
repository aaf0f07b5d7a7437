"""The supervisor around the simulated arm: what leaves it, what stops it, and how it comes to rest."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.errors import (
    ClockFault,
    InputError,
    JointLimit,
    NotFinite,
    RobotLost,
    ServoStop,
    SlowLoop,
    StaleImage,
    WorkspaceLimit,
)
from omniservo.robots import Arm, ArmDriver, ArmMode, CameraImage, CameraSource
from omniservo.safety import Supervisor

SLOW = np.array([0.3, -0.2, 0.25, 0.4, -0.3, 0.5])


def every_command_is_legal(arm, commands):
    """Finite, within speed, and no step greater than what the joints accelerate in the time since."""
    times, velocities = np.array([t for t, _ in commands]), np.array([v for _, v in commands])
    assert np.isfinite(velocities).all()
    assert (np.abs(velocities) <= arm.joint_speed).all()
    change, elapsed = np.abs(np.diff(velocities, axis=0)), np.diff(times)
    assert (change <= arm.joint_acceleration * elapsed[:, None] * (1 + 1e-6) + 1e-12).all()


def stands_still(written):
    written.robot.advance(0.05)
    return np.abs(written.robot.read().joint_velocities).max() < 1e-2 and not written.commands[-1][1].any()


def comes_to_rest(written):
    """Whether the arm stands 0.3 s later."""
    written.robot.advance(0.3)
    return np.abs(written.robot.read().joint_velocities).max() < 1e-2


def test_it_is_an_arm_driver_and_a_camera_source(guard):
    assert isinstance(guard(), ArmDriver)
    assert isinstance(guard(), CameraSource)


class OwnCamera:
    """A camera that is no part of the arm's driver."""

    def __init__(self, written, **frame):
        self.written, self.frame, self.closed = written, frame, 0

    def image(self):
        return CameraImage(self.written.robot.time, np.zeros((2, 2), dtype=np.uint8), **self.frame)

    def close(self):
        self.closed += 1


def test_arm_and_camera_may_be_two(arm, scene, written):
    camera = OwnCamera(written)
    written.image = None  # the driver has none
    supervisor = Supervisor(written, arm, scene.flange_T_camera, camera=camera, wait=written.advance)
    assert supervisor.image().pixels.shape == (2, 2)
    supervisor.command(SLOW)
    supervisor.close()
    assert stands_still(written)
    assert (written.closed, camera.closed) == (1, 1)


def test_the_camera_is_closed_although_the_arm_does_not_answer(arm, scene, written):
    camera = OwnCamera(written)
    supervisor = Supervisor(written, arm, scene.flange_T_camera, camera=camera, wait=written.advance)
    written.close = None
    with pytest.raises(RobotLost, match="close"):
        supervisor.close()
    assert camera.closed == 1


def test_a_robot_of_before_that_is_arm_and_camera_is_driven_with_a_warning(arm, scene, written):
    mount = scene.flange_T_camera
    with pytest.warns(DeprecationWarning, match="camera=") as told:
        supervisor = Supervisor(written, arm, mount, wait=written.advance)
    assert told[0].filename == __file__
    written.robot.advance(0.03)
    assert supervisor.image() is not None
    supervisor.command(SLOW)


def test_without_a_camera_nothing_is_driven(arm, scene, written):
    class Blind:
        read, command, stop, close = written.read, written.command, written.stop, written.close

    with pytest.raises(InputError, match="camera: none given"):
        Supervisor(Blind(), arm, scene.flange_T_camera, wait=written.advance)


def test_a_slow_command_arrives_as_it_is(guard, written):
    supervisor = guard()
    supervisor.command(SLOW)
    supervisor.wait(0.1)
    np.testing.assert_array_equal(written.commands[-1][1], SLOW)
    passed = supervisor.command(SLOW)
    assert passed.limits == ()
    np.testing.assert_array_equal(passed.target, SLOW)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_whatever_is_commanded_what_leaves_is_legal_and_no_joint_leaves_its_range(guard, written, arm, seed):
    rng, causes, supervisor = np.random.default_rng(seed), set(), guard()
    low, high = arm.joint_range.T
    for _ in range(80):
        wanted = rng.normal(size=6) * rng.choice([0.1, 1.0, 5.0, 1e6, 1e300])
        if rng.random() < 0.1:
            wanted[rng.integers(6)] = rng.choice([np.nan, np.inf, -np.inf])
        try:
            supervisor.command(wanted)
            supervisor.wait(rng.uniform(0.0, 0.3))
            if rng.random() < 0.2:
                supervisor.stop()
        except ServoStop as stop:
            causes.add(stop.reason)
            assert stands_still(written)
            supervisor.release(stop.reason)
            pull_back(supervisor, written, 0.5 * (low + high))
    every_command_is_legal(arm, written.commands)
    joints = np.array(written.joints)
    assert (joints > low).all()
    assert (joints < high).all()
    assert {"joint_limit", "not_finite"} <= causes


def pull_back(supervisor, written, middle):
    """Lead the arm away from the end of its range, so that the next commands have room."""
    for _ in range(4):
        supervisor.command(0.5 * (middle - written.robot.read().joint_positions))
        supervisor.wait(0.2)
    supervisor.stop()
    supervisor.wait(0.1)


@pytest.mark.parametrize("joint", range(6))
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_every_joint_at_full_speed_is_stopped_inside_its_range(guard, written, arm, joint, sign):
    supervisor, velocities = guard(max_linear_speed=50.0, max_angular_speed=50.0), np.zeros(6)
    velocities[joint] = sign * arm.joint_speed[joint]
    with pytest.raises(JointLimit, match=arm.joint_names[joint]) as stop:
        while True:
            supervisor.command(velocities)
            supervisor.wait(0.033)
    assert "range is" in str(stop.value)
    assert stands_still(written)
    joints = np.array(written.joints)[:, joint]
    low, high = arm.joint_range[joint]
    assert low < joints.min()
    assert joints.max() < high
    left = high - joints.max() if sign > 0 else joints.min() - low
    # it need not have stopped much earlier than the reaction time, 1° and a tick ask for
    assert left < 0.1 * arm.joint_speed[joint] + np.deg2rad(1.0) + 0.08
    every_command_is_legal(arm, written.commands)


def test_from_the_end_of_its_range_a_joint_may_go_back(guard, written, arm):
    q = written.robot.read().joint_positions
    q[4] = arm.joint_range[4, 1] - 1e-3
    written.robot.place(q)
    supervisor = guard()
    supervisor.command([0, 0, 0, 0, -0.2, 0])
    supervisor.wait(0.2)
    assert written.robot.read().joint_positions[4] < q[4]
    with pytest.raises(JointLimit):
        for _ in range(20):
            supervisor.command([0, 0, 0, 0, 0.2, 0])
            supervisor.wait(0.05)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_a_command_that_is_not_finite_brakes_and_is_named(guard, written, arm, bad):
    supervisor = guard()
    supervisor.command(5 * SLOW)
    supervisor.wait(0.2)
    with pytest.raises(NotFinite, match=arm.joint_names[2]):
        supervisor.command([0, 0, bad, 0, 0, 0])
    assert stands_still(written)
    every_command_is_legal(arm, written.commands)
    speeds = [np.abs(v).max() for _, v in written.commands]
    assert sum(0 < s < max(speeds) for s in speeds[len(speeds) // 2 :]) >= 10  # it ramped down


@pytest.mark.parametrize("bad", [np.zeros(5), "fast", [[1.0]], None])
def test_a_command_of_another_shape_brakes_and_is_refused(guard, written, bad):
    supervisor = guard()
    supervisor.command(SLOW)
    supervisor.wait(0.1)
    with pytest.raises((InputError, NotFinite)):
        supervisor.command(bad)
    assert stands_still(written)


@pytest.mark.parametrize("field", ["joint_positions", "joint_velocities", "time"])
def test_a_robot_that_reports_nonsense_is_braked(guard, written, arm, field):
    supervisor = guard()
    supervisor.command(SLOW)
    supervisor.wait(0.1)
    written.broken = {field: np.nan if field == "time" else np.full(6, np.nan)}
    with pytest.raises(NotFinite, match=field):
        supervisor.wait(0.01)
    assert stands_still(written)
    every_command_is_legal(arm, written.commands)


def test_a_fast_command_is_slowed_down_as_a_whole(guard, written, arm):
    supervisor = guard(max_linear_speed=100.0, max_angular_speed=100.0)
    passed = supervisor.command(10 * arm.joint_speed * [1, 0.5, 0, 0, 0, 0])
    np.testing.assert_allclose(passed.target, arm.joint_speed * [1, 0.5, 0, 0, 0, 0])
    assert set(passed.limits) == {"joint_speed", "acceleration"}


def test_the_camera_keeps_its_speeds(guard, arm, scene, written):
    supervisor = guard(max_linear_speed=0.1, max_angular_speed=0.3)
    rng = np.random.default_rng(3)
    for _ in range(50):
        passed = supervisor.command(rng.normal(size=6))
        twist = (
            arm.camera_jacobian(written.robot.read().joint_positions, scene.flange_T_camera) @ passed.target
        )
        assert np.linalg.norm(twist[:3]) <= 0.1 * (1 + 1e-9)
        assert np.linalg.norm(twist[3:]) <= 0.3 * (1 + 1e-9)
        assert "twist" in passed.limits
        supervisor.wait(0.01)


@pytest.mark.parametrize(("axis", "sign"), [(0, 1), (0, -1), (1, 1), (1, -1), (2, 1), (2, -1)])
def test_the_camera_is_stopped_inside_its_workspace(guard, arm, scene, written, axis, sign):
    written.robot.place(scene.start_joints - [0, 0, 0, 0, 0.5, 0])
    supervisor = guard(workspace=[[-0.05] * 3, [0.05] * 3])
    start = arm.base_T_flange(written.robot.read().joint_positions) * scene.flange_T_camera
    twist = np.zeros(6)
    twist[axis] = 0.1 * sign
    with pytest.raises(WorkspaceLimit, match="xyz"[axis]):
        while True:
            state = supervisor.read()
            supervisor.command(arm.joint_velocities(state.joint_positions, twist, scene.flange_T_camera))
            supervisor.wait(0.02)
    assert stands_still(written)
    places = [
        (start.inv() * arm.base_T_flange(q) * scene.flange_T_camera).translation for q in written.joints
    ]
    assert np.abs(places).max() < 0.05
    assert np.abs(places).max() > 0.02


def test_a_workspace_may_lie_askew_to_the_camera(guard, arm, scene, written):
    """As that of a robot file does, which is stated in the base frame. A box around it would be larger."""
    written.robot.place(scene.start_joints - [0, 0, 0, 0, 0.5, 0])
    start = arm.base_T_flange(written.robot.read().joint_positions) * scene.flange_T_camera
    askew = RigidTransform.from_rotation(Rotation.from_euler("zyx", [30, 40, 20], degrees=True))
    supervisor = guard(workspace=[[-0.05] * 3, [0.05] * 3], found_T_workspace=askew)
    twist = np.concatenate((askew.rotation.apply([0.0, 0.0, -0.1]), np.zeros(3)))
    with pytest.raises(WorkspaceLimit, match="the camera at z = -0"):
        while True:
            supervisor.carry(twist)
            supervisor.wait(0.02)
    ways = [start.inv() * arm.base_T_flange(q) * scene.flange_T_camera for q in written.joints]
    assert -0.05 < askew.inv().apply([way.translation for way in ways])[:, 2].min() < -0.02


def test_an_old_image_brakes_the_arm_even_where_nobody_asks_for_images(guard, written):
    supervisor = guard(image_age=0.25)
    supervisor.command(SLOW)
    with pytest.raises(StaleImage, match="at most 0.25 s"):
        supervisor.wait(1.0)
    assert 0.25 < written.robot.time < 0.4
    assert stands_still(written)
    with pytest.raises(StaleImage):
        supervisor.command(SLOW)


@pytest.mark.parametrize(("sigma", "seconds"), [(0.0, 0.25), (0.05, 0.1)])
def test_an_image_counts_as_old_as_it_may_be(arm, scene, written, sigma, seconds):
    camera = OwnCamera(written, time_sigma=sigma)
    supervisor = Supervisor(written, arm, scene.flange_T_camera, camera=camera, wait=written.advance)
    supervisor.image()
    supervisor.command(SLOW)
    with pytest.raises(StaleImage, match="at most 0.25 s"):
        supervisor.wait(1.0)
    assert seconds < written.commands[-1][0] < seconds + 0.15
    assert stands_still(written)


def test_fresh_images_let_it_move_on(guard, written):
    supervisor = guard(image_age=0.1)
    for _ in range(6):
        assert supervisor.image() is not None or written.robot.time == 0.0
        supervisor.command(SLOW)
        supervisor.wait(0.033)


def test_a_moving_robot_that_is_not_looked_at_is_stopped(guard, written):
    supervisor = guard()
    supervisor.command(SLOW)
    supervisor.wait(0.05)
    written.robot.advance(0.2)
    with pytest.raises(SlowLoop, match=r"0\.2\d+ s; at most 0\.1 s"):
        supervisor.command(SLOW)
    assert stands_still(written)


def test_a_joint_that_turns_faster_than_it_may_is_stopped(guard, written):
    careful = Arm.rx60()
    careful.joint_speed = 0.1 * careful.joint_speed
    supervisor = guard(arm=careful)
    supervisor.command(SLOW)
    written.robot.command([2.0, 0, 0, 0, 0, 0])
    written.robot.advance(0.09)
    with pytest.raises(JointLimit, match="turns with"):
        supervisor.wait(0.01)
    written.robot.advance(0.2)
    assert stands_still(written)


def test_an_error_of_the_robot_itself_brakes_it_and_is_the_loss_of_it(guard, written):
    supervisor = guard()
    supervisor.command(SLOW)
    supervisor.wait(0.1)
    command = written.command
    written.command = lambda velocities: (_ for _ in ()).throw(OSError("the line is down"))
    with pytest.raises(RobotLost, match="command failed: OSError: the line is down") as lost:
        supervisor.command(2 * SLOW)
    assert isinstance(lost.value.__cause__, OSError)
    written.command = command
    assert written.stops >= 1
    assert comes_to_rest(written)


def test_a_driver_that_stops_by_another_name_where_it_is_to_brake_hides_nothing(guard, written):
    """An adapter whose line is at fault says so whatever it is asked for."""
    supervisor = guard()
    supervisor.command(SLOW)
    supervisor.wait(0.1)

    def at_fault(*_):
        raise ClockFault("the sender's clock went back by 3.000 s")

    stop, written.command, written.stop = written.stop, at_fault, lambda: (stop(), at_fault())
    with pytest.raises(NotFinite, match="command for j5") as raised:
        supervisor.command([0, 0, 0, 0, np.nan, 0])
    assert raised.value.__notes__ == ["braking: the sender's clock went back by 3.000 s"]
    assert supervisor.stopped.reason == "not_finite"
    assert written.stops == 1


def test_an_arm_is_braked_although_what_was_sent_cannot_be_recorded(guard, written):
    supervisor = guard()
    supervisor.command(SLOW)
    supervisor.wait(0.1)

    def full(news):
        raise OSError("no space left on device")

    supervisor.history.told = full
    with pytest.raises(OSError, match="no space"):
        supervisor.wait(0.1)
    assert written.stops == 1
    assert comes_to_rest(written)


def test_an_arm_that_its_controller_stops_while_it_brakes_is_commanded_no_more(guard, written):
    supervisor = guard()
    supervisor.command(SLOW)
    supervisor.wait(0.3)
    written.broken["mode"] = ArmMode.PROTECTIVE_STOP
    count = len(written.commands)
    supervisor.history.told = (news := []).append
    supervisor.stop(StaleImage("the image is old"))
    assert len(written.commands) == count
    assert written.stops == 1
    assert supervisor.stopped.reason == "stale_image"
    assert not news[-1].velocities.any()  # by the history, too, it is sent nowhere any more


NEAR_SINGULAR = np.radians([-40.0, 40.0, -65.0, 30.0, 8.0, 10.0])
"""the wrist's outer axes are 8 degrees from each other, and turn fast against each other"""

PITCH = np.array([0.0, 0.0, 0.0, 0.0, 0.3, 0.0])


def turned_astray(written, supervisor, lead):
    """Return how far the camera's turn in 0.3 s is from what the twist `PITCH` makes of it [rad]."""

    def pose():
        return supervisor.arm.base_T_flange(written.robot.read().joint_positions) * supervisor.flange_T_camera

    lead(PITCH)
    supervisor.wait(0.1)  # until it is as fast
    before = pose()
    lead(PITCH)
    supervisor.wait(0.3)
    after = pose()
    supervisor.stop()
    return np.linalg.norm((before.inv() * after).rotation.as_rotvec() - 0.3 * PITCH[3:])


def test_a_camera_is_carried_along_its_twist_where_joints_held_alike_lead_it_astray(
    guard, written, arm, scene
):
    def held(twist):
        joints = supervisor.read().joint_positions
        supervisor.command(arm.joint_velocities(joints, twist, scene.flange_T_camera))

    astray = []
    for carried in (False, True):
        written.robot.place(NEAR_SINGULAR)
        supervisor = guard()
        astray.append(turned_astray(written, supervisor, supervisor.carry if carried else held))
    assert astray[1] < 2e-3
    assert astray[0] > 10 * astray[1]


def test_a_camera_that_is_carried_into_a_singularity_is_stopped(guard, written, arm, scene):
    bent = NEAR_SINGULAR * [1, 1, 1, 0, 1, 1]
    written.robot.place(bent)
    supervisor = guard()
    supervisor.carry(-0.3 * arm.camera_jacobian(bent, scene.flange_T_camera)[:, 4])  # straightens the wrist
    with pytest.raises(JointLimit, match="singular"):
        supervisor.wait(1.0)
    assert stands_still(written)
    assert 0.0 < written.robot.read().joint_positions[4] < bent[4]


@pytest.mark.parametrize("bad", [[0.0] * 5, [np.nan] + [0.0] * 5, "north"])
def test_a_twist_that_is_none_stops_the_arm(guard, written, bad):
    supervisor = guard()
    supervisor.carry(0.1 * PITCH)
    supervisor.wait(0.1)
    with pytest.raises(InputError, match="twist"):
        supervisor.carry(bad)
    assert stands_still(written)


def test_a_command_of_joints_ends_the_carrying(guard, written):
    supervisor = guard()
    supervisor.carry(0.1 * PITCH)
    supervisor.wait(0.1)
    supervisor.command(SLOW)
    supervisor.wait(0.2)
    np.testing.assert_array_equal(written.commands[-1][1], SLOW)
