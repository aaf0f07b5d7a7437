"""What the states of a Universal Robots controller mean for who commands it."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

from omniservo.robots import ArmMode


class UrRobotMode(IntEnum):
    """`robot_mode` of RTDE."""

    NO_CONTROLLER = -1
    DISCONNECTED = 0
    CONFIRM_SAFETY = 1
    BOOTING = 2
    POWER_OFF = 3
    POWER_ON = 4
    IDLE = 5
    BACKDRIVE = 6
    RUNNING = 7
    UPDATING_FIRMWARE = 8


class UrSafetyMode(IntEnum):
    """`safety_mode` of RTDE."""

    NORMAL = 1
    REDUCED = 2
    PROTECTIVE_STOP = 3
    RECOVERY = 4
    SAFEGUARD_STOP = 5
    SYSTEM_EMERGENCY_STOP = 6
    ROBOT_EMERGENCY_STOP = 7
    VIOLATION = 8
    FAULT = 9
    VALIDATE_JOINT_ID = 10
    UNDEFINED_SAFETY_MODE = 11


class UrRuntimeState(IntEnum):
    """`runtime_state` of RTDE: of the program that the controller runs."""

    STOPPING = 0
    STOPPED = 1
    PLAYING = 2
    PAUSING = 3
    PAUSED = 4
    RESUMING = 5


EMERGENCY_BITS = 0b1110_0000
"""of `safety_status_bits`: emergency stop by the system, by the robot, by either"""

STOPPED_BITS = 0b111_1111_1100
"""of `safety_status_bits`: every stop, violation and fault"""


class ControllerState(NamedTuple):
    """What a controller says of itself, as numbers of RTDE."""

    robot: int
    """see UrRobotMode"""
    safety: int
    """see UrSafetyMode"""
    safety_bits: int
    """`safety_status_bits`; of mode and bits the safer counts"""
    runtime: int
    """see UrRuntimeState"""

    @property
    def safety_stop(self) -> ArmMode:
        """What the safety system lets the arm do: READY, PROTECTIVE_STOP or EMERGENCY_STOP."""
        pressed = (UrSafetyMode.SYSTEM_EMERGENCY_STOP, UrSafetyMode.ROBOT_EMERGENCY_STOP)
        if self.safety in pressed or self.safety_bits & EMERGENCY_BITS:
            return ArmMode.EMERGENCY_STOP
        free = self.safety in (UrSafetyMode.NORMAL, UrSafetyMode.REDUCED)
        return ArmMode.READY if free and not self.safety_bits & STOPPED_BITS else ArmMode.PROTECTIVE_STOP

    @property
    def may_start(self) -> bool:
        """Whether a program could move the arm now: brakes released, no stop."""
        return self.safety_stop == ArmMode.READY and self.robot == UrRobotMode.RUNNING

    @property
    def plays(self) -> bool:
        """Whether a program runs, whichever."""
        return self.runtime == UrRuntimeState.PLAYING

    def mode(self, ours_runs: bool) -> ArmMode:
        """Return what a program of ours may do, given whether it runs."""
        if self.safety_stop != ArmMode.READY:
            return self.safety_stop
        return ArmMode.READY if self.may_start and self.plays and ours_runs else ArmMode.NOT_IN_CONTROL

    def __str__(self) -> str:
        return (
            f"robot {_named(UrRobotMode, self.robot)}, safety {_named(UrSafetyMode, self.safety)}, "
            f"program {_named(UrRuntimeState, self.runtime)}"
        )


def _named(kind: type[IntEnum], value: int) -> str:
    try:
        return kind(value).name.lower().replace("_", " ")
    except ValueError:
        return str(value)
