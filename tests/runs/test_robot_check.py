"""What is found of a robot before it is moved: streams, where it stands, and whether silence stops it."""

import json
import re
import time
from dataclasses import replace

import numpy as np
import pytest
from tests.cli.valid_output import check_output
from tests.hardware.wall_clock_arm import WallClockArm

from omniservo.cameras import preset
from omniservo.cli.robot_live import check_fields
from omniservo.errors import NotInControl, ProtectiveStop, ServoStop
from omniservo.hardware import ClockMap
from omniservo.hardware.rtde import RtdeArm
from omniservo.hardware.rtde.server import UrStandIn
from omniservo.robots import ArmMode, CameraImage, RobotState, load_arm
from omniservo.runs import robot_check
from omniservo.runs.joint_trial import JointTrial
from omniservo.runs.loop_delay import LoopDelay
from omniservo.runs.robot_check import check_robot, watchdog_proof
from omniservo.tasks import RobotFile, load_task
from omniservo.tasks.robot_file import RobotCamera
from omniservo.tasks.task import WorkspaceSection

ARM = load_arm("ur5e")
TASK = load_task("ur5e-table")
MOUNT = TASK.arm.flange_T_camera.transform
ROBOT = RobotFile.model_validate(
    {
        "driver": "rtde",
        "arm": {"model": "ur5e", "flange_T_camera": TASK.arm.flange_T_camera},
        "camera": {"source": "v4l2:0", "calibration": TASK.camera},
    }
)
START = np.deg2rad([0.0, -90.0, 90.0, -90.0, -90.0, 0.0])


class Frames:
    """A new image at every tenth of a second, some time ago."""

    def __init__(self, age=0.0, period=0.1):
        self.age, self.period = age, period

    def image(self):
        number = int((time.monotonic() - self.age) / self.period)
        return CameraImage(number * self.period, np.zeros((4, 4), np.uint8))

    def close(self):
        pass


class NoFrames(Frames):
    def image(self):
        return None


def in_protective_stop():
    arm = WallClockArm(START)
    arm.mode = ArmMode.PROTECTIVE_STOP
    return arm


def refused(motion):
    pytest.fail(f"about to {motion}")


def test_an_arm_that_stops_by_itself_is_proven_to():
    asked, arm = [], WallClockArm(START, kept=0.1)
    stood, wrong = watchdog_proof(ARM, arm, asked.append, promised=30.0)
    assert stood >= 0.1
    assert wrong == []
    assert "fall silent" in asked[0]
    turned = np.rad2deg(arm.joints - START)
    assert 0.3 < abs(turned[5]) < 30.0
    assert not turned[:5].any()


def test_an_arm_that_is_moved_while_the_second_question_stands_is_not_turned():
    arm = WallClockArm(START, kept=0.1)

    def agreed(motion):
        arm.joints = arm.joints + np.deg2rad([0.0, 0.0, 3.0, 0.0, 0.0, 0.0])

    stood, wrong = watchdog_proof(ARM, arm, agreed, promised=30.0)
    assert stood is None
    assert wrong == [
        "elbow was moved by 3.00 deg since its room was proven; check it again from where it now stands"
    ]
    assert np.allclose(np.rad2deg(arm.joints - START), [0.0, 0.0, 3.0, 0.0, 0.0, 0.0])


def test_an_arm_that_goes_on_for_ever_is_found_out_and_stopped(monkeypatch):
    monkeypatch.setattr(robot_check, "PATIENCE", 0.5)
    arm = WallClockArm(START)
    stood, wrong = watchdog_proof(ARM, arm, lambda motion: None, promised=0.1)
    assert stood >= 0.5
    assert "after the last command; the watchdog promises 0.1 s" in wrong[0]
    assert not arm.speeds.any()


def test_an_arm_that_goes_on_for_ever_is_found_out_by_the_slowest_watchdog_too():
    arm = WallClockArm(START)
    _, wrong = watchdog_proof(ARM, arm, lambda motion: None, promised=1.0)
    assert "after the last command; the watchdog promises 1 s" in wrong[0]
    assert not arm.speeds.any()


