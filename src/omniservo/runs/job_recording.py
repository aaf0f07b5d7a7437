"""What a job tells its recording: from its files to how it ended."""

from __future__ import annotations

import dataclasses
import json
from array import array

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.errors import InputError, NoSolutionError, ServoStop
from omniservo.estimation import TwoViewEstimate
from omniservo.geometry.arrays import FloatArray
from omniservo.perception import MatchedPoints
from omniservo.planning import CameraPath, Plan
from omniservo.recording import Call, RunRecording, topics
from omniservo.recording.camera_info import camera_info
from omniservo.recording.recorded_messages import (
    CallsMessage,
    EndMessage,
    FramesMessage,
    LogMessage,
    LookMessage,
    MatchMessage,
    PathMessage,
    PointMessage,
    PoseMessage,
    PoseStampedMessage,
    QuaternionMessage,
    StepMessage,
    TransformMessage,
    TransformStampedMessage,
    WaitMessage,
)
from omniservo.robots import CameraImage, RobotState
from omniservo.ros_messages.messages import (
    HeaderMessage,
    ImageMessage,
    JointStateMessage,
    TimeMessage,
    TwistMessage,
    TwistStampedMessage,
    Vector3Message,
)
from omniservo.runs.run_inputs import RunInputs
from omniservo.safety import SafetyOptions, Step, Waiting
from omniservo.safety.closed_loop import ControllerReport
from omniservo.scenes import Scene
from omniservo.tasks import Task, TaughtGoal

ASKED = "run.json"
"""The attachment that says what was run."""
GOAL = "goal.json"
"""The attachment with the taught goal."""
ESTIMATE = "estimate.json"
"""The attachment with motion and structure."""
LIMITS = "safety.json"
"""The attachment with the numbers within which the arm is led."""
PLAN = "plan.json"
"""The attachment with the plan."""
METRICS = "metrics.json"
"""The attachment with what the run came to."""
FILES = "files/"
"""Attachments whose names begin so are the task's."""
ROBOT_FILES = "robot/"
"""and these the robot file's, where the job is done on a real robot."""

REFUSED = "refused"
"""The reason of an end without a plan: what was seen gave none, which a replay finds again."""

BROKEN_OFF = "broken_off"
"""The reason of an end that what was seen did not bring about: a motion that was not agreed to, an arm that
was not ready for it, Ctrl-C, an error of the program."""

_PLACES = 101
"""of a path that are shown"""

_CALLS = 256
"""are written together, at most"""

_INFORMATION, _WARNING = 20, 30
_JSON = "application/json"


