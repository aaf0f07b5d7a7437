"""What every robot implements, real or simulated: joint state, images, velocity commands."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy.typing as npt

from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import ByteArray, FloatArray


@with_field_docs
@dataclass(frozen=True)
class RobotState:
    """The joints at one instant of the robot's clock."""

    time: float
    """[s]"""
    joint_positions: FloatArray
    """(n,) [rad]"""
    joint_velocities: FloatArray
    """(n,) [rad/s]"""


@with_field_docs
@dataclass(frozen=True)
class CameraImage:
    """One frame of the camera in the hand."""

    time: float
    """instant of exposure on the robot's clock [s]; the frame is delivered later"""
    pixels: ByteArray
    """(height, width) grey values"""


@runtime_checkable
class Robot(Protocol):
    """An arm with a camera in its hand, commanded by joint velocities."""

    def read(self) -> RobotState:
        """Return the joints as they are now."""
        ...

    def image(self) -> CameraImage | None:
        """Return the newest delivered frame; None before the first one arrives."""
        ...

    def command(self, joint_velocities: npt.ArrayLike) -> None:
        """Move with these joint velocities (n,) [rad/s] until told otherwise.

        Raises:
            InputError: wrong shape, NaN or infinity.
        """
        ...

    def stop(self) -> None:
        """Brake to standstill as fast as the joints' acceleration limits allow."""
        ...
