"""What drives an arm, real or simulated: joints with their time stamp, velocity commands, braking."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol, runtime_checkable

import numpy.typing as npt

from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray


class ArmMode(StrEnum):
    """What an arm's controller lets a program do with it."""

    READY = "ready"
    """it moves as commanded"""
    PROTECTIVE_STOP = "protective_stop"
    """the controller stopped it, for a collision or a limit of its own"""
    EMERGENCY_STOP = "emergency_stop"
    """somebody pressed the button"""
    NOT_IN_CONTROL = "not_in_control"
    """another program or the pendant commands it, its controller is not active, or its brakes are on"""


@with_field_docs
@dataclass(frozen=True)
class RobotState:
    """The joints at one instant of the robot's clock."""

    time: float
    """of the reading [s]"""
    joint_positions: FloatArray
    """(n,) [rad]"""
    joint_velocities: FloatArray
    """(n,) [rad/s]"""
    mode: ArmMode = ArmMode.READY
    """what the arm's controller lets a program do"""
    mode_reason: str = ""
    """what is known of why, in words, where the mode is not READY"""


@runtime_checkable
class ArmDriver(Protocol):
    """An arm that is commanded by joint velocities."""

    def read(self) -> RobotState:
        """Return the newest reading of the joints, without waiting for one."""
        ...

    def command(self, joint_velocities: npt.ArrayLike) -> None:
        """Move with these joint velocities (n,) [rad/s] until the next command.

        Raises:
            InputError: wrong shape, NaN or infinity.
        """
        ...

    def stop(self) -> None:
        """Brake to standstill as fast as the joints' acceleration limits allow."""
        ...

    def close(self) -> None:
        """End the connection to the arm, which stands still; a second call does nothing."""
        ...