def test_an_arm_that_does_not_move_is_no_proof():
    arm = WallClockArm(START, kept=0.0)
    stood, wrong = watchdog_proof(ARM, arm, lambda motion: None, promised=0.1)
    assert stood is None
    assert re.search(r"was sent by 0\.5 deg and turned by -?0\.0\d deg", wrong[0])


def test_an_arm_whose_program_ended_is_named_for_that_and_not_as_one_that_takes_no_commands():
    arm = WallClockArm(START)
    arm.mode = ArmMode.PROTECTIVE_STOP
    with pytest.raises(ProtectiveStop, match="reports: protective stop"):
        watchdog_proof(ARM, arm, lambda motion: None, promised=0.1)
    assert not arm.speeds.any()


def test_the_stand_in_of_universal_robots_stops_when_commands_cease():
    with UrStandIn(WallClockArm(START)) as server:
        client = RtdeArm(
            server.address, ARM.joint_names, script_port=server.ports.scripts[0],
            dashboard_port=server.ports.dashboard,
        )  # fmt: skip
        try:
            stood, _ = watchdog_proof(ARM, client, lambda motion: None, client.watchdog)
        finally:
            client.close()
    assert stood < robot_check.PATIENCE


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arm", "frames", "finding"),
    [
        (in_protective_stop(), Frames(), "the arm is in protective stop"),
        (WallClockArm(START), NoFrames(), "no images come"),
        (WallClockArm(START), Frames(age=0.6), "1% of the images are 0."),
        (WallClockArm(START), Frames(age=0.6), "the arm waits for images from"),
        (
            WallClockArm(START + np.deg2rad([0.0, 0.0, 75.0, 0.0, 0.0, 0.0])),
            Frames(),
            "wrist_3 and upper_arm are -",
        ),
        (
            WallClockArm(START + np.deg2rad([0.0, 0.0, 1000.0, 0.0, 0.0, 0.0])),
            Frames(),
            "joint elbow is at 1090.00 deg, out of the range in ur5e.xml, -360 to 360 deg",
        ),
    ],
    ids=["protective stop", "no images", "old images", "images waited for", "another zero", "out of range"],
)
def test_what_is_wrong_is_found_and_nothing_moves(monkeypatch, arm, frames, finding):
    monkeypatch.setattr(robot_check, "SECONDS", 1.2)
    found = check_robot(ROBOT, ARM, arm, frames, refused)
    assert any(finding in each for each in found.findings), found.findings
    check_output(json.dumps({"format": "omniservo.robot-check-output/1", **check_fields(found, None)}))
    assert found.stop_seconds is None
    assert found.answers == ()
    assert not arm.speeds.any()
    assert arm.commands == 0


@pytest.mark.slow
def test_rates_and_ages_are_those_of_the_streams(monkeypatch):
    monkeypatch.setattr(robot_check, "SECONDS", 1.5)
    found = check_robot(ROBOT, ARM, in_protective_stop(), Frames(age=0.3), refused)
    assert found.images.rate == pytest.approx(10.0, rel=0.05)
    assert 0.3 <= found.images.age_median < 10.0
    assert found.self_clearance > 0.0


class WiredArm:
    """An arm on a time of its own whose joints turn by a matrix times what they are sent."""

    watchdog = 0.1

    def __init__(self, joints=START, wires=None):
        self.joints, self.speeds = np.array(joints), np.zeros(6)
        self.wires, self.farthest = np.eye(6) if wires is None else np.array(wires), np.zeros(6)
        self.time, self.commands = 100.0, 0

    def clock(self):
        return self.time

    def sleep(self, duration):
        self.time += duration
        self.joints = self.joints + duration * self.speeds
        self.farthest = np.maximum(self.farthest, np.abs(self.joints - START))

    def read(self):
        return RobotState(self.time, self.joints.copy(), self.speeds.copy(), ArmMode.READY)

    def command(self, joint_velocities):
        self.speeds = self.wires @ np.array(joint_velocities, dtype=float)
        self.commands += 1

    def stop(self):
        self.command(np.zeros(6))


