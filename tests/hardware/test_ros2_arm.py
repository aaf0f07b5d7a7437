"""An arm over ROS 2 topics: another process follows, and comes to rest when this one falls silent."""

import os
import signal
import sys
import time

import numpy as np
import pytest
import yaml
from tests.hardware.served_arm import FORKS, NAMES, START, Served, command_on

from omniservo.errors import ClockFault, ConnectionLost, InputError, InvalidData, NotFinite, NotInControl
from omniservo.hardware import ArmConnection
from omniservo.hardware.ros2.commands import HOLD, TrajectoryCommands, TwistCommands, VelocityCommands
from omniservo.hardware.ros2.network import DdsNetwork
from omniservo.hardware.ros2.ros2_arm import AT_REST, Ros2Arm
from omniservo.robots import Arm, ArmMode
from omniservo.ros_messages import cdr
from omniservo.ros_messages.messages import (
    Float64MultiArrayMessage,
    HeaderMessage,
    JointStateMessage,
    JointTrajectoryMessage,
    TimeMessage,
)
from omniservo.runs.open_hardware import listen_to_arm
from omniservo.runs.robot_check import watchdog_proof
from omniservo.tasks import load_robot

pytest.importorskip("cyclonedds", reason="no wheel of Cyclone DDS for this platform")
from omniservo.hardware.ros2.node import RosNode

DOMAIN = 1 + os.getpid() % 200
HERE = DdsNetwork.localhost(DOMAIN)
A = np.full(6, 2.0)
PATIENCE = 30.0
TRAJECTORY = TrajectoryCommands().topic


def wait_until(condition, what="it"):
    end = time.monotonic() + PATIENCE
    while not (found := condition()):
        assert time.monotonic() < end, f"{what} never came"
        time.sleep(0.002)
    return found


def opened(names=NAMES, **given):
    return Ros2Arm(names, A[: len(names)], network=HERE, patience=PATIENCE, **given)


def drive(arm, velocities, until):
    """Command velocities each 5 ms until a state is as wished."""
    end = time.monotonic() + PATIENCE
    while not until(arm.read()):
        assert time.monotonic() < end
        arm.command(velocities)
        time.sleep(0.005)


def at_rest(served):
    return wait_until(lambda: (told := served.tell()) and max(np.abs(told["qd"])) < 1e-3 and told, "rest")


@pytest.fixture
def node():
    made = RosNode(HERE)
    yield made
    made.close()


@pytest.fixture
def arm_only(node):
    """A publisher of joint states and a subscriber of trajectories, by hand."""
    commands = node.subscribe(TRAJECTORY, JointTrajectoryMessage, reliable=True)
    states = node.publish("/joint_states", JointStateMessage)
    return states, commands


class Talking:
    """Publishes joint states from a thread until the end of a `with`; `change` edits each message."""

    def __init__(self, publisher, change=lambda message: None, period=0.005):
        import threading

        self.publisher, self.change, self.period = publisher, change, period
        self.ended = threading.Event()
        self.thread = threading.Thread(target=self.run, daemon=True)

    def run(self):
        while not self.ended.wait(self.period):
            stamp = HeaderMessage(TimeMessage.of(time.monotonic()))
            message = JointStateMessage(stamp, list(NAMES), START.copy(), np.zeros(6))
            self.change(message)
            self.publisher.write(message)

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *error):
        self.ended.set()
        self.thread.join()


