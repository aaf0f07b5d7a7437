"""The line to arm and camera: what is wrong with an answer, or that there is none, is a stop by its name."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeVar

import numpy as np

from omniservo.errors import (
    ClockFault,
    InvalidData,
    NotFinite,
    NotInControl,
    ProtectiveStop,
    RobotLost,
    ServoStop,
    StaleJoints,
    spelled,
)
from omniservo.geometry.arrays import FloatArray, all_finite
from omniservo.robots import ArmDriver, ArmMode, CameraImage, CameraSource, RobotState

_ROUNDING = 1e-9
"""[s] of clocks"""

STANDING = 0.06
"""So long a robot's clock may stand still [s]: some report their joints only 20 times a second."""

T = TypeVar("T")


class CameraLink:
    """Asks a camera and checks what it answers.

    Args:
        camera: its images are read.
    """

    def __init__(self, camera: CameraSource) -> None:
        self._camera = camera
        self._form: tuple[tuple[int, ...], np.dtype[np.uint8]] | None = None

    def image(self) -> CameraImage | None:
        """Return the newest delivered frame; None before the first one arrives.

        Raises:
            RobotLost: the camera raised.
            InvalidData: no frame, one of another form than the first, or of a negative uncertainty.
            NotFinite: its time stamp is not finite, or how uncertain that is.
        """
        image = answered("image", self._camera.image)
        if image is None:
            return None
        try:
            time, sigma = float(image.time), float(image.time_sigma)
            form = image.pixels.shape, image.pixels.dtype
        except (AttributeError, TypeError, ValueError, OverflowError):
            raise InvalidData(f"the camera gives {spelled(image)} for an image") from None
        if not (math.isfinite(time) and math.isfinite(sigma)):
            raise NotFinite(f"the camera gives an image of the time {time} s, with a time_sigma of {sigma} s")
        if sigma < 0.0:
            raise InvalidData(f"the camera gives an image with the time_sigma {sigma} s; legal: 0 or more")
        self._form = self._form or form
        if form != self._form:
            raise InvalidData(
                f"the camera gives an image of {form[0]} {form[1]}; the first was {self._form[0]} "
                f"{self._form[1]}"
            )
        return image

    def close(self) -> None:
        """End the connection to the camera.

        Raises:
            RobotLost: it raised.
        """
        answered("close", self._camera.close)


class RobotLink:
    """Asks arm and camera and checks what they answer.

    Args:
        driver: of the arm.
        camera: on its flange.
        wait: lets the given time [s] pass.
        dof: how many joints it must report.
        clock: on which the arm's readings and the images are stamped [s], `time.monotonic` on a real robot;
            None: time passes in ``wait`` alone, by as much as is waited.
    """

    def __init__(
        self,
        driver: ArmDriver,
        camera: CameraSource,
        wait: Callable[[float], None],
        dof: int,
        clock: Callable[[], float] | None = None,
    ) -> None:
        self._driver, self._camera, self._wait, self._dof = driver, CameraLink(camera), wait, dof
        self._clock = clock
        self._time, self._waited = -np.inf, 0.0
        self._commanded = -np.inf

    @property
    def now(self) -> float:
        """This instant on the clock of joints and images [s]: of the last reading where time stands else."""
        return self._time if self._clock is None else self._clock()

    @property
    def silence(self) -> float:
        """So long the arm was sent nothing [s]; 0 where time stands beside what is waited for."""
        return 0.0 if self._clock is None else self._clock() - self._commanded

    def read(self) -> RobotState:
        """Return the joints as they are now, in arrays of their own.

        Raises:
            RobotLost: the driver raised.
            InvalidData: no state, of another number of joints, or of an unknown mode.
            NotFinite: a number is not finite.
            ClockFault: the robot's clock ran backwards, is ahead of the clock that it is to be on, or stands
                still while time passes.
        """
        state = checked_state(answered("read", self._driver.read), self._dof)
        ahead = -np.inf if self._clock is None else state.time - self._clock()
        if ahead > STANDING:
            raise ClockFault(f"the robot's joints are {ahead:.3f} s ahead of this machine's clock")
        before, self._time = self._time, state.time
        if state.time < before - _ROUNDING:
            raise ClockFault(f"the robot's clock ran backwards, from {before:.3f} to {state.time:.3f} s")
        if state.time > before + _ROUNDING:
            self._waited = 0.0
        if self._clock is None and self._waited > STANDING:
            raise ClockFault(
                f"the robot's clock stands still at {state.time:.3f} s while {self._waited:.3f} s were waited"
            )
        return state

    def refuse_old(self, state: RobotState, limit: float) -> None:
        """Raise where joints are not to be acted on.

        Args:
            state: as it was read.
            limit: how old it may be [s]; without a clock of its own, `read` sees to that.

        Raises:
            StaleJoints: it is older.
            ProtectiveStop: the arm's controller stopped it.
            NotInControl: the arm does not take commands from here.
        """
        refuse_unready(state)
        age = 0.0 if self._clock is None else self._clock() - state.time
        if age > limit:
            raise StaleJoints(f"the newest joint state is {age:.3f} s old; at most {limit:g} s is acted on")

    def image(self) -> CameraImage | None:
        """Return the newest delivered frame, as `CameraLink.image`."""
        return self._camera.image()

    def command(self, joint_velocities: FloatArray) -> None:
        """Pass joint velocities (n,) [rad/s] on.

        Raises:
            RobotLost: the driver raised.
        """
        self._commanded = self.now
        answered("command", lambda: self._driver.command(joint_velocities))

    def stop(self) -> None:
        """Tell the arm to brake by itself.

        Raises:
            RobotLost: the driver raised.
        """
        answered("stop", self._driver.stop)

    def close(self) -> None:
        """End the connections to both.

        Raises:
            RobotLost: the driver or the camera raised; both were called.
        """
        try:
            answered("close", self._driver.close)
        finally:
            self._camera.close()

    def wait(self, duration: float) -> float:
        """Let time [s] pass; return how much of it did [s].

        Raises:
            RobotLost: what lets it pass raised.
        """
        before = 0.0 if self._clock is None else self._clock()
        answered("wait", lambda: self._wait(duration))
        passed = duration if self._clock is None else self._clock() - before
        self._waited += passed
        return passed


