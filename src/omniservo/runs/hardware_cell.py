"""The robot cell of a real arm: there is no ground truth, and nothing moves before somebody agrees."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import numpy.typing as npt

from omniservo.drive import DriveClient, Phase
from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray
from omniservo.robots import CameraSource, RobotState
from omniservo.scenes import Scene


class HardwareCell:
    """A real arm, driven by a process of its own, with its camera, on the wall clock.

    Args:
        scene: as the task describes it; the arm stands in its start joints.
        client: of the process that drives the arm; it has the camera.
        camera: on the flange.
        approve: called with what the arm is about to do; raises where it may not.
    """

    def __init__(
        self, scene: Scene, client: DriveClient, camera: CameraSource, approve: Callable[[str], None]
    ) -> None:
        self.scene = scene
        """as given"""
        self.camera = camera
        """as given"""
        self.approve = approve
        """as given"""
        self.driver = _DrivenArm(client)
        """the arm as the drive process reads it"""
        self._client = client

    @property
    def truth(self) -> None:
        """No one's."""
        return

    @property
    def clock(self) -> Callable[[], float]:
        """The wall's."""
        return time.monotonic

    @property
    def drive(self) -> DriveClient:
        """The supervisor in the drive process; commands were proven to reach the arm."""
        if self._client.status.phase not in (Phase.ARMED, Phase.MOVING):
            self._client.enable()
        return self._client

    def wait(self, duration: float) -> None:
        """Sleep for ``duration`` [s]."""
        time.sleep(duration)

    def bring_arm_to(self, joints: FloatArray) -> None:
        """Refuse: a person brings a real arm to the goal.

        Raises:
            InputError: always.
        """
        raise InputError(
            "goal: none given, and no program moves a real arm to it: bring it there by hand or pendant and "
            "save the goal with omniservo teach TASK --on ROBOT --out GOAL, then give --goal GOAL"
        )

    def move_obstacles(self, numbers: Sequence[int], by: FloatArray) -> None:
        """Refuse: obstacles are moved by the simulator alone.

        Raises:
            InputError: always.
        """
        raise InputError("moves: obstacles are moved by the simulator alone")

    def close(self) -> None:
        """Brake, and end the drive process and the camera."""
        self._client.close()


class _DrivenArm:
    """An `ArmDriver` through the drive process."""

    def __init__(self, client: DriveClient) -> None:
        self._client = client

    def read(self) -> RobotState:
        return self._client.read()

    def command(self, joint_velocities: npt.ArrayLike) -> None:
        self._client.command(joint_velocities)

    def stop(self) -> None:
        self._client.stop()

    def close(self) -> None:
        self._client.close()