@pytest.mark.slow
@pytest.mark.parametrize(
    "faults",
    [
        {},
        {"clock_offset": 3.7, "drift_ppm": 100.0, "latency": 0.005},
        {"clock_offset": -1e6, "jitter": 0.005, "loss": 0.05},
    ],
)
def test_the_arm_goes_as_commanded_and_rests_when_commands_end(faults):
    """The last message alone says where it comes to rest: 6 joints, each with a velocity of its own."""
    speeds = np.array([0.2, -0.1, 0.05, 0.0, -0.2, 0.1])
    with Served(DOMAIN, faults=faults) as served:
        arm, listener = opened(), RosNode(HERE)
        heard = listener.subscribe(TRAJECTORY, JointTrajectoryMessage, reliable=True)
        try:
            assert isinstance(arm, ArmConnection)
            assert arm.watchdog == HOLD
            before = arm.read()
            assert np.allclose(before.joint_positions, START, atol=1e-3)
            assert before.mode is ArmMode.READY
            assert 0.0 <= time.monotonic() - before.time < PATIENCE
            drive(arm, speeds, lambda s: abs(s.joint_positions - START)[0] > 0.1)
            moving = arm.read()
            way = (moving.joint_positions - START)[[0, 1, 4]] / speeds[[0, 1, 4]]
            assert np.ptp(way) < 0.2 * way.mean()
            told = at_rest(served)  # not a word more
            last = heard.take()[-1]
            assert np.allclose(told["q"], last.points[-1].positions, atol=0.03)
            assert abs(told["q"][3] - START[3]) < 1e-3
            assert not any("ended" not in why for why in told["refused"])  # late under load, and nothing else
        finally:
            arm.close()
            listener.close()


@pytest.mark.slow
def test_stop_brakes_and_the_arm_may_go_again():
    with Served(DOMAIN) as served:
        arm = opened()
        try:
            for speed in (0.3, -0.3):
                begin = arm.read().joint_positions[0]
                drive(arm, [speed, 0, 0, 0, 0, 0], lambda s, b=begin: abs(s.joint_positions[0] - b) > 0.05)
                arm.stop()
                told = at_rest(served)
                assert (told["q"][0] - begin) * np.sign(speed) > 0.05
                arm.stop()
                assert np.allclose(at_rest(served)["q"], told["q"], atol=0.005)
        finally:
            arm.close()
            arm.close()
        with pytest.raises(ConnectionLost, match="the connection was closed"):
            arm.read()


@pytest.mark.slow
@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGSTOP])
def test_a_killed_or_halted_program_leaves_an_arm_at_rest(end):
    with Served(DOMAIN) as served:
        line, other = FORKS.Pipe()
        client = FORKS.Process(target=command_on, args=(other, DOMAIN))
        client.start()
        try:
            assert line.recv() == "moving"
            assert served.tell()["qd"][0] > 0.05
            os.kill(client.pid, end)
            rest = at_rest(served)
            heard = rest["heard"]
            assert served.tell()["heard"] == heard
        finally:
            client.kill()
            client.join()


@pytest.mark.slow
def test_joints_are_matched_by_name_whatever_their_order():
    order = [3, 5, 0, 1, 4, 2]
    names = tuple(NAMES[i] for i in order)
    with Served(DOMAIN) as served:
        arm = opened(names)
        try:
            assert np.allclose(arm.read().joint_positions, START[order], atol=1e-3)
            drive(arm, [0.2, 0, 0, 0, 0, 0], lambda s: s.joint_positions[0] > START[3] + 0.05)
        finally:
            arm.close()
        moved = np.array(at_rest(served)["q"]) - START
        assert moved[3] > 0.05
        assert np.abs(np.delete(moved, 3)).max() < 2e-3


def test_a_joint_that_the_arm_has_not_is_named_beside_those_that_it_has(arm_only):
    with (
        Talking(arm_only[0]),
        pytest.raises(
            InputError,
            match=r"/joint_states in domain .*: .*arm has no 'elbo'; did you mean 'elbow'.*wrist",
        ),
    ):
        opened((*NAMES[:2], "elbo", *NAMES[3:]))


def test_without_anybody_the_message_says_where_was_listened():
    with pytest.raises(
        ConnectionLost, match=r"no joint state in 0.3 s in domain .*nobody publishes /joint_states"
    ):
        Ros2Arm(NAMES, A, network=HERE, patience=0.3)


def test_joint_states_of_another_topic_are_named(node):
    _ = node.publish("/ur/joint_states", JointStateMessage)
    with pytest.raises(ConnectionLost, match="topics of sensor_msgs/msg/JointState: /ur/joint_states"):
        Ros2Arm(NAMES, A, network=HERE, patience=1.0)


def test_a_topic_of_another_type_is_named(node):
    _ = node.publish("/joint_states", Float64MultiArrayMessage)
    with pytest.raises(
        InputError, match="/joint_states is of std_msgs/msg/Float64MultiArray, and not of sensor"
    ):
        Ros2Arm(NAMES, A, network=HERE, patience=1.0)


