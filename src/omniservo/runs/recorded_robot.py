"""Arm and camera of a recording, in the place of a robot."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import RigidTransform

from omniservo.errors import InputError, ServoStop
from omniservo.geometry.arrays import FloatArray, finite_array, finite_number
from omniservo.recording import Call, topics
from omniservo.recording.recorded_messages import CallsMessage, StepMessage
from omniservo.robots import Arm, CameraImage, RobotState
from omniservo.ros_messages.messages import ImageMessage, JointStateMessage
from omniservo.runs.recorded_job import RecordedJob, pixels_of
from omniservo.safety import Passed, SafetyOptions
from omniservo.safety.motion_history import MotionHistory, Sent
from omniservo.safety.supervisor import Wish

_ROUNDING = 1.5e-9
"""of a message's stamp [s]"""

_MOST_WAITING = 64
"""So many images may come before the calls for them."""

_TAKEN_IN = (Call.BEGUN, Call.MEASURED, Call.SENT)


class RecordingEnds(ServoStop):
    """There is nothing more in the recording."""

    reason = "recording_ends"


class RecordedRobot:
    """Arm and camera as they were recorded, for a servo: each call is answered as it was then.

    The calls need not be the same. Between two images one that is not in the recording is answered by what is
    known; what was taken into the history then, is.

    Args:
        job: read up to the plan.
        arm: its kinematics and limits.
        flange_T_camera: how the camera sits on it.
        options: as the task has them; the recorded numbers win.

    Raises:
        InputError: what is read is not legal.
    """

    def __init__(
        self, job: RecordedJob, arm: Arm, flange_T_camera: RigidTransform, options: SafetyOptions
    ) -> None:
        self._job = job
        self.arm, self.flange_T_camera = arm, flange_T_camera
        self.stopped: ServoStop | None = None
        """what the servo ended with"""
        self.lost: float | None = None
        """the time of an image that is missing [s], with which the replay ends"""
        self.refused = False
        """whether the arm or its camera stopped the servo; else the servo itself did"""
        start = job.state or RobotState(0.0, np.zeros(arm.dof), np.zeros(arm.dof))
        self._state = self._checked(start)
        self._events: deque[tuple[Call, FloatArray]] = deque()
        self._steps: deque[StepMessage] = deque()
        self._states: deque[RobotState] = deque()
        self._commands: deque[Sent] = deque()
        self._images: deque[ImageMessage] = deque()
        self._shown = job.newest_image
        self._image: CameraImage | None = None
        self._time, self._last = self._state.time, -math.inf
        self._peek()
        numbers = job.limits()
        limits: dict[str, Any] = {
            name: int(value) if isinstance(getattr(options, name), int) else value
            for name, value in numbers.items()
        }
        self.options = replace(options, **limits)
        """as they were"""
        self._history = MotionHistory(self._state, self.options.least_acceleration * arm.joint_acceleration)

    def warmed(self) -> CameraImage | None:
        """Return the image in which points were detected before the servo; None: there was none."""
        event = self._peek()
        if event is None or event[0] is not Call.WARMED:
            return None
        self._events.popleft()
        return self._found(float(event[1][0]), 0.0)

    @property
    def history(self) -> MotionHistory:
        """What was sent and what was measured."""
        self._answer(Call.HISTORY)
        return self._history

    @property
    def time(self) -> float:
        """The instant that it was [s]."""
        answer = self._answer(Call.TIME)
        self._time = self._time if answer is None else float(answer[0])
        return self._time

    def image(self) -> CameraImage | None:
        """Return the newest image.

        Raises:
            RecordingEnds: there is no other.
            InputError: what is read is not legal.
        """
        while (event := self._peek()) is not None and event[0] is not Call.RAISED:
            call, values = self._events.popleft()
            if call is Call.SAME:
                return self._image
            if call is Call.IMAGE:
                self._image = self._found(float(values[0]), float(values[1]))
                return self._image
            self._take_in(call, values)
        self.refused = event is not None
        raise RecordingEnds("there is no other image in the recording")

    def read(self) -> RobotState:
        """Return the joints as they were read."""
        self._answer(Call.READ)
        return self._state

    def carry(self, twist: npt.ArrayLike, wish: Wish | None = None) -> Passed:
        """Return what became of the command then.

        Raises:
            RecordingEnds: the arm did not take it.
        """
        answer = self._answer(Call.PASSED)
        wanted, target = np.zeros((2, self.arm.dof)) if answer is None else answer.reshape(2, -1)
        return Passed(wanted, target, ())

    def command(self, joint_velocities: npt.ArrayLike) -> Passed:
        """Likewise."""
        return self.carry(np.zeros(6))

    def wait(self, duration: float) -> float:
        """Return how long was waited then [s]."""
        if self._peek() is None:
            return duration
        answer = self._answer(Call.WAITED)
        return duration if answer is None else float(answer[0])

    def stop(self, reason: ServoStop | None = None) -> None:
        """Note what for."""
        self.stopped = self.stopped or reason
        if self._peek() is not None:
            self._answer(Call.STOPPED)

    def release(self, reason: str) -> None:
        """Drop what it was stopped for."""
        self.stopped = None

    def recorded_step(self) -> StepMessage:
        """Return the next step that was recorded.

        Raises:
            RecordingEnds: there is none.
            InputError: it is not legal.
        """
        while not self._steps:
            if not self._advance():
                raise RecordingEnds("the recorded servo ended before this step was over")
        step = self._steps.popleft()
        with self._job.reads():
            time = self._finite("image_time", step.image_time)
            self._checked(
                RobotState(self._finite("state_time", step.state_time), step.joints, step.joint_velocities)
            )
            if time <= self._last:
                where = f"{self._job.run.path}: {topics.STEP}"
                raise InputError(f"{where}: image_time {time:g} s after {self._last:g} s")
        self._last = time
        return step

    def steps_left(self) -> int:
        """Return how many steps the rest of the recording has."""
        count = 0
        while self._steps or self._advance():
            count += len(self._steps)
            for read in (self._steps, self._events, self._states, self._commands, self._images):
                read.clear()
        return count

    def _peek(self) -> tuple[Call, FloatArray] | None:
        """Return the next call; None at the end."""
        while not self._events:
            if not self._advance():
                return None
        return self._events[0]

    def _answer(self, asked: Call) -> FloatArray | None:
        """Go on to the answer to a call and return it; None: there is none before the next image.

        Raises:
            RecordingEnds: the robot stopped instead, or there is nothing more.
        """
        while (event := self._peek()) is not None:
            if event[0] is Call.RAISED:
                self.refused = True
                raise RecordingEnds("the arm was stopped before this step was over")
            if event[0] in (Call.IMAGE, Call.SAME):
                return None
            call, values = self._events.popleft()
            if call is asked:
                return values
            self._take_in(call, values)
        raise RecordingEnds("there is nothing more in the recording")

    def _take_in(self, call: Call, values: FloatArray) -> None:
        """Take into the history what it took in then."""
        if call not in _TAKEN_IN:
            return
        with self._job.reads():
            if call is Call.SENT:
                if not self._commands:
                    raise InputError(f"{self._job.run.path}: {topics.JOINT_COMMANDS}: one is missing")
                sent = self._commands.popleft()
                self._history.sent(sent.velocities, sent.time)
                return
            time = float(values[0])
            while self._states and abs(self._state.time - time) > _ROUNDING:
                self._state = self._states.popleft()
            if abs(self._state.time - time) > _ROUNDING:
                raise InputError(
                    f"{self._job.run.path}: {topics.JOINT_STATES}: that of {time:.6f} s is missing"
                )
            self._state = replace(self._state, time=time)
            if call is Call.BEGUN:
                self._history.begin(self._state)
            else:
                self._history.measured(self._state)

    def _found(self, time: float, sigma: float) -> CameraImage:
        """Return the image of a time [s].

        Raises:
            RecordingEnds: it is missing.
        """
        waiting = self._images
        while waiting and (self._shown is None or abs(self._shown.header.stamp.seconds - time) > _ROUNDING):
            self._shown = waiting.popleft()
        if self._shown is None or abs(self._shown.header.stamp.seconds - time) > _ROUNDING:
            self.lost = time
            raise RecordingEnds(f"the image of {time:.6f} s is missing in the recording")
        with self._job.reads():
            return CameraImage(time, pixels_of(f"{self._job.run.path}: {topics.IMAGE}", self._shown), sigma)

    def _advance(self) -> bool:
        """Sort in the next message; return whether there was one."""
        with self._job.reads():
            entry = self._job.next_message()
            if entry is None:
                return False
            message = entry.message
            if isinstance(message, CallsMessage):
                self._events.extend(self._calls(message))
            elif isinstance(message, StepMessage):
                self._steps.append(message)
            elif isinstance(message, ImageMessage):
                self._images.append(message)
                if len(self._images) > _MOST_WAITING:
                    where = f"{self._job.run.path}: {topics.CALLS}"
                    raise InputError(f"{where}: none among {len(self._images)} images")
            elif entry.topic == topics.JOINT_STATES and isinstance(message, JointStateMessage):
                self._states.append(self._checked(self._job.reading(message)))
            elif entry.topic == topics.JOINT_COMMANDS and isinstance(message, JointStateMessage):
                where = f"{self._job.run.path}: {topics.JOINT_COMMANDS}: velocity"
                velocities = finite_array(where, message.velocity, (self.arm.dof,))
                self._commands.append(Sent(message.header.stamp.seconds, velocities))
        return True

    def _calls(self, message: CallsMessage) -> list[tuple[Call, FloatArray]]:
        place, found, at = f"{self._job.run.path}: {topics.CALLS}", [], 0
        values = finite_array(f"{place}: values", message.values, (None,))
        for number in message.calls.tolist():
            if number not in Call.__members__.values():
                raise InputError(f"{place}: calls: {number} given; legal: 0 to {max(Call)}")
            call = Call(number)
            count = call.count(self.arm.dof)
            found.append((call, values[at : at + count]))
            at += count
        if at != len(values):
            raise InputError(f"{place}: values: {len(values)} numbers given; these calls have {at}")
        return found

    def _checked(self, state: RobotState) -> RobotState:
        place, n = f"{self._job.run.path}: {topics.JOINT_STATES}", (self.arm.dof,)
        return RobotState(
            state.time,
            finite_array(f"{place}: position", state.joint_positions, n),
            finite_array(f"{place}: velocity", state.joint_velocities, n),
        )

    def _finite(self, name: str, value: float) -> float:
        return finite_number(f"{self._job.run.path}: {topics.STEP}: {name}", value)
