"""The line to the robot: what is wrong with an answer, or that there is none, is a stop by its name."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numpy as np

from omniservo.errors import ClockFault, InvalidData, NotFinite, RobotLost, ServoStop, spelled
from omniservo.geometry.arrays import FloatArray
from omniservo.robots import CameraImage, Robot, RobotState

_ROUNDING = 1e-9
"""[s] of clocks"""

STANDING = 0.06
"""So long a robot's clock may stand still [s]: some report their joints only 20 times a second."""

T = TypeVar("T")


class RobotLink:
    """Asks a robot and checks what it answers.

    Args:
        robot: any.
        wait: lets the given time [s] pass.
        dof: how many joints it must report.
    """

    def __init__(self, robot: Robot, wait: Callable[[float], None], dof: int) -> None:
        self._robot, self._wait, self._dof = robot, wait, dof
        self._time, self._waited = -np.inf, 0.0
        self._form: tuple[tuple[int, ...], np.dtype[np.uint8]] | None = None

    def read(self) -> RobotState:
        """Return the joints as they are now, in arrays of their own.

        Raises:
            RobotLost: the robot raised.
            InvalidData: no state, or of another number of joints.
            NotFinite: a number is not finite.
            ClockFault: the robot's clock ran backwards, or stands still while time passes.
        """
        state = _checked(_answered("read", self._robot.read), self._dof)
        before, self._time = self._time, state.time
        if state.time < before - _ROUNDING:
            raise ClockFault(f"the robot's clock ran backwards, from {before:.3f} to {state.time:.3f} s")
        if state.time > before + _ROUNDING:
            self._waited = 0.0
        if self._waited > STANDING:
            raise ClockFault(
                f"the robot's clock stands still at {state.time:.3f} s while {self._waited:.3f} s were waited"
            )
        return state

    def image(self) -> CameraImage | None:
        """Return the newest delivered frame; None before the first one arrives.

        Raises:
            RobotLost: the robot raised.
            InvalidData: no frame, or one of another form than the first.
            NotFinite: its time stamp is not finite.
        """
        image = _answered("image", self._robot.image)
        if image is None:
            return None
        try:
            time, form = float(image.time), (image.pixels.shape, image.pixels.dtype)
        except (AttributeError, TypeError, ValueError, OverflowError):
            raise InvalidData(f"the robot gives {spelled(image)} for an image") from None
        if not np.isfinite(time):
            raise NotFinite(f"the robot gives an image of the time {time} s")
        self._form = self._form or form
        if form != self._form:
            raise InvalidData(
                f"the robot gives an image of {form[0]} {form[1]}; the first was {self._form[0]} "
                f"{self._form[1]}"
            )
        return image

    def command(self, joint_velocities: FloatArray) -> None:
        """Pass joint velocities (n,) [rad/s] on.

        Raises:
            RobotLost: the robot raised.
        """
        _answered("command", lambda: self._robot.command(joint_velocities))

    def stop(self) -> None:
        """Tell the robot to brake by itself.

        Raises:
            RobotLost: the robot raised.
        """
        _answered("stop", self._robot.stop)

    def wait(self, duration: float) -> None:
        """Let time [s] pass.

        Raises:
            RobotLost: what lets it pass raised.
        """
        _answered("wait", lambda: self._wait(duration))
        self._waited += duration


def _answered(name: str, call: Callable[[], T]) -> T:
    try:
        return call()
    except ServoStop:
        raise
    except Exception as error:
        raise RobotLost(f"the robot's {name} failed: {type(error).__name__}: {error}") from error


def _checked(state: RobotState, dof: int) -> RobotState:
    """Return the state in arrays of its own, if it is one."""
    try:
        time = float(state.time)
        positions = np.array(state.joint_positions, dtype=np.float64)
        velocities = np.array(state.joint_velocities, dtype=np.float64)
    except (AttributeError, TypeError, ValueError, OverflowError):
        raise InvalidData(f"the robot reports {spelled(state)} for its joints") from None
    for name, value in (
        ("time", np.array([time])),
        ("joint_positions", positions),
        ("joint_velocities", velocities),
    ):
        if not np.isfinite(value).all():
            raise NotFinite(f"the robot reports {name} {value.tolist()}")
    if positions.shape != (dof,) or velocities.shape != (dof,):
        raise InvalidData(
            f"the robot reports joint positions {positions.shape} and velocities {velocities.shape}; "
            f"the arm has {dof} joints"
        )
    return RobotState(time, positions, velocities)