@pytest.mark.slow
def test_no_controller_and_one_that_requests_what_is_not_offered(node):
    states = node.publish("/joint_states", JointStateMessage)
    with Talking(states):
        with pytest.raises(
            ConnectionLost, match=f"no subscriber of commands .*nobody subscribes to {TRAJECTORY}"
        ):
            Ros2Arm(NAMES, A, network=HERE, patience=1.0)
        _ = node.subscribe(TRAJECTORY, JointTrajectoryMessage, reliable=True, transient=True)
        with pytest.raises(
            InputError,
            match="incompatible QoS: the subscriber requests transient local, this program offers reliable",
        ):
            Ros2Arm(NAMES, A, network=HERE, patience=1.0)
        listening = Ros2Arm(NAMES, A, network=HERE, patience=PATIENCE, listen_only=True)
        assert listening.watchdog is None
        assert listening.read().mode is ArmMode.READY
        with pytest.raises(InputError, match="listen_only"):
            listening.command(np.zeros(6))
        listening.close()


@pytest.mark.slow
def test_commands_go_on_from_where_the_joints_were_commanded_as_far_as_drives_lag(arm_only):
    """Joints that lag, here for ever: from measured positions each message would take back the one before."""
    moved = START.copy()

    def standing(message):
        message.position = moved

    def begins():
        """Return where the newest trajectory begins."""
        return wait_until(arm_only[1].take, "a trajectory")[-1].points[0].positions

    with Talking(arm_only[0], standing):
        arm = opened()
        begin = time.monotonic()
        while time.monotonic() < begin + 0.5:
            arm.command([0.2, 0, 0, 0, 0, -0.1])
            time.sleep(0.005)
        commanded = wait_until(arm_only[1].take, "a trajectory")[-1]
        assert commanded.points[0].positions - START == pytest.approx([0.06, 0, 0, 0, 0, -0.04])
        assert commanded.points[-1].time_from_start.seconds == pytest.approx(HOLD + 0.1)
        arm.stop()
        braked = wait_until(arm_only[1].take, "a trajectory")[-1]
        assert braked.points[-1].time_from_start.seconds <= 0.1 + 1e-9
        assert braked.points[0].positions[0] == pytest.approx(START[0] + 0.06)
        arm.command(np.zeros(6))
        assert begins()[0] - START[0] == pytest.approx(0.06)
        rest = time.monotonic() + HOLD
        moved = START + 0.01
        wait_until(lambda: time.monotonic() > rest + AT_REST, "a while at rest")
        wait_until(lambda: arm.read().joint_positions[0] == moved[0], "the joints where they are")
        arm.command(np.zeros(6))
        assert begins() == pytest.approx(moved)
        arm.close()


@pytest.mark.parametrize(("step", "follows"), [(1.0, False), (-2.0 * np.pi, True)])
def test_joints_that_are_read_elsewhere_all_at_once_are_no_step_unless_they_were_wrapped(
    arm_only, step, follows
):
    """A controller of positions would jump to a wrong reading, and turn a wrapped joint all the way back."""
    moved = START.copy()

    def standing(message):
        message.position = moved

    with Talking(arm_only[0], standing):
        arm = opened()
        begun = time.monotonic()
        arm.command([0.2, 0, 0, 0, 0, 0])
        moved = START + step * np.eye(6)[0]
        while arm.read().joint_positions[0] != moved[0]:  # the motion goes on, however slow this machine
            arm.command([0.2, 0, 0, 0, 0, 0])
        arm.command([0.1, 0, 0, 0, 0, 0])
        arm.stop()
        passed = time.monotonic() - begun
        sent = wait_until(arm_only[1].take, "the stop")
        at = np.array([message.points[0].positions[0] for message in sent])
        if follows:
            assert abs(at[-1] - moved[0]) < 0.1 + 0.6 * passed
        else:
            assert np.abs(at - START[0]).max() < 0.1 + 0.6 * passed
        arm.close()


