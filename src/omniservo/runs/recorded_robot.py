"""Arm and camera of a recording, in the place of a robot."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import RigidTransform

from omniservo.errors import InputError, ServoStop
from omniservo.geometry.arrays import finite_array, finite_number
from omniservo.recording import Recorded, topics
from omniservo.recording.recorded_messages import StepMessage, WaitMessage
from omniservo.robots import Arm, CameraImage, RobotState
from omniservo.ros_messages import RosMessage
from omniservo.ros_messages.messages import ImageMessage, JointStateMessage
from omniservo.runs.recorded_job import RecordedJob, pixels_of
from omniservo.safety import Passed, SafetyOptions, Waiting
from omniservo.safety.motion_history import MotionHistory
from omniservo.safety.supervisor import Wish

_ROUNDING = 1e-9
"""of stamps [s]"""


class RecordingEnds(ServoStop):
    """There is nothing more in the recording."""

    reason = "recording_ends"


class RecordedRobot:
    """Arm and camera as they were recorded, for a servo: each step is given what it was given then."""

    def __init__(
        self, job: RecordedJob, arm: Arm, flange_T_camera: RigidTransform, options: SafetyOptions
    ) -> None:
        self._job = job
        self.arm, self.flange_T_camera, self.options = arm, flange_T_camera, options
        self.stopped: ServoStop | None = None
        """what the servo ended with"""
        self.step: StepMessage | None = None
        """that was recorded for the image that was given last; None: there was none"""
        self.waited: Waiting | None = None
        """how the image that was given last was waited for; None: it was not, or there is no path"""
        start = job.state or RobotState(0.0, np.zeros(arm.dof), np.zeros(arm.dof))
        self._state = self._checked(start)
        self.history = MotionHistory(self._state, options.least_acceleration * arm.joint_acceleration)
        """what was sent and what was measured"""
        self._later: list[Recorded] = []
        self._last = -math.inf

    def image(self) -> CameraImage:
        """Return the next image.

        Raises:
            RecordingEnds: there is none.
            InputError: what is read is not legal.
        """
        with self._job.reads():
            return self._next_image()

    def _next_image(self) -> CameraImage:
        self._apply(self._later)
        messages = self._job.up_to_step()
        last = messages[-1].message if messages else None
        self.step = last if isinstance(last, StepMessage) else None
        waits = [each.message for each in messages if isinstance(each.message, WaitMessage)]
        self.waited = self._waiting(waits[-1]) if waits else None
        images = [i for i, each in enumerate(messages) if isinstance(each.message, ImageMessage)]
        shown: RosMessage | None = self._job.newest_image
        if shown is None or not (images or self.step):
            raise RecordingEnds("there is no other image in the recording")
        if self.step is None:  # the one at which the servo was stopped, not one after that
            shown = messages[images[0]].message
        if not isinstance(shown, ImageMessage):
            raise AssertionError("an image is no image")
        place = 0 if not images else images[-1 if self.step else 0]
        self._apply(messages[:place])
        self._later = messages[place:]
        time = shown.header.stamp.seconds
        if self.step is not None:
            time = self._finite("image_time", self.step.image_time)
            read_at = self._finite("state_time", self.step.state_time)
            self._state = self._checked(RobotState(read_at, self.step.joints, self.step.joint_velocities))
        if time <= self._last:
            where = f"{self._job.run.path}: {topics.STEP}"
            raise InputError(f"{where}: image_time {time:g} s after {self._last:g} s")
        self._last = time
        return CameraImage(time, pixels_of(f"{self._job.run.path}: {topics.IMAGE}", shown))

    @property
    def time(self) -> float:
        """Of the last reading [s]."""
        return self._state.time

    def read(self) -> RobotState:
        """Return the joints at the step."""
        until = (
            self._state.time if self.step is not None else math.inf
        )  # what was read later is not known yet
        states = [
            e
            for e in self._later
            if isinstance(e.message, JointStateMessage)
            and e.topic == topics.JOINT_STATES
            and e.message.header.stamp.seconds <= until + _ROUNDING
        ]
        self._apply(states[:1])
        self._later = [e for e in self._later if not states or e is not states[0]]
        return self._state

    def carry(self, twist: npt.ArrayLike, wish: Wish | None = None) -> Passed:
        """Do nothing: what the arm did is known.

        Raises:
            RecordingEnds: the arm did not take this step.
        """
        if self.step is None:
            raise RecordingEnds("the arm was stopped before this step was over")
        still = np.zeros(self.arm.dof)
        return Passed(still, still, ())

    def command(self, joint_velocities: npt.ArrayLike) -> Passed:
        """Do nothing."""
        still = np.zeros(self.arm.dof)
        return Passed(still, still, ())

    def wait(self, duration: float) -> float:
        """Let no time pass."""
        return duration

    def stop(self, reason: ServoStop | None = None) -> None:
        """Note what for."""
        self.stopped = self.stopped or reason

    def release(self, reason: str) -> None:
        """Drop what it was stopped for."""
        self.stopped = None

    def _apply(self, messages: list[Recorded]) -> None:
        """Take readings and commands into the history."""
        for each in messages:
            if not isinstance(each.message, JointStateMessage):
                continue
            if each.topic == topics.JOINT_STATES:
                self._state = self._checked(self._job.reading(each.message))
                self.history.measured(self._state)
            else:
                where = f"{self._job.run.path}: {topics.JOINT_COMMANDS}: velocity"
                self.history.sent(finite_array(where, each.message.velocity, (self.arm.dof,)))

    def _checked(self, state: RobotState) -> RobotState:
        place, n = f"{self._job.run.path}: {topics.JOINT_STATES}", (self.arm.dof,)
        return RobotState(
            state.time,
            finite_array(f"{place}: position", state.joint_positions, n),
            finite_array(f"{place}: velocity", state.joint_velocities, n),
        )

    def _waiting(self, message: WaitMessage) -> Waiting:
        """Return a waiting as it was recorded."""
        names = ("since", "stands_at", "until", "resumed", "rising")
        place = f"{self._job.run.path}: {topics.WAIT}"
        times = {name: finite_number(f"{place}: {name}", getattr(message, name)) for name in names}
        if not (times["since"] < times["stands_at"] and times["since"] <= times["resumed"]):
            raise InputError(f"{place}: {times} given; legal: since < stands_at, since <= resumed")
        finite_number(f"{place}: rising", message.rising, above=0.0)
        return Waiting(why=message.why, **times)

    def _finite(self, name: str, value: float) -> float:
        return finite_number(f"{self._job.run.path}: {topics.STEP}: {name}", value)