class JobRecording:
    """A job's own words in a `RunRecording`.

    Args:
        recording: takes them in.
    """

    def __init__(self, recording: RunRecording) -> None:
        self._recording = recording
        self._names: list[str] = []
        self._time = 0.0
        self._legs, self._planned, self._has_ended = 0, False, False
        self._read_at = self._shown = np.nan
        self._calls, self._values = bytearray(), array("d")

    def begin(
        self, task: Task, goal: TaughtGoal, scene: Scene, method: str, seed: int, *, time: float
    ) -> None:
        """Say what is going to be done, at this time [s]: the task with its files, the goal, the parameters.

        Raises:
            InputError: a task that was not loaded from a file.
        """
        if task.sources is None:
            raise InputError(f"{task.name}: it was not loaded from a file, so that no recording can keep it")
        self._time = time  # on the clock of what follows: else players show a timeline since the clock's zero
        kept = task.sources.kept(task)
        self._names = list(scene.arm.joint_names)
        robot = task.sources.kept_robot()
        inputs = RunInputs.now(method, seed, kept, scene.start_joints, robot)
        self._recording.parameters(
            {"version": inputs.version, "task": task.name, "method": method, "seed": str(seed)}
        )
        for name, data in kept.files.items():
            self._recording.attach(FILES + name, "application/octet-stream", data)
        for name, data in ({} if robot is None else robot.files.files).items():
            self._recording.attach(ROBOT_FILES + name, "application/octet-stream", data)
        self._recording.attach(ASKED, _JSON, inputs.to_json().encode())
        self._document(GOAL, goal.to_dict())
        info = camera_info(task.camera, _header(time, topics.CAMERA))
        if info is not None:
            self._recording.write(topics.CAMERA_INFO, info, time)
        self._say(f"{task.name}, {method}, seed {seed}: {task.summary}")

    def image(self, image: CameraImage) -> None:
        """Add an image that the job was given, unless it is the last one."""
        if image.time == self._shown:
            return
        self._shown = image.time
        rows, columns = image.pixels.shape
        header = _header(image.time, topics.CAMERA)
        message = ImageMessage(header, rows, columns, "mono8", 0, columns, image.pixels.ravel())
        self._time = max(self._time, image.time)
        self._recording.write(topics.IMAGE, message, self._time, stamp=image.time)

    def state(self, state: RobotState) -> None:
        """Add a reading of the joints, unless it is the last one."""
        if state.time == self._read_at:
            return
        self._read_at = state.time
        self._time = max(self._time, state.time)
        message = JointStateMessage(
            _header(state.time), self._names, state.joint_positions, state.joint_velocities
        )
        self._recording.write(topics.JOINT_STATES, message, self._time, stamp=state.time)

    def command(self, velocities: FloatArray, time: float) -> None:
        """Add joint velocities (n,) [rad/s] that were sent at a time [s]."""
        self._time = max(self._time, time)
        message = JointStateMessage(_header(time), self._names, velocity=velocities)
        self._recording.write(topics.JOINT_COMMANDS, message, self._time, stamp=time)

    def call(self, call: Call, *values: float) -> None:
        """Add a call to the robot that is led, or what it took in meanwhile."""
        self._calls.append(call)
        self._values.extend(values)
        if call is Call.IMAGE or len(self._calls) >= _CALLS:
            self._write_calls()

    def led_within(self, options: SafetyOptions) -> None:
        """Note within which limits the arm is led."""
        fields = dataclasses.asdict(options)
        numbers = {name: value for name, value in fields.items() if isinstance(value, int | float)}
        self._document(LIMITS, numbers)

    def looked(self, image: CameraImage, scene: Scene, joints: FloatArray, motion_seconds: float) -> None:
        """Note that the newest image is one to plan from, taken in ``joints`` (n,) [rad]."""
        header = _header(image.time, topics.CAMERA)
        self._recording.write(
            topics.LOOK, LookMessage(header, image.time, joints, motion_seconds), self._time
        )
        base_T_camera = scene.arm.base_T_flange(joints) * scene.flange_T_camera
        self._frame(topics.BASE, topics.INITIAL_CAMERA, base_T_camera, topics.FIXED_FRAMES)
        self._frame(topics.BASE, topics.CAMERA, base_T_camera)
        self._say("looked at the target" if not motion_seconds else "moved a little and looked again")

    def planned(self, matched: MatchedPoints, estimate: TwoViewEstimate, plan: Plan | None) -> None:
        """Note what is known and what is planned."""
        self._planned = True
        self._write_calls()
        header = _header(self._time, topics.CAMERA)
        match = MatchMessage(header, matched.initial.ravel(), matched.goal.ravel())
        self._recording.write(topics.MATCH, match, self._time)
        self._document(ESTIMATE, estimate.to_dict())
        self._say(f"{len(matched)} points matched, {int(estimate.inliers.sum())} agree")
        if plan is not None:
            self._document(PLAN, plan.to_dict())
            self._say(f"plan: {plan.status}{'' if not plan.reason else ': ' + plan.reason}")

    def follow(self, paths: list[CameraPath]) -> None:
        """Note the ways that are followed, of which those after the last call are new."""
        for path in paths[self._legs :]:
            header = _header(self._time, topics.INITIAL_CAMERA)
            poses = [PoseStampedMessage(header, _pose(path(w))) for w in np.linspace(0.0, 1.0, _PLACES)]
            self._recording.write(topics.PLANNED_PATH, PathMessage(header, poses), self._time)
            if self._legs:
                self._say("another way is taken up", _WARNING)
            self._legs += 1

    def step(self, step: Step, report: ControllerReport, leg: int, scene: Scene) -> None:
        """Note a control step."""
        self._write_calls()
        header = _header(step.image.time, topics.CAMERA)
        pose, twist = report.initial_T_camera, step.filtered.twist
        message = StepMessage(
            header,
            time=step.time,
            image_time=step.image.time,
            state_time=step.state.time,
            w=report.w,
            leg=leg,
            error_px=report.error_px,
            goal_error_px=report.goal_error_px,
            control_seconds=step.control_seconds,
            pixels=np.ravel(step.pixels),
            valid=step.valid.astype(np.uint8),
            reference_pixels=np.ravel(report.reference_pixels),
            twist=twist,
            filter_change=step.filtered.change,
            estimated_pose=pose_numbers(pose),
            joints=step.state.joint_positions,
            joint_velocities=step.state.joint_velocities,
        )
        self._recording.write(topics.STEP, message, self._time)
        velocity = TwistMessage(Vector3Message(*twist[:3].tolist()), Vector3Message(*twist[3:].tolist()))
        sent = TwistStampedMessage(_header(self._time, topics.CAMERA), velocity)
        self._recording.write(topics.CAMERA_TWIST, sent, self._time)
        base_T_camera = scene.arm.base_T_flange(step.state.joint_positions) * scene.flange_T_camera
        self._frame(topics.BASE, topics.CAMERA, base_T_camera)
        self._frame(topics.INITIAL_CAMERA, topics.ESTIMATED_CAMERA, pose)

    def wait(self, waiting: Waiting) -> None:
        """Note that the arm waits for images, or that this is over."""
        if np.isnan(waiting.until):
            self._say(f"waiting: {waiting.why}", _WARNING)
        else:
            self._say(f"waited for {waiting.until - waiting.since:.2f} s")
        if not np.isnan(waiting.resumed):
            message = WaitMessage(
                _header(self._time), waiting.since, waiting.stands_at, waiting.until, waiting.resumed,
                waiting.rising, waiting.why,
            )  # fmt: skip
            self._recording.write(topics.WAIT, message, self._time)

    def ended(self, stop: ServoStop | None) -> None:
        """Note how the servo ended."""
        reason, words = ("", "") if stop is None else (stop.reason, str(stop))
        self._end(reason, words)

    def finished(self, metrics: dict[str, object]) -> None:
        """Add what the run came to, as in metrics.json."""
        self._document(METRICS, metrics)

    def broken_off(self, error: BaseException) -> None:
        """Note what ended the job before its time; nothing where the servo had ended."""
        if self._has_ended:
            return
        said = isinstance(error, InputError | NoSolutionError | ServoStop)
        words = str(error) if said else f"{type(error).__name__}: {error}".removesuffix(": ")
        self._end(REFUSED if said and not self._planned else BROKEN_OFF, words)

    def _write_calls(self) -> None:
        if self._calls:
            calls, values = np.frombuffer(bytes(self._calls), np.uint8), np.array(self._values)
            message = CallsMessage(_header(self._time), calls, values)
            self._recording.write(topics.CALLS, message, self._time)
            self._calls, self._values = bytearray(), array("d")

    def _end(self, reason: str, words: str) -> None:
        self._has_ended = True
        self._write_calls()
        self._recording.write(topics.END, EndMessage(_header(self._time), reason, words), self._time)
        if reason:
            self._say(f"{reason}: {words}", _WARNING)
        else:
            self._say("the goal is reached")

    def _document(self, name: str, fields: object) -> None:
        self._recording.attach(name, _JSON, json.dumps(fields).encode())

    def _frame(self, parent: str, child: str, pose: RigidTransform, topic: str = topics.FRAMES) -> None:
        header, numbers = _header(self._time, parent), pose_numbers(pose).tolist()
        where = TransformMessage(Vector3Message(*numbers[4:]), QuaternionMessage(*numbers[:4]))
        frames = FramesMessage([TransformStampedMessage(header, child, where)])
        self._recording.write(topic, frames, self._time)

    def _say(self, words: str, level: int = _INFORMATION) -> None:
        message = LogMessage(TimeMessage.of(self._time), level, "omniservo", words)
        self._recording.write(topics.EVENTS, message, self._time)


def pose_numbers(pose: RigidTransform) -> FloatArray:
    """Return quaternion (x, y, z, w) and translation [m] as one array (7,)."""
    return np.concatenate([pose.rotation.as_quat(), pose.translation])


def _pose(pose: RigidTransform) -> PoseMessage:
    numbers = pose_numbers(pose).tolist()
    return PoseMessage(PointMessage(*numbers[4:]), QuaternionMessage(*numbers[:4]))


def _header(time: float, frame: str = topics.BASE) -> HeaderMessage:
    return HeaderMessage(TimeMessage.of(time), frame)