def test_a_second_publisher_of_commands_takes_control_away_while_it_is_there(arm_only):
    with Talking(arm_only[0]):
        arm = opened()
        try:
            arm.command(np.zeros(6))
            other = RosNode(HERE)
            _ = other.publish(TRAJECTORY, JointTrajectoryMessage)
            wait_until(lambda: arm.read().mode is ArmMode.NOT_IN_CONTROL, "the mode")
            assert f"{TRAJECTORY}: 1 other publisher" in arm.read().mode_reason
            with pytest.raises(NotInControl, match=f"{TRAJECTORY}: 1 other publisher"):
                arm.command(np.zeros(6))
            arm.stop()
            with pytest.raises(NotInControl, match="2 other publisher"):
                opened()
            other.close()
            wait_until(lambda: arm.read().mode is ArmMode.READY, "control")
            arm.command(np.zeros(6))
        finally:
            arm.close()


def test_what_another_program_moves_by_now_is_not_stopped(arm_only):
    """Its trajectory would be replaced by one that stands: a jolt of an arm in full motion."""
    with Talking(arm_only[0]):
        arm = opened()
        arm.stop()
        end = arm._motion.end
        other = RosNode(HERE)
        try:
            _ = other.publish(TRAJECTORY, JointTrajectoryMessage)
            wait_until(lambda: arm.read().mode is ArmMode.NOT_IN_CONTROL, "the mode")
            wait_until(lambda: time.monotonic() > end, "the end of the motion")
            arm_only[1].take()
            arm.stop()
            arm.close()
            arm_only[1].wait(0.2)
            assert arm_only[1].take() == []
        finally:
            other.close()


def test_an_arm_that_moves_already_is_not_taken_over():
    with (
        Served(DOMAIN, moving=True),
        pytest.raises(NotInControl, match=r"the arm moves by 0\.\d+ rad/s before any command"),
    ):
        opened()


def test_an_arm_that_somebody_else_moves_is_listened_to_without_a_command_of_ours(node, arm_only, tmp_path):
    """As for `robot calibrate-hand-eye --on`: zeros would stop what the pendant or a hand moves."""
    path, arm = tmp_path / "robot.yaml", Arm.rx60()
    mount = {"model": "rx60", "flange_T_camera": {"translation": [0.0, 0.0, 0.1]}}
    fields = {"format": "omniservo.robot/1", "driver": "ros2", "address": f"{DOMAIN}@localhost", "arm": mount}
    fields |= {"joints": dict(zip(arm.joint_names, NAMES, strict=True))}
    path.write_text(yaml.safe_dump(fields | {"camera": {"source": "v4l2:0", "calibration": "fe185"}}))
    _ = node.publish(TRAJECTORY, JointTrajectoryMessage)  # the program that moves it
    with Talking(arm_only[0], lambda message: message.velocity.fill(0.3)):
        listening = listen_to_arm(load_robot(path), arm)
        assert listening.read().joint_velocities == pytest.approx(np.full(6, 0.3))
        listening.close()
    assert arm_only[1].take() == []


def test_a_publisher_that_goes_is_a_lost_connection(arm_only):
    with Served(DOMAIN, joint_states="/gone") as served:
        arm = opened(joint_states="/gone")
        assert arm.read() is not None
        served.end()
        with pytest.raises(ConnectionLost, match="/gone: its publisher is gone"):
            wait_until(lambda: arm.read() is None, "the end")
        with pytest.raises(ConnectionLost):
            arm.command(np.zeros(6))
        with pytest.raises(ConnectionLost):
            arm.stop()
        arm.close()


def test_a_stream_that_freezes_leaves_the_newest_state_with_its_stamp(arm_only):
    with Talking(arm_only[0]):
        arm = opened()
    frozen = wait_until(lambda: time.monotonic() - arm.read().time > 0.2 and arm.read(), "an old state")
    assert arm.read().time == frozen.time
    arm.close()


def renamed(message):
    message.name[2] = "forearm"


def shortened(message):
    message.position = message.position[:5]