class WiredOnTheWall(WallClockArm):
    """The same on the wall clock."""

    def __init__(self, wires):
        super().__init__(START)
        self.wires = wires

    def command(self, joint_velocities):
        super().command(self.wires @ np.array(joint_velocities, dtype=float))


def trial(arm, box=None):
    return JointTrial(ARM, arm, MOUNT, box, arm.clock, arm.sleep)


def wired(**changed):
    """The identity but for some rows."""
    wires = np.eye(6)
    for row, values in changed.items():
        wires[int(row[1])] = values
    return wires


def unit(joint, size=1.0):
    return size * np.eye(6)[joint]


def test_every_joint_of_a_sound_arm_answers_and_is_brought_back():
    asked, arm = [], WiredArm()
    answers, findings = trial(arm).run(asked.append)
    assert findings == []
    assert [answer.joint for answer in answers] == list(reversed(ARM.joint_names))
    for answer in answers:
        assert np.rad2deg(answer.sent) == pytest.approx(0.5, abs=0.02)
        assert answer.turned == pytest.approx(answer.sent, rel=0.05)
    assert (np.rad2deg(arm.farthest) > 0.45).all()
    assert np.abs(np.rad2deg(arm.joints - START)).max() < 0.02
    assert not arm.speeds.any()
    assert asked == ["turn each of 6 joints in turn by 0.5 deg and back, wrist_3 first"]


@pytest.mark.parametrize(
    ("wires", "finding"),
    [
        (wired(r2=unit(2, -1.0)), "elbow was sent by .* and turned by -.*: it turns the other way"),
        (wired(r4=unit(4, np.pi / 180)), "wrist_2 .*: it takes no commands, or in another unit"),
        (wired(r4=unit(4, 0.0)), "wrist_2 .*: it takes no commands, or in another unit"),
        (wired(r4=unit(4, -np.pi / 180)), "wrist_2 .*: it takes no commands, or in another unit"),
        (wired(r0=unit(0, 180 / np.pi)), r"shoulder_pan .*: another unit \(radians for degrees"),
        (wired(r3=unit(3, 0.4)), "wrist_1 .*: another scale"),
        (wired(r3=unit(3, 3.0)), "wrist_1 .*: another scale"),
        (
            wired(r1=unit(2), r2=unit(1)),
            r"elbow .* turned by .0\.0. deg, and shoulder_lift by \+.*: names swapped",
        ),
        (wired(r5=unit(5) + unit(3)), "wrist_1 .*, and wrist_3 by .*: names swapped"),
    ],
)
def test_a_joint_that_answers_otherwise_is_named(wires, finding):
    arm = WiredArm(wires=wires)
    answers, findings = trial(arm).run(lambda motion: None)
    assert findings
    assert re.search(finding, findings[0]), findings
    assert not arm.speeds.any()
    sound = [name for name in ARM.joint_names if not any(name in each for each in findings)]
    for answer in answers:
        if answer.joint in sound:
            assert answer.turned == pytest.approx(answer.sent, rel=0.05)


def test_a_joint_that_runs_away_ends_the_trial():
    arm = WiredArm(wires=wired(r3=unit(3, 180 / np.pi)))
    answers, findings = trial(arm).run(lambda motion: None)
    assert [answer.joint for answer in answers] == ["wrist_3", "wrist_2", "wrist_1"]
    assert len(findings) == 1
    assert (arm.farthest[:3] == 0.0).all()


class LosingControl(WiredArm):
    """Its controller's program ends after so many commands."""

    def __init__(self, after):
        super().__init__()
        self.after = after

    def read(self):
        ends = self.commands >= self.after
        state = super().read()
        return replace(state, mode=ArmMode.NOT_IN_CONTROL, mode_reason="program stopped") if ends else state