def refuse_unready(state: RobotState) -> None:
    """Raise where an arm takes no commands from here.

    Raises:
        ProtectiveStop: its controller stopped it.
        NotInControl: something else commands it, or nothing does; with the controller's reason.
    """
    if state.mode is ArmMode.READY:
        return
    if state.mode in (ArmMode.PROTECTIVE_STOP, ArmMode.EMERGENCY_STOP):
        raise ProtectiveStop(f"the arm's controller reports: {state.mode.replace('_', ' ')}")
    why = f": {state.mode_reason}" if state.mode_reason else ""
    raise NotInControl(f"the arm's controller takes no commands from this program{why}")


def answered(name: str, call: Callable[[], T]) -> T:
    """Return what a call to a robot gives.

    Raises:
        RobotLost: it raised anything but a `ServoStop`.
    """
    try:
        return call()
    except ServoStop:
        raise
    except Exception as error:
        raise RobotLost(f"the robot's {name} failed: {type(error).__name__}: {error}") from error


def checked_state(state: RobotState, dof: int) -> RobotState:
    """Return the state in arrays of its own, if it is one.

    Raises:
        InvalidData: it is none, of another number of joints, or of an unknown mode.
        NotFinite: a number is not finite.
    """
    try:
        time = float(state.time)
        positions = np.array(state.joint_positions, dtype=np.float64)
        velocities = np.array(state.joint_velocities, dtype=np.float64)
    except (AttributeError, TypeError, ValueError, OverflowError):
        raise InvalidData(f"the robot reports {spelled(state)} for its joints") from None
    if not math.isfinite(time):
        raise NotFinite(f"the robot reports time {[time]}")
    for name, value in (("joint_positions", positions), ("joint_velocities", velocities)):
        if not all_finite(value):
            raise NotFinite(f"the robot reports {name} {value.tolist()}")
    if positions.shape != (dof,) or velocities.shape != (dof,):
        raise InvalidData(
            f"the robot reports joint positions {positions.shape} and velocities {velocities.shape}; "
            f"the arm has {dof} joints"
        )
    mode = state.mode
    if not isinstance(mode, ArmMode):
        if mode not in tuple(ArmMode):
            raise InvalidData(f"the robot reports the mode {spelled(mode)}; legal: {', '.join(ArmMode)}")
        mode = ArmMode(mode)
    return RobotState(time, positions, velocities, mode, state.mode_reason)