def doubled(message):
    message.name[1:3] = ["elbow", "elbow"]
    message.name.append("shoulder")
    message.position, message.velocity = np.zeros(7), np.zeros(7)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (renamed, "no 'elbow' among"),
        (shortened, "5 numbers in position for 6 names"),
        (doubled, "'elbow' twice among"),
    ],
)
def test_messages_that_change_in_mid_run_are_invalid_data(arm_only, change, words):
    with Talking(arm_only[0]) as talking:
        arm = opened()
        talking.change = change
        with pytest.raises(InvalidData, match=words):
            wait_until(lambda: arm.read() is None, "the error")
        arm.close()


@pytest.mark.slow
@pytest.mark.parametrize("step", [5.0, -5.0])
def test_a_clock_that_is_set_is_a_clock_fault(arm_only, step):
    def later(message):
        message.header.stamp = TimeMessage.of(message.header.stamp.seconds + step)

    with Talking(arm_only[0]) as talking:
        arm = opened()
        first = arm.read().time
        wait_until(lambda: arm.read().time > first + 1.5, "a settled clock")
        talking.change = later
        with pytest.raises(ClockFault):
            wait_until(lambda: arm.read() is None, "the fault")
        arm.close()


def test_a_stop_after_the_clock_was_set_back_begins_at_once(arm_only):
    """By its stamp it began in five seconds, and until then a controller leads the joints to and fro."""
    with Talking(arm_only[0]) as talking:
        arm = opened()
        arm.command([0.2, 0, 0, 0, 0, 0])
        assert wait_until(arm_only[1].take, "a command")[-1].header.stamp.seconds > 0.0
        talking.change = lambda message: setattr(
            message.header, "stamp", TimeMessage.of(message.header.stamp.seconds - 5.0)
        )
        with pytest.raises(ClockFault):
            wait_until(lambda: arm.command([0.2, 0, 0, 0, 0, 0]), "the fault")
        arm_only[1].take()
        with pytest.raises(ClockFault):
            arm.stop()
        assert wait_until(arm_only[1].take, "the stop")[-1].header.stamp.seconds == 0.0
        arm.close()


def test_a_joint_that_is_no_number_is_never_commanded(arm_only):
    """Trajectories begin where the joints are: the last place that was known must do for the stop."""

    def unknown(message):
        message.position[2] = np.nan

    with Talking(arm_only[0]) as talking:
        arm = opened()
        arm.command([0.2, 0, 0, 0, 0, 0])
        talking.change = unknown
        with pytest.raises(NotFinite, match="'elbow' is at nan rad"):
            wait_until(lambda: arm.read() is None, "the fault")
        arm_only[1].take()
        with pytest.raises(NotFinite):
            arm.stop()
        stop = wait_until(arm_only[1].take, "the stop")[-1]
        assert np.isfinite([point.positions for point in stop.points]).all()
        arm.close()
        arm_only[1].take()
        with pytest.raises(NotFinite):
            opened()
        assert arm_only[1].take() == []


@pytest.mark.slow
def test_velocities_that_no_message_has_are_differences_of_positions():
    with Served(DOMAIN, velocities=False) as served:
        arm = opened()
        try:
            drive(arm, [0.2, 0, 0, 0, 0, 0], lambda s: s.joint_positions[0] > START[0] + 0.1)
            assert arm.read().joint_velocities[0] == pytest.approx(0.2, abs=0.05)
            at_rest(served)
            wait_until(lambda: np.abs(arm.read().joint_velocities).max() < 1e-3, "rest")
        finally:
            arm.close()


def test_states_without_a_stamp_count_from_their_arrival(arm_only):
    def unstamped(message):
        message.header.stamp = TimeMessage()

    with Talking(arm_only[0], unstamped):
        arm = opened()
        before = time.monotonic()
        wait_until(lambda: arm.read().time > before, "a state of now")
        arm.command(np.zeros(6))
        last = wait_until(arm_only[1].take, "the command")[-1]
        assert last.header.stamp.seconds == 0.0
        arm.close()


def test_other_joints_on_the_same_topic_do_not_disturb(node, arm_only):
    def gripper(message):
        message.name, message.position, message.velocity = ["finger"], np.zeros(1), np.zeros(1)

    other = node.publish("/joint_states", JointStateMessage)
    with Talking(other, gripper), Talking(arm_only[0]):
        arm = opened()
        begin = arm.read().time
        wait_until(lambda: arm.read().time > begin + 0.2, "states")
        arm.close()