def test_an_arm_that_takes_no_commands_any_more_ends_the_trial_by_that_name():
    arm = LosingControl(after=250)
    with pytest.raises(NotInControl, match="takes no commands from this program: program stopped"):
        trial(arm).run(lambda motion: None)
    assert not arm.speeds.any()
    assert (arm.farthest[:5] == 0.0).all()


def box_round(joints, room):
    centre = (ARM.base_T_flange(joints) * MOUNT).translation
    return WorkspaceSection(min=tuple((centre - room).tolist()), max=tuple((centre + room).tolist()))


@pytest.mark.parametrize(
    ("joints", "room", "finding"),
    [
        (START + np.deg2rad([359.0, 0, 0, 0, 0, 0]), None, "shoulder_pan has no 2 deg.*file's range"),
        (START + np.deg2rad([0, 0, 70.5, 0, 0, 0]), None, "elbow has no 2 deg .* apart|overlap"),
        (START - np.deg2rad([359.0, 0, 0, 0, 0, 0]), None, "shoulder_pan has no 2 deg.*file's range"),
        (START, 0.004, "shoulder_pan has no 2 deg of room.*the camera's centre would leave the work"),
    ],
    ids=["range", "own parts", "range below", "workspace"],
)
def test_without_room_nothing_moves(joints, room, finding):
    arm = WiredArm(joints)
    box = None if room is None else box_round(joints, room)
    answers, findings = trial(arm, box).run(refused)
    assert answers == ()
    assert re.search(finding, findings[0]), findings
    assert arm.commands == 0


def test_a_workspace_with_room_is_none_to_stay_for():
    answers, findings = trial(WiredArm(), box_round(START, 0.1)).run(lambda motion: None)
    assert (len(answers), findings) == (6, [])


@pytest.mark.slow
def test_a_joint_that_answers_wrongly_makes_the_robot_unfit_and_no_silence_is_tried(monkeypatch):
    monkeypatch.setattr(robot_check, "SECONDS", 1.2)
    asked, arm = [], WiredOnTheWall(wired(r0=unit(0, -1.0)))
    found = check_robot(ROBOT, ARM, arm, Frames(), asked.append)
    assert len(found.answers) == 6
    assert re.search("shoulder_pan .*: it turns the other way", found.findings[0])
    assert found.stop_seconds is None
    assert len(asked) == 1


@pytest.mark.slow
def test_the_workspace_of_the_robot_file_is_kept(monkeypatch):
    monkeypatch.setattr(robot_check, "SECONDS", 1.2)
    robot = ROBOT.model_copy(update={"workspace": box_round(START, 0.004)})
    found = check_robot(robot, ARM, WallClockArm(START), Frames(), refused)
    assert "the camera's centre would leave the workspace" in found.findings[0]


@pytest.mark.slow
def test_clocks_of_both_lines_are_told(monkeypatch):
    monkeypatch.setattr(robot_check, "SECONDS", 1.2)
    arm, frames = in_protective_stop(), Frames()
    arm.clock = ClockMap()
    for k in range(1000):
        arm.clock.monotonic(0.01 * k, 7.0 + 0.01 * (1.0 + 1e-4) * k + 1e-3 * (k % 3))
    found = check_robot(ROBOT, ARM, arm, frames, refused)
    assert found.camera_clock is None
    assert found.arm_clock.offset == pytest.approx(7.001, abs=1e-3)
    assert found.arm_clock.drift == pytest.approx(1e-4, abs=3e-5)
    assert found.arm_clock.spread == pytest.approx(2e-3, abs=1e-3)
    assert found.arm_clock.later == 0.0


def test_images_that_come_less_often_than_the_robot_file_counts_on_are_told():
    slow = robot_check.StreamTimes(rate=11.4, age_median=0.01, age_p99=0.02, jitter=0.001)
    notice = robot_check.rate_notice(slow, 30.0)
    assert notice.startswith("images come 11.4 times a second; camera.rate of the robot file counts on 30")
    assert robot_check.rate_notice(slow, 12.0) is None
    assert robot_check.rate_notice(None, 30.0) is None


