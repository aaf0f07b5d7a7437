"""A robot cell of which everything that passes its two seats is recorded."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy.typing as npt

from omniservo.geometry.arrays import FloatArray
from omniservo.robots import ArmDriver, CameraImage, CameraSource, RobotState
from omniservo.runs.ground_truth import GroundTruth
from omniservo.runs.job_recording import JobRecording
from omniservo.runs.robot_cell import RobotCell
from omniservo.safety import SupervisedRobot
from omniservo.scenes import Scene


class RecordedCell:
    """The same cell; its images and its joints as they are read are recorded.

    What leads the arm is recorded by `RecordedSupervision`, which `supervisor_of` puts around it.
    """

    def __init__(self, cell: RobotCell, recording: JobRecording) -> None:
        self.cell = cell
        """as given"""
        self.recording = recording
        """as given"""
        self.driver: ArmDriver = _RecordedDriver(cell.driver, recording)
        """the cell's"""
        self.camera: CameraSource = _RecordedCamera(cell.camera, recording)
        """the cell's"""

    @property
    def scene(self) -> Scene:
        """The cell's."""
        return self.cell.scene

    @property
    def truth(self) -> GroundTruth | None:
        """The cell's."""
        return self.cell.truth

    @property
    def clock(self) -> Callable[[], float] | None:
        """The cell's."""
        return self.cell.clock

    @property
    def drive(self) -> SupervisedRobot | None:
        """The cell's."""
        return self.cell.drive

    def approve(self, motion: str) -> None:
        """Let the cell decide."""
        self.cell.approve(motion)

    def wait(self, duration: float) -> None:
        """Let time [s] pass."""
        self.cell.wait(duration)

    def bring_arm_to(self, joints: FloatArray) -> None:
        """Bring the arm to rest in these joints (n,) [rad]."""
        self.cell.bring_arm_to(joints)

    def move_obstacles(self, numbers: Sequence[int], by: FloatArray) -> None:
        """Have obstacles put elsewhere."""
        self.cell.move_obstacles(numbers, by)

    def close(self) -> None:
        """Close the cell."""
        self.cell.close()


class _RecordedDriver:
    def __init__(self, driver: ArmDriver, recording: JobRecording) -> None:
        self._driver, self._recording = driver, recording

    def read(self) -> RobotState:
        state = self._driver.read()
        self._recording.state(state)
        return state

    def command(self, joint_velocities: npt.ArrayLike) -> None:
        self._driver.command(joint_velocities)

    def stop(self) -> None:
        self._driver.stop()

    def close(self) -> None:
        self._driver.close()


class _RecordedCamera:
    def __init__(self, camera: CameraSource, recording: JobRecording) -> None:
        self._camera, self._recording = camera, recording

    def image(self) -> CameraImage | None:
        image = self._camera.image()
        if image is not None:
            self._recording.image(image)
        return image

    def close(self) -> None:
        self._camera.close()