@pytest.mark.parametrize(
    ("commands", "words"),
    [
        (VelocityCommands(NAMES), r"watchdog: none given for /forward_velocity_controller.* for ever"),
        (TwistCommands(Arm.rx60()), r"watchdog: none given for /servo_node.*incoming_command_timeout"),
        (VelocityCommands(NAMES[:5], 0.1), r"controller_joints: .* given; legal: the joints base, shoulder"),
    ],
)
def test_what_does_not_stop_by_itself_is_refused(commands, words):
    with pytest.raises(InputError, match=words):
        opened(commands=commands)


def test_a_stated_watchdog_is_taken_and_must_be_a_time():
    with pytest.raises(InputError, match="watchdog: 0 given"):
        VelocityCommands(NAMES, 0.0)
    with pytest.raises(InputError, match="watchdog"):
        TwistCommands(Arm.rx60(), watchdog=2.0)


@pytest.mark.slow
def test_velocities_go_in_the_controllers_order_and_are_braked_step_by_step():
    """The stand-in keeps the last velocity for ever, as the controller does; a driver that lives brakes."""
    order = [3, 5, 0, 1, 4, 2]
    names = tuple(NAMES[i] for i in order)
    commands = VelocityCommands(NAMES, watchdog=0.1)
    with Served(DOMAIN, velocity=commands.topic) as served:
        arm = opened(names, commands=commands)
        try:
            assert arm.watchdog == 0.1
            drive(arm, [0, 0, 0.3, 0, 0, 0], lambda s: s.joint_positions[2] > START[0] + 0.05)
            told = at_rest(served)
            assert told["q"][0] > START[0] + 0.05
            drive(arm, [0, 0, 0.3, 0, 0, 0], lambda s: s.joint_velocities[2] > 0.2)
        finally:
            arm.close()
        assert at_rest(served)["q"][0] > told["q"][0]


@pytest.mark.slow
def test_a_watchdog_that_is_only_stated_does_not_pass_for_one():
    """The thread that brakes for a loop that hangs would pass for it, and ends with its process."""
    commands = VelocityCommands(NAMES, watchdog=0.1)
    with Served(DOMAIN, velocity=commands.topic) as served:
        arm = opened(commands=commands)
        try:
            seconds, findings = watchdog_proof(Arm.rx60(), arm, lambda motion: None, arm.watchdog)
            assert seconds > 0.9
            assert "the watchdog promises 0.1 s" in findings[0]
            at_rest(served)
        finally:
            arm.close()


def test_rest_is_sent_even_where_the_thread_that_brakes_slept_through_the_braking(node):
    """A controller that keeps the last velocity for ever must hear zeros."""
    commands = VelocityCommands(NAMES, watchdog=0.1)
    heard = node.subscribe(commands.topic, Float64MultiArrayMessage, reliable=True, depth=1000)
    with Talking(node.publish("/joint_states", JointStateMessage)):
        arm = opened(commands=commands)
        arm.command([0.2, 0, 0, 0, 0, 0])
        begin = time.monotonic()
        with arm._lock:
            wait_until(lambda: time.monotonic() > begin + HOLD + 0.3, "the end of the braking")
        wait_until(lambda: (taken := heard.take()) and not taken[-1].data.any(), "rest")
        arm.close()


@pytest.mark.slow
def test_braking_goes_on_after_the_clock_was_set(node):
    commands = VelocityCommands(NAMES, watchdog=0.1)
    heard = node.subscribe(commands.topic, Float64MultiArrayMessage, reliable=True, depth=1000)

    def later(message):
        message.header.stamp = TimeMessage.of(message.header.stamp.seconds + 5.0)

    with Talking(node.publish("/joint_states", JointStateMessage), period=0.001) as talking:
        arm = opened(commands=commands)
        first = arm.read().time
        wait_until(lambda: arm.read().time > first + 1.5, "a settled clock")
        talking.change = later
        with pytest.raises(ClockFault):
            wait_until(lambda: arm.command([0.2, 0, 0, 0, 0, 0]), "the fault")
        wait_until(lambda: (taken := heard.take()) and not taken[-1].data.any(), "rest")
        arm.close()


