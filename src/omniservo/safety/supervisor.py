"""The supervisor: around arm and camera; nothing passes through it that could not be braked in time."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import TypeAlias, cast

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import RigidTransform

from omniservo.errors import (
    ConnectionLost,
    InputError,
    InvalidData,
    NotFinite,
    NotInControl,
    ProtectiveStop,
    ServoStop,
    SlowLoop,
    StaleImage,
    spelled,
)
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray, all_finite, finite_array, frozen
from omniservo.robots import Arm, ArmDriver, ArmMode, CameraImage, CameraSource, RobotState
from omniservo.safety.following_watch import FollowingWatch
from omniservo.safety.motion_history import MotionHistory
from omniservo.safety.motion_limits import approached, braked, slowed
from omniservo.safety.robot_link import RobotLink
from omniservo.safety.safety_options import SafetyOptions
from omniservo.safety.stoppable import Stoppable

TICK = 5e-3
"""The moving robot is checked, and its velocity ramped towards the command, so often [s]."""

_LATE = 1.5 * TICK
"""[s] A tick of braking that comes later than this brakes for all the time that has passed: joints that are
led down too slowly turn further than is kept free for it. Ticks as late as a computer's usually are do not,
so that the drives, which lag, are nearly at rest when they are let go of."""

_ROUNDING = 1e-9
"""[s] of clocks"""

Wish: TypeAlias = Callable[[RobotState], FloatArray]
"""From the joints as they are to the velocities (n,) that they should have where the camera leaves them free
[rad/s]"""


@with_field_docs
@dataclass(frozen=True, eq=False)
class Passed:
    """What became of a command."""

    wanted: FloatArray
    """(n,) as given [rad/s]"""
    target: FloatArray
    """(n,) what the robot is led to [rad/s]: slowed down where it was too fast"""
    limits: tuple[str, ...]
    """what held it back: "joint_speed", "twist"; "acceleration" where the way to it takes longer than
    the time since the command before"""


class Supervisor:
    """An `ArmDriver` and `CameraSource` around both, which cannot be commanded out of their limits.

    A command faster than joints or camera may be is slowed down as a whole; one farther from the last than
    the joints can accelerate is approached, along its own direction where that can be. Any other breach
    brakes the robot within its acceleration limits and then raises the `ServoStop` that names it: a joint
    (or the camera's centre, to first order in the braking distance) that could not be stopped inside its
    range any more, a number that is not finite, an image too old, a robot not checked, joints that do not
    do what they were commanded, a robot that does not answer. So the last command sent was one after which
    braking leads to no violation, whenever it begins within the reaction time.

    Whatever braked it latches: nothing moves it again until `release` names the reason.
    Let time pass through `wait` alone: between commands the robot is watched there, and velocities led on.

    Args:
        driver: of the arm, which is at rest.
        arm: its kinematics and limits.
        flange_T_camera: how the camera sits on it.
        camera: on the arm's flange; one object may be driver and camera. None (deprecated): the driver is.
        wait: lets the given time [s] pass: ``time.sleep`` on a real robot.
        clock: on which joints and images are stamped [s]: ``time.monotonic`` on a real robot, whose time does
            not stand still between two waits; None: time passes in ``wait`` alone.
        options: see SafetyOptions.
        found: (n,) joints in which the robot was found, for the options' workspace [rad]; None: as it stands.

    Raises:
        InputError: the driver has another number of joints than the arm, or there is no camera.
        ServoStop: it does not answer, or not with finite numbers.
    """

    def __init__(
        self,
        driver: ArmDriver,
        arm: Arm,
        flange_T_camera: RigidTransform,
        *,
        camera: CameraSource | None = None,
        wait: Callable[[float], None],
        clock: Callable[[], float] | None = None,
        options: SafetyOptions | None = None,
        found: FloatArray | None = None,
    ) -> None:
        self.arm = arm
        """as given"""
        self.flange_T_camera = flange_T_camera
        """as given"""
        self.options = options or SafetyOptions()
        """as given"""
        self.stopped: ServoStop | None = None
        """what the robot was stopped for, and has not been released from"""
        camera = _camera_of(driver) if camera is None else camera
        self._link = RobotLink(driver, camera, wait, arm.dof, clock)
        self._sent, self._target = np.zeros(arm.dof), np.zeros(arm.dof)
        self._carried: Callable[[RobotState], FloatArray] | None = None
        self._carried_time = 0.0
        try:
            state = self._link.read()
        except InvalidData as error:
            raise InputError(str(error)) from error
        self._seen_time = self._command_time = self._image_time = state.time
        self._sent_time = self._link.now
        self.history = MotionHistory(state, self.options.least_acceleration * arm.joint_acceleration)
        """what was sent and what was measured"""
        self.found = frozen(state.joint_positions) if found is None else found
        """(n,) joints in which the robot was found [rad]"""
        base_T_found = arm.base_T_flange(self.found) * flange_T_camera
        self._stoppable = Stoppable(arm, flange_T_camera, base_T_found, self.options)
        self._following = FollowingWatch(arm, self.options)

    def read(self) -> RobotState:
        """Return the newest reading of the joints.

        Raises:
            ServoStop: the arm does not answer, or not with finite numbers; it has been braked.
        """
        with self._braking():
            return self._seen_state()

    def image(self) -> CameraImage | None:
        """Return the newest delivered frame; None before the first one arrives.

        Raises:
            ServoStop: the camera does not answer, or not with a frame; the arm has been braked.
        """
        with self._braking():
            image = self._link.image()
            if image is not None:
                self._image_time = image.earliest
            return image

    def release(self, reason: str) -> None:
        """Let the robot move again after a stop.

        Args:
            reason: what it was stopped for: `ServoStop.reason` of `stopped`.

        Raises:
            InputError: it was not stopped, or for another reason.
            ServoStop: the robot does not answer, or not with finite numbers.
        """
        if self.stopped is None or reason != self.stopped.reason:
            legal = "the robot is not stopped" if self.stopped is None else f"legal: {self.stopped.reason!r}"
            raise InputError(f"reason: {spelled(reason)} given; {legal}")
        self.stopped = None
        self._following = FollowingWatch(self.arm, self.options)  # what it knows of the drives was before
        with self._braking():
            state = self._seen_state()
            self.history.begin(state)
            self._sent_time = self._link.now

    def command(self, joint_velocities: npt.ArrayLike) -> Passed:
        """Move with these joint velocities (n,) [rad/s], or as near to them as the limits allow.

        Returns:
            What became of them.

        Raises:
            ServoStop: nothing near them can be sent; the robot stands still by then.
            InputError: wrong shape; the robot stands still by then.
        """
        with self._braking():
            self._refuse_stopped()
            self._carried = None
            return self._commanded(self._checked_command(joint_velocities), self._seen_state())

    def carry(self, twist: npt.ArrayLike, wish: Wish | None = None) -> Passed:
        """Move the camera with this twist (6,) from now on: linear [m/s], angular [rad/s], camera frame.

        The joint velocities of it are found anew every `TICK`, by `Arm.joint_velocities`:
        those of one configuration, held for the time between two images, lead the camera astray where the
        Jacobian changes fast, as it does near singular configurations.

        Args:
            twist: of the camera.
            wish: where joints go in what the twist leaves free, and near singularities; None: nowhere.

        Returns:
            What became of the first velocities.

        Raises:
            ServoStop: no velocities for it can be sent; the robot stands still by then.
            InputError: wrong shape, NaN or infinity; the robot stands still by then.
        """
        with self._braking():
            self._refuse_stopped()
            wanted = finite_array("twist", twist, (6,))

            def carried(state: RobotState) -> FloatArray:
                own = None if wish is None else wish(state)
                return self.arm.joint_velocities(state.joint_positions, wanted, self.flange_T_camera, own)

            state = self._seen_state()
            passed = self._commanded(self._checked_command(carried(state)), state)
            self._carried, self._carried_time = carried, state.time
            return passed

    @property
    def time(self) -> float:
        """This instant on the clock of joints and images [s]; without a clock, that of the last reading."""
        return self._link.now

    @property
    def moving(self) -> bool:
        """Whether it was sent velocities, or is led to some."""
        return bool(np.count_nonzero(self._sent) or np.count_nonzero(self._target))

    @property
    def sent(self) -> FloatArray:
        """(n,) the velocities sent last [rad/s]."""
        return self._sent.copy()

    def wait(self, duration: float) -> float:
        """Let time [s] pass; the moving robot is watched meanwhile. Return how much passed [s].

        Raises:
            ServoStop: the motion may not go on; the robot stands still by then.
        """
        left = duration
        while left > 1e-9:
            with self._braking():
                left -= self._link.wait(min(left, TICK))
            self.watch()
        return duration - left

    def watch(self) -> None:
        """Look at the moving robot, and lead it on; to be called every `TICK` by who does not `wait`.

        Raises:
            ServoStop: the motion may not go on; the robot stands still by then.
        """
        if not self.moving:
            return
        with self._braking():
            state = self._seen_state()
            if self._carried is not None and state.time - self._carried_time > TICK - _ROUNDING:
                self._carried_time = state.time
                self._target = self._slowed(state, self._checked_command(self._carried(state)))[0]
            self._pass(state, self._led_on())

    def hold(self) -> None:
        """Tell the standing robot to stand: proof that commands arrive, and food for its watchdog.

        Raises:
            ServoStop: it does not stand, does not answer, or was stopped before.
        """
        with self._braking():
            self._refuse_stopped()
            state = self._seen_state()
            self._link.refuse_old(state, self.options.joint_age)
            self._following.check(self.history)
            self._sent_time, self._seen_time = self._link.now, state.time
            self._link.command(np.zeros(self.arm.dof))

    def stop(self, reason: ServoStop | None = None) -> None:
        """Brake every joint as fast as its acceleration limit allows; the robot stands still on return.

        Args:
            reason: what for; nothing moves it again until it is released. None: it may move on.

        Raises:
            ServoStop: what arm or driver say instead; nothing else can be done from here.
        """
        self.stopped = self.stopped or reason
        self._target, self._carried = np.zeros(self.arm.dof), None
        self._sent_time = self._link.now  # what was held until now is not braked for at one stroke
        # After a silence of this program the arm may rest by its own watchdog: it is not led from there.
        obeys = not isinstance(reason, ProtectiveStop | NotInControl)
        try:
            try:
                while obeys and self._sent.any() and not self._silent:
                    self._link.wait(TICK)
                    obeys = not self._silent and self._brake_on()
            finally:
                self._sent, self._sent_time = np.zeros(self.arm.dof), self._link.now
                self._link.stop()
        except ServoStop as failed:
            self.stopped = self.stopped or failed
            raise
        finally:  # last: who is told of it may raise
            self.history.sent(self._sent, self._sent_time)

    def close(self) -> None:
        """Brake, then end the connections to arm and camera.

        Raises:
            ServoStop: as `stop`; or one of the two does not answer.
        """
        try:
            self.stop()
        finally:
            self._link.close()

    @property
    def _silent(self) -> bool:
        """Whether the arm was sent nothing for so long that its own watchdog may have stopped it."""
        return self._link.silence > self.options.reaction

    def _brake_on(self) -> bool:
        """Lead the joints one tick nearer to rest; return whether the arm takes commands at all."""
        with suppress(ServoStop):
            if self._seen_state().mode is not ArmMode.READY:
                return False
        passed = self._link.now - self._sent_time
        elapsed = TICK  # also where the clock says nothing
        if 0.0 < passed < TICK or passed > _LATE:
            elapsed = min(passed, self.options.reaction)
        self._sent_time = self._link.now
        self._sent = braked(self._sent, self.arm.joint_acceleration * elapsed)
        self._link.command(self._sent)
        self.history.sent(self._sent, self._sent_time)
        return True

    @contextmanager
    def _braking(self) -> Iterator[None]:
        """Brake before any error goes on, and let nothing move any more."""
        try:
            yield
        except BaseException as error:
            try:
                self.stop(as_stop(error))
            except ServoStop as failed:
                error.add_note(f"braking: {failed}")
            raise

    def _refuse_stopped(self) -> None:
        if self.stopped is not None:
            raise type(self.stopped)(
                f"stopped before: {self.stopped}; release({self.stopped.reason!r}) lets it move again"
            )

    def _seen_state(self) -> RobotState:
        state = self._link.read()
        self.history.measured(state)
        return state

    def _commanded(self, wanted: FloatArray, state: RobotState) -> Passed:
        """Begin to lead the robot to these velocities."""
        self._target, limits = self._slowed(state, wanted)
        period = state.time - self._command_time
        change = np.abs(self._target - self._sent)
        if np.count_nonzero(change > self.arm.joint_acceleration * period):
            limits = (*limits, "acceleration")
        self._command_time = state.time
        self._pass(state, self._led_on())
        return Passed(frozen(wanted), frozen(self._target), limits)

    def _checked_command(self, joint_velocities: npt.ArrayLike) -> FloatArray:
        try:
            wanted = np.array(joint_velocities, dtype=np.float64)
        except (TypeError, ValueError, OverflowError):
            raise InputError("joint_velocities: no array of numbers given") from None
        if wanted.shape != (self.arm.dof,):
            raise InputError(f"joint_velocities: shape {wanted.shape} given; ({self.arm.dof},) is needed")
        if not all_finite(wanted):
            j = int(np.argmin(np.isfinite(wanted)))
            raise NotFinite(f"command for {self.arm.joint_names[j]}: {wanted[j]} rad/s; it was not sent")
        return wanted

    def _slowed(self, state: RobotState, wanted: FloatArray) -> tuple[FloatArray, tuple[str, ...]]:
        """Return the command within the speeds of joints and camera, and what slowed it."""
        limits: tuple[str, ...] = ()
        within = slowed(wanted, self.arm.joint_speed)
        if within is not wanted:
            limits = ("joint_speed",)
        twist = self.arm.camera_jacobian(state.joint_positions, self.flange_T_camera) @ within
        excess = max(
            math.hypot(*twist[:3]) / self.options.max_linear_speed,
            math.hypot(*twist[3:]) / self.options.max_angular_speed,
        )
        return (within / excess, (*limits, "twist")) if excess > 1.0 else (within, limits)

    def _led_on(self) -> FloatArray:
        """Return the velocities of now on the way from those sent last to the target."""
        elapsed = min(max(self._link.now - self._sent_time, 0.0), TICK)
        return approached(self._sent, self._target, self.arm.joint_acceleration * elapsed)

    def _pass(self, state: RobotState, velocities: FloatArray) -> None:
        """Send velocities, unless the robot could not be braked in time after them."""
        moving = np.count_nonzero(self._sent)  # any() takes several times as long
        if moving and state.time - self._seen_time > self.options.reaction:
            raise SlowLoop(
                f"the moving robot was not looked at for {state.time - self._seen_time:.3f} s; "
                f"at most {self.options.reaction:g} s is allowed"
            )
        self._link.refuse_old(state, self.options.joint_age)
        if np.count_nonzero(self._target):  # to rest it may be led without images
            self._refuse_stale(state)
        self._stoppable.check(state, velocities)
        self._following.check(self.history)
        if not all_finite(velocities):  # whatever went wrong on the way here
            raise NotFinite(f"the command {velocities.tolist()} rad/s; it was not sent")
        self._link.refuse_old(state, self.options.joint_age)  # this process may have slept on the way here
        self._seen_time = state.time
        self._sent, self._sent_time = velocities, self._link.now  # first: it may move though the call fails
        self._link.command(velocities)
        self.history.sent(velocities, self._sent_time)

    def _refuse_stale(self, state: RobotState) -> None:
        age = state.time - self._image_time
        if not abs(age) <= self.options.image_age:
            raise StaleImage(
                f"the newest image is {age:.3f} s old; at most {self.options.image_age:g} s is acted on"
            )


def _camera_of(driver: ArmDriver) -> CameraSource:
    """Return the driver itself, as before arm and camera were two."""
    if not hasattr(driver, "image"):
        raise InputError("camera: none given, and the arm's driver has no images")
    warnings.warn("Supervisor(…, camera=…) takes the camera's source now", DeprecationWarning, stacklevel=3)
    return cast(CameraSource, driver)


def as_stop(error: BaseException) -> ServoStop:
    """Return what an error stops the robot for."""
    if isinstance(error, ServoStop):
        return error
    if isinstance(error, SystemExit):
        return ConnectionLost("the program that commands the arm ends")
    kind = InvalidData if isinstance(error, InputError) else ServoStop
    return kind(f"{type(error).__name__}: {error}")
