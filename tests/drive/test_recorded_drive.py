"""An arm that another process drives, recorded: its commands and joints in their order, and every answer."""

import time

import numpy as np
import pytest
from tests.drive.faulty_arm import MOUNT, Clockwork, FaultyArm, log_of

from omniservo.drive import ArmOpener, DriveClient
from omniservo.errors import ServoStop
from omniservo.recording import QueuedRecording, RecordedRun, topics
from omniservo.recording.recorded_messages import MatchMessage
from omniservo.robots import Arm, CameraImage
from omniservo.runs.job_recording import JobRecording
from omniservo.runs.recorded_job import RecordedJob
from omniservo.runs.recorded_robot import RecordedRobot, RecordingEnds
from omniservo.runs.recorded_supervision import RecordedSupervision
from omniservo.safety import SafetyOptions

PATIENT = SafetyOptions(joint_age=1.0, reaction=1.0, image_age=2.0, following_error=1.0)


class Numbered(Clockwork):
    """Images that differ, with uncertain stamps."""

    def image(self):
        image = super().image()
        return CameraImage(image.time, np.full((4, 6), self.number % 256, np.uint8), 0.002)


def seen_by(robot, steps):
    """Lead the robot as a loop does; yield all that it answers."""
    newest = -np.inf
    for step in range(steps):
        image = robot.image()
        while image is None or image.time <= newest:
            yield robot.wait(1e-3)
            image = robot.image()
        newest = image.time
        yield image.time, image.time_sigma, image.pixels.tolist()
        state = robot.read()
        yield state.time, state.joint_positions.tolist(), state.joint_velocities.tolist()
        now = robot.time
        yield now, robot.history.expected(np.array(now + 0.02)).tolist()
        yield robot.history.at(np.array([image.time, now]))[1].tolist()
        twist = np.array([0.03 * np.cos(step), 0.02 * np.sin(step), 0, 0, 0, 5.0 if step == 5 else 0.0])
        passed = robot.carry(twist)
        yield passed.wanted.tolist(), passed.target.tolist()
        yield robot.history.time, robot.time


@pytest.fixture
def recorded(tmp_path):
    """What was answered while it was led, and how the file was written."""
    client = DriveClient(
        ArmOpener(FaultyArm, {"folder": str(tmp_path)}), Arm.rx60(), MOUNT, camera=Numbered(),
        options=PATIENT, command_life=2.0,
    )  # fmt: skip
    try:
        with QueuedRecording(tmp_path / "r.mcap") as file:
            file.write(topics.MATCH, MatchMessage(), 0.0)
            client.enable()
            assert list(seen_by(client, 8))  # what was before is not in it
            client.stop()
            recording = JobRecording(file)
            robot = RecordedSupervision(client, recording)
            since = time.monotonic()
            answers = list(seen_by(robot, 25))
            robot.stop()
            answers.append(robot.wait(0.2))
            recording.ended(None)
    finally:
        client.close()
    return tmp_path / "r.mcap", answers, since


@pytest.mark.slow
def test_commands_are_recorded_as_they_reached_the_arm_among_the_joints(recorded, tmp_path):
    file, _, since = recorded
    log = [
        (t, v or [0.0] * 6) for t, what, v in log_of(tmp_path) if what in ("command", "stop") and t >= since
    ]
    reached = [(t, v) for k, (t, v) in enumerate(log) if v != (log[k - 1][1] if k else [0.0] * 6)]
    found, read = [(-np.inf, np.zeros(6))], [-np.inf]
    for entry in RecordedRun(file):
        if getattr(entry, "topic", "") == topics.JOINT_STATES:
            assert entry.message.header.stamp.seconds > read[-1]
            read.append(entry.message.header.stamp.seconds)
        if getattr(entry, "topic", "") != topics.JOINT_COMMANDS:
            continue
        if (entry.message.velocity != found[-1][1]).any():
            found.append((read[-1], entry.message.velocity))
    assert len(found) > 25  # a command of each image at least; of 200 a second a busy machine sends fewer
    np.testing.assert_allclose([v for _, v in found[1:]], [v for _, v in reached], rtol=1e-8, atol=1e-12)
    for (instant, _), (read_before, _) in zip(reached, found[1:], strict=True):
        after = read[read.index(read_before) + 1 :]
        assert read_before <= instant + 2e-3  # what is read is rounded to whole milliseconds
        assert not after or after[0] >= instant - 2e-3


@pytest.mark.slow
def test_a_replay_answers_each_call_as_it_was_answered(recorded):
    file, answers, _ = recorded
    arm = Arm.rx60()
    robot = RecordedRobot(RecordedJob(RecordedRun(file)), arm, MOUNT, SafetyOptions())
    assert robot.options.joint_age == 1.0  # as it was led, not as the task would have it
    again = list(seen_by(robot, 25))
    robot.stop()
    again.append(robot.wait(0.2))
    assert again == answers
    with pytest.raises(RecordingEnds):
        for _ in range(1000):
            robot.image()


@pytest.mark.slow
def test_calls_that_were_not_made_are_answered_by_what_is_known(recorded):
    file, answers, _ = recorded
    robot = RecordedRobot(RecordedJob(RecordedRun(file)), Arm.rx60(), MOUNT, SafetyOptions())
    times = []
    with pytest.raises(ServoStop, match="in the recording"):
        while True:
            image = robot.image()
            times += [] if image is None else [image.time]
            for _ in range(3):
                assert robot.read().time <= answers[-2][0] + 10.0
                robot.carry(np.zeros(6))
                assert np.isfinite(robot.time)
                assert len(robot.history.expected(np.array(robot.time))) == 6
    assert times == sorted(times)
    assert len(set(times)) >= 25
