"""A supervised robot of which every question and every answer is recorded, in their order."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import RigidTransform

from omniservo.errors import ServoStop
from omniservo.recording import Call
from omniservo.robots import Arm, CameraImage, RobotState
from omniservo.runs.job_recording import JobRecording
from omniservo.safety import Passed, SafetyOptions, SupervisedRobot
from omniservo.safety.motion_history import MotionHistory, Sent
from omniservo.safety.supervisor import Wish

_T = TypeVar("_T")


class RecordedSupervision:
    """The same robot; a replay can answer a loop as it did.

    What its history takes in, the joints' readings and the commands, is recorded in that order. The history
    begins anew: the robot stands.

    Args:
        robot: stands still.
        recording: takes it in.

    Raises:
        ServoStop: it does not answer.
    """

    def __init__(self, robot: SupervisedRobot, recording: JobRecording) -> None:
        self._robot, self._recording = robot, recording
        self._shown = -np.inf
        recording.led_within(robot.options)
        state = robot.read()
        robot.history.begin(state)
        robot.history.told = self._taken_in
        recording.state(state)
        recording.call(Call.BEGUN, state.time)

    @property
    def arm(self) -> Arm:
        """The robot's."""
        return self._robot.arm

    @property
    def flange_T_camera(self) -> RigidTransform:
        """The robot's."""
        return self._robot.flange_T_camera

    @property
    def options(self) -> SafetyOptions:
        """The robot's."""
        return self._robot.options

    @property
    def stopped(self) -> ServoStop | None:
        """The robot's."""
        return self._robot.stopped

    @property
    def history(self) -> MotionHistory:
        """The robot's."""
        history = self._answer(lambda: self._robot.history)
        self._recording.call(Call.HISTORY)
        return history

    @property
    def time(self) -> float:
        """The robot's."""
        time = self._answer(lambda: self._robot.time)
        self._recording.call(Call.TIME, time)
        return time

    def read(self) -> RobotState:
        """Ask the robot."""
        state = self._answer(self._robot.read)
        self._recording.call(Call.READ)
        return state

    def image(self) -> CameraImage | None:
        """Ask the robot."""
        image = self._answer(self._robot.image)
        if image is None or image.time == self._shown:
            self._recording.call(Call.SAME)
        else:
            self._shown = image.time
            self._recording.image(image)
            self._recording.call(Call.IMAGE, image.time, image.time_sigma)
        return image

    def command(self, joint_velocities: npt.ArrayLike) -> Passed:
        """Pass it on."""
        return self._passed(lambda: self._robot.command(joint_velocities))

    def carry(self, twist: npt.ArrayLike, wish: Wish | None = None) -> Passed:
        """Pass it on."""
        return self._passed(lambda: self._robot.carry(twist, wish))

    def wait(self, duration: float) -> float:
        """Let the robot do it."""
        waited = self._answer(lambda: self._robot.wait(duration))
        self._recording.call(Call.WAITED, waited)
        return waited

    def stop(self, reason: ServoStop | None = None) -> None:
        """Stop the robot."""
        self._answer(lambda: self._robot.stop(reason))
        self._recording.call(Call.STOPPED)

    def release(self, reason: str) -> None:
        """Release the robot."""
        self._robot.release(reason)

    def _passed(self, command: Callable[[], Passed]) -> Passed:
        passed = self._answer(command)
        self._recording.call(Call.PASSED, *passed.wanted.tolist(), *passed.target.tolist())
        return passed

    def _answer(self, ask: Callable[[], _T]) -> _T:
        try:
            return ask()
        except BaseException:
            self._recording.call(Call.RAISED)
            raise

    def _taken_in(self, news: RobotState | Sent) -> None:
        if isinstance(news, RobotState):
            self._recording.state(news)
            self._recording.call(Call.MEASURED, news.time)
        else:
            self._recording.command(news.velocities, news.time)
            self._recording.call(Call.SENT)