@pytest.mark.parametrize(
    ("rate", "age", "counted_on"), [(30.0, 0.22, 30.0), (10.0, 0.17, 30.0), (10.0, 0.24, 10.0)]
)
def test_images_before_each_of_which_the_arm_would_wait_are_to_be_mended(rate, age, counted_on):
    late = robot_check.StreamTimes(rate=rate, age_median=age, age_p99=age + 0.005, jitter=0.001)
    found = robot_check.always_waits(late, lens(counted_on))
    legal = float(re.search(r"or camera\.rate: ([\d.]+) in the robot file", found)[1])
    assert legal < counted_on
    assert robot_check.always_waits(late, lens(legal)) is None
    sooner = replace(late, age_median=0.05, age_p99=0.06)
    assert robot_check.always_waits(sooner, lens(counted_on)) is None


@pytest.mark.parametrize(("measured", "waits"), [(None, True), (0.2, True), (0.3, False)])
def test_how_old_images_may_be_is_judged_by_what_robot_delay_measured(measured, waits):
    """Of images 0.3 s old, 30 a second, of which a run without a measured delay takes those up to 0.25 s."""
    late = None if measured is None else LoopDelay(measured, 0.02)
    joints = robot_check.StreamTimes(rate=200.0, age_median=0.002, age_p99=0.004, jitter=0.001)
    images = robot_check.StreamTimes(rate=30.0, age_median=0.3, age_p99=0.31, jitter=0.001)
    assert bool(robot_check.always_waits(images, lens(30.0), late)) is waits
    assert bool(robot_check._findings(joints, images, lens(30.0), late)) is waits


def lens(rate):
    return RobotCamera(source="v4l2:0", calibration=preset("fe185"), rate=rate)


def test_a_line_that_became_slower_is_told():
    arm = in_protective_stop()
    arm.clock = ClockMap()
    for k in range(1000):
        arm.clock.monotonic(0.01 * k, 7.0 + 0.01 * k + 0.15 * (k >= 600))
    assert robot_check.line_clock(arm).later == pytest.approx(0.15, abs=1e-3)


def test_room_is_proven_again_where_an_answer_left_the_arm():
    arm = WiredArm(START + np.deg2rad([357.5, 0, 0, 0, 0, 0]), wired(r0=unit(0) + 1.8 * unit(5)))
    answers, findings = trial(arm).run(lambda motion: None)
    assert [answer.joint for answer in answers] == list(reversed(ARM.joint_names[1:]))
    assert re.search("wrist_3 .*, and shoulder_pan by .*: names swapped", findings[0])
    assert re.search("shoulder_pan has no 2 deg of room either way: it would leave", findings[-1])


class GoingOn(WiredArm):
    """After a stop it turns on, by a share of its speed each time that is waited."""

    def __init__(self, share):
        super().__init__()
        self.share, self.stopped = share, False

    def command(self, joint_velocities):
        super().command(joint_velocities)
        self.stopped = False

    def stop(self):
        self.speeds, self.stopped = np.sign(self.joints - START) * np.deg2rad(0.5), True

    def sleep(self, duration):
        super().sleep(duration)
        if self.stopped:
            self.speeds = self.share * self.speeds


def test_how_far_a_joint_turned_is_read_once_it_stands():
    arm = GoingOn(0.8)
    answers, _ = trial(arm).run(lambda motion: None)
    assert answers[0].turned == pytest.approx(arm.farthest[5], abs=2e-5)
    assert answers[0].turned > answers[0].sent + 5e-5


def test_an_arm_that_does_not_stand_after_a_stop_ends_the_trial():
    with pytest.raises(ServoStop, match="does not stand 1 s later"):
        trial(GoingOn(1.0)).run(lambda motion: None)
