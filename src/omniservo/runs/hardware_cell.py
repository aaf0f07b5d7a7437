"""The robot cell of a real arm: unknown the truth in it, and nothing moves before somebody agrees."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray
from omniservo.robots import ArmDriver, CameraSource
from omniservo.scenes import Scene


class HardwareCell:
    """A real arm with its camera, on the wall clock.

    Args:
        scene: as the task describes it; the arm stands in its start joints.
        driver: of the arm.
        camera: on its flange.
        approve: called with what the arm is about to do; raises where it may not.
    """

    def __init__(
        self, scene: Scene, driver: ArmDriver, camera: CameraSource, approve: Callable[[str], None]
    ) -> None:
        self.scene = scene
        """as given"""
        self.driver = driver
        """as given"""
        self.camera = camera
        """as given"""
        self.approve = approve
        """as given"""

    @property
    def truth(self) -> None:
        """No one's."""
        return

    @property
    def clock(self) -> Callable[[], float]:
        """The wall's."""
        return time.monotonic

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
        """End the connections to arm and camera."""
        try:
            self.driver.close()
        finally:
            self.camera.close()
