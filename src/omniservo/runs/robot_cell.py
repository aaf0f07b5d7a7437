"""The robot cell: where a job is done. Who starts a job says which one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol, TypeAlias

from omniservo.geometry.arrays import FloatArray
from omniservo.robots import ArmDriver, CameraSource
from omniservo.runs.ground_truth import GroundTruth
from omniservo.safety import SupervisedRobot
from omniservo.scenes import Scene
from omniservo.tasks import Task


class RobotCell(Protocol):
    """An arm with its camera, among what stands around."""

    @property
    def scene(self) -> Scene:
        """Arm, camera mount and surroundings as the task describes them."""
        ...

    @property
    def driver(self) -> ArmDriver:
        """Of the arm, which stands in the scene's start joints."""
        ...

    @property
    def camera(self) -> CameraSource:
        """On the arm's flange."""
        ...

    @property
    def truth(self) -> GroundTruth | None:
        """What the job is scored against; None on a real robot."""
        ...

    @property
    def clock(self) -> Callable[[], float] | None:
        """On which joints and images are stamped [s]; None: time passes in `wait` alone."""
        ...

    @property
    def drive(self) -> SupervisedRobot | None:
        """The supervisor in a process of its own, ready for motion; None: this process commands the arm."""
        ...

    def approve(self, motion: str) -> None:
        """Let whoever is responsible decide whether the arm may do this, in words.

        Raises:
            NoSolutionError: it may not.
        """
        ...

    def wait(self, duration: float) -> None:
        """Let time [s] pass."""
        ...

    def bring_arm_to(self, joints: FloatArray) -> None:
        """Bring the arm to rest in these joints (n,) [rad].

        Raises:
            InputError: wrong shape, not finite, or outside the arm's range.
        """
        ...

    def move_obstacles(self, numbers: Sequence[int], by: FloatArray) -> None:
        """Have the scene's obstacles of these numbers put elsewhere, by (3,) [m] in the world."""
        ...

    def close(self) -> None:
        """End all connections; the arm stands still."""
        ...


OpenCell: TypeAlias = Callable[[Task, int], RobotCell]
"""Opens the cell of a task; the number is the seed of what is random in it."""
