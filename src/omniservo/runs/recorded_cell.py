"""A robot cell of which everything that passes its two seats is recorded."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from omniservo.geometry.arrays import FloatArray
from omniservo.robots import ArmDriver, CameraImage, CameraSource, RobotState
from omniservo.runs.ground_truth import GroundTruth
from omniservo.runs.job_recording import JobRecording
from omniservo.runs.robot_cell import RobotCell
from omniservo.safety import SupervisedRobot
from omniservo.scenes import Scene


class RecordedCell:
    """The same cell; its joints as they are read, what is sent to them, and its images are recorded."""

    def __init__(self, cell: RobotCell, recording: JobRecording) -> None:
        self._cell = cell
        self.driver: ArmDriver = _RecordedDriver(cell.driver, recording)
        """the cell's"""
        self.camera: CameraSource = _RecordedCamera(cell.camera, recording)
        """the cell's"""

    @property
    def scene(self) -> Scene:
        """The cell's."""
        return self._cell.scene

    @property
    def truth(self) -> GroundTruth | None:
        """The cell's."""
        return self._cell.truth

    @property
    def clock(self) -> Callable[[], float] | None:
        """The cell's."""
        return self._cell.clock

    @property
    def drive(self) -> SupervisedRobot | None:
        """The cell's."""
        return self._cell.drive

    def approve(self, motion: str) -> None:
        """Let the cell decide."""
        self._cell.approve(motion)

    def wait(self, duration: float) -> None:
        """Let time [s] pass."""
        self._cell.wait(duration)

    def bring_arm_to(self, joints: FloatArray) -> None:
        """Bring the arm to rest in these joints (n,) [rad]."""
        self._cell.bring_arm_to(joints)

    def move_obstacles(self, numbers: Sequence[int], by: FloatArray) -> None:
        """Have obstacles put elsewhere."""
        self._cell.move_obstacles(numbers, by)

    def close(self) -> None:
        """Close the cell."""
        self._cell.close()


class _RecordedDriver:
    def __init__(self, driver: ArmDriver, recording: JobRecording) -> None:
        self._driver, self._recording, self._time = driver, recording, -np.inf

    def read(self) -> RobotState:
        state = self._driver.read()
        if state.time > self._time:
            self._time = state.time
            self._recording.state(state)
        return state

    def command(self, joint_velocities: npt.ArrayLike) -> None:
        self._driver.command(joint_velocities)
        self._recording.command(np.asarray(joint_velocities, dtype=np.float64))

    def stop(self) -> None:
        self._driver.stop()
        if np.isfinite(self._time):
            self._recording.command(np.zeros_like(self._driver.read().joint_positions))

    def close(self) -> None:
        self._driver.close()


class _RecordedCamera:
    def __init__(self, camera: CameraSource, recording: JobRecording) -> None:
        self._camera, self._recording, self._time = camera, recording, -np.inf

    def image(self) -> CameraImage | None:
        image = self._camera.image()
        if image is not None and image.time > self._time:
            self._time = image.time
            self._recording.image(image)
        return image

    def close(self) -> None:
        self._camera.close()