@pytest.mark.slow
def test_a_twist_moves_the_flange_as_the_joints_would():
    commands = TwistCommands(Arm.rx60(), watchdog=0.1)
    speeds = np.array([0.2, -0.1, 0.15, 0.1, -0.2, 0.1])
    with Served(DOMAIN, twist=commands.topic) as served:
        arm = opened(commands=commands)
        try:
            drive(arm, speeds, lambda s: s.joint_positions[0] > START[0] + 0.05)
            moved = arm.read().joint_positions - START
            assert np.allclose(moved / moved[0], speeds / speeds[0], atol=0.15)
        finally:
            arm.close()
        at_rest(served)


def test_a_message_that_cannot_be_read_is_passed_over_and_named(arm_only, monkeypatch):
    """Its frame is no UTF-8. (Bytes of another type or length Cyclone DDS refuses itself.)"""
    whole = cdr.encode
    monkeypatch.setattr(
        "omniservo.hardware.ros2.node.encode", lambda m: whole(m).replace(b"frame", b"\xff\xfe\xfdme")
    )

    def spoilt(message):
        message.header.frame_id = "frame"

    with Talking(arm_only[0]) as talking:
        listening = Ros2Arm(NAMES, A, network=HERE, patience=PATIENCE, listen_only=True)
        talking.change = spoilt
        wait_until(lambda: listening._heard.refused > 3, "messages that cannot be read")
        assert (
            listening._heard.refusal == "sensor_msgs/msg/JointState.header.frame_id: a text that is not UTF-8"
        )
        talking.change = lambda message: None
        now = time.monotonic()
        wait_until(lambda: listening.read().time > now, "a state again")
        listening.close()
        talking.change = spoilt
        with pytest.raises(InputError, match="messages that cannot be read: sensor_msgs/msg/JointState.head"):
            Ros2Arm(NAMES, A, network=HERE, patience=1.0)


def test_a_halted_subscriber_acknowledges_nothing_until_it_goes_on(node):
    """It is matched all the while, which is why an opened arm wants its first commands acknowledged."""
    with Served(DOMAIN) as served:
        publisher = node.publish(TRAJECTORY, JointTrajectoryMessage)
        wait_until(lambda: publisher.matched == 1, "the subscriber")
        publisher.write(JointTrajectoryMessage())
        assert publisher.acknowledged(PATIENCE)
        with served.halted():
            publisher.write(JointTrajectoryMessage())
            assert not publisher.acknowledged(0.3)
            assert publisher.matched == 1
        assert publisher.acknowledged(PATIENCE)


def test_without_cyclone_dds_the_message_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "cyclonedds.core", None)
    with pytest.raises(InputError, match=r"ROS 2: .*; pip install omniservo\[ros2\]"):
        opened()


@pytest.mark.parametrize(
    ("names", "accelerations", "words"),
    [
        ((), [], "joint_names"),
        (("a", "a"), [1, 1], "each name once"),
        (("a", 3), [1, 1], "joint_names"),
        (("a", "b"), [1, 0], "accelerations.*legal: all > 0"),
        (("a", "b"), [1], "accelerations: shape"),
    ],
)
def test_arguments_that_are_not_legal_are_named(names, accelerations, words):
    with pytest.raises(InputError, match=words):
        Ros2Arm(names, accelerations, network=HERE)


@pytest.mark.parametrize("topic", ["joint_states", "/", "/a b", "/a/", "/3", None])
def test_topics_that_are_not_legal_are_named(topic):
    with pytest.raises(InputError, match="topic: .*legal: a full name such as"):
        Ros2Arm(NAMES, A, network=HERE, joint_states=topic)


@pytest.mark.slow
def test_a_controller_that_does_not_acknowledge_commands_is_refused_at_the_opening(monkeypatch):
    prove = Ros2Arm._prove
    with Served(DOMAIN) as served:

        def halted_first(arm, sent):
            with served.halted():  # it was seen, and is not there any more
                prove(arm, sent)

        monkeypatch.setattr(Ros2Arm, "_prove", halted_first)
        with pytest.raises(ConnectionLost, match="commands are not acknowledged by their subscriber"):
            Ros2Arm(NAMES, A, network=HERE, patience=3.0)
