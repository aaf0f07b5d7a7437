"""The supervisor: a `Robot` around a robot, through which nothing passes that could not be braked in time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import RigidTransform

from omniservo.errors import InputError, JointLimit, NotFinite, SlowLoop, StaleImage, WorkspaceLimit
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray, finite_array, frozen
from omniservo.robots import Arm, CameraImage, Robot, RobotState
from omniservo.robots.twist_matrix import twist_matrix
from omniservo.safety.motion_limits import approached, braked, slowed, stopping_distance
from omniservo.safety.safety_options import SafetyOptions

TICK = 5e-3
"""The moving robot is looked at, and its velocity led on towards the command, so often [s]."""

_ROUNDING = 1e-9
"""[s] of clocks"""

RUNAWAY = 1.25
"""A joint measured to turn faster than this times its speed limit does not do what it is told."""


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
    """A robot that cannot be commanded out of its limits.

    A command faster than joints or camera may be is slowed down as a whole; one farther from the last than
    the joints can accelerate is approached, along its own direction where that can be. Any other breach
    brakes the robot within its acceleration limits and then raises the `ServoStop` that names it: a joint
    (or the camera's centre, to first order in the braking distance) that could not be stopped inside its
    range any more, a number that is not finite, an image too old, a robot not looked at. So the last command
    sent was one after which braking leads to no violation, whenever it begins within the reaction time.

    Let time pass through `wait` alone: between commands the robot is watched there, and velocities led on.

    Args:
        robot: at rest.
        arm: its kinematics and limits.
        flange_T_camera: how the camera sits on it.
        wait: lets the given time [s] pass: ``time.sleep`` on a real robot.
        options: see SafetyOptions.

    Raises:
        NotFinite: the robot's joints are not finite.
    """

    def __init__(
        self,
        robot: Robot,
        arm: Arm,
        flange_T_camera: RigidTransform,
        *,
        wait: Callable[[float], None],
        options: SafetyOptions | None = None,
    ) -> None:
        self.arm = arm
        """as given"""
        self.flange_T_camera = flange_T_camera
        """as given"""
        self.options = options or SafetyOptions()
        """as given"""
        self._robot, self._wait = robot, wait
        self._sent, self._target = np.zeros(arm.dof), np.zeros(arm.dof)
        self._carried: Callable[[RobotState], FloatArray] | None = None
        self._carried_time = 0.0
        state = _checked(robot.read(), arm.dof)
        self._sent_time = self._seen_time = self._command_time = self._image_time = state.time
        base_T_initial = arm.base_T_flange(state.joint_positions) * flange_T_camera
        self._initial_T_base = base_T_initial.inv().as_matrix()[:3]
        self._flange_T_camera = flange_T_camera.as_matrix()

    def read(self) -> RobotState:
        """Return the joints as they are now.

        Raises:
            NotFinite: they are no finite numbers; the robot has been braked.
        """
        with self._braking():
            return self._seen_state()

    def image(self) -> CameraImage | None:
        """Return the newest delivered frame; None before the first one arrives."""
        image = self._robot.image()
        if image is not None:
            self._image_time = image.time
        return image

    def command(self, joint_velocities: npt.ArrayLike) -> Passed:
        """Move with these joint velocities (n,) [rad/s], or as near to them as the limits allow.

        Returns:
            What became of them.

        Raises:
            ServoStop: nothing near them can be sent; the robot stands still by then.
            InputError: wrong shape; the robot stands still by then.
        """
        with self._braking():
            self._carried = None
            return self._commanded(self._checked_command(joint_velocities), self._seen_state())

    def carry(self, twist: npt.ArrayLike, wish: Wish | None = None) -> Passed:
        """Move the camera with this twist (6,) (linear [m/s], angular [rad/s]; camera frame) until told more.

        The joint velocities of it are found anew every `TICK`, by `Arm.joint_velocities`:
        those of one posture, held for the time between two images, lead the camera astray where the
        Jacobian changes fast, as it does near singular postures.

        Args:
            twist: of the camera.
            wish: where an arm of seven joints is to go besides; None: nowhere.

        Returns:
            What became of the first velocities.

        Raises:
            ServoStop: no velocities for it can be sent; the robot stands still by then.
            InputError: wrong shape, NaN or infinity; the robot stands still by then.
        """
        with self._braking():
            wanted = finite_array("twist", twist, (6,))

            def carried(state: RobotState) -> FloatArray:
                own = None if wish is None else wish(state)
                return self.arm.joint_velocities(state.joint_positions, wanted, self.flange_T_camera, own)

            state = self._seen_state()
            passed = self._commanded(self._checked_command(carried(state)), state)
            self._carried, self._carried_time = carried, state.time
            return passed

    def wait(self, duration: float) -> None:
        """Let time [s] pass; the moving robot is watched meanwhile.

        Raises:
            ServoStop: the motion may not go on; the robot stands still by then.
        """
        left = duration
        while left > 1e-9:
            part = min(left, TICK)
            self._wait(part)
            left -= part
            if self._sent.any() or self._target.any():
                with self._braking():
                    state = self._seen_state()
                    if self._carried is not None and state.time - self._carried_time > TICK - _ROUNDING:
                        self._carried_time = state.time
                        self._target = self._slowed(state, self._checked_command(self._carried(state)))[0]
                    self._pass(state, self._led_on(state))

    def stop(self) -> None:
        """Brake every joint as fast as its acceleration limit allows; the robot stands still on return."""
        self._target, self._carried = np.zeros(self.arm.dof), None
        try:
            while self._sent.any():
                self._wait(TICK)
                now = self._robot.read().time
                # Of a clock that stands or is no number, the time waited for is taken.
                elapsed = now - self._sent_time if 0.0 < now - self._sent_time < TICK else TICK
                self._sent = braked(self._sent, self.arm.joint_acceleration * elapsed)
                self._sent_time = now if np.isfinite(now) else self._sent_time
                self._robot.command(self._sent)
        finally:
            self._sent = np.zeros(self.arm.dof)
            self._robot.stop()

    @contextmanager
    def _braking(self) -> Iterator[None]:
        """Brake before any error goes on."""
        try:
            yield
        except BaseException:
            self.stop()
            raise

    def _seen_state(self) -> RobotState:
        return _checked(self._robot.read(), self.arm.dof)

    def _commanded(self, wanted: FloatArray, state: RobotState) -> Passed:
        """Begin to lead the robot to these velocities."""
        self._target, limits = self._slowed(state, wanted)
        period = state.time - self._command_time
        if (np.abs(self._target - self._sent) > self.arm.joint_acceleration * period).any():
            limits = (*limits, "acceleration")
        self._command_time = state.time
        self._pass(state, self._led_on(state))
        return Passed(frozen(wanted), frozen(self._target), limits)

    def _checked_command(self, joint_velocities: npt.ArrayLike) -> FloatArray:
        try:
            wanted = np.array(joint_velocities, dtype=np.float64)
        except (TypeError, ValueError, OverflowError):
            raise InputError("joint_velocities: no array of numbers given") from None
        if wanted.shape != (self.arm.dof,):
            raise InputError(f"joint_velocities: shape {wanted.shape} given; ({self.arm.dof},) is needed")
        if not np.isfinite(wanted).all():
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
        speeds = np.array([np.linalg.norm(twist[:3]), np.linalg.norm(twist[3:])])
        bounds = np.array([self.options.max_linear_speed, self.options.max_angular_speed])
        excess = float((speeds / bounds).max())
        return (within / excess, (*limits, "twist")) if excess > 1.0 else (within, limits)

    def _led_on(self, state: RobotState) -> FloatArray:
        """Return the velocities of now on the way from those sent last to the target."""
        elapsed = min(max(state.time - self._sent_time, 0.0), TICK)
        return approached(self._sent, self._target, self.arm.joint_acceleration * elapsed)

    def _pass(self, state: RobotState, velocities: FloatArray) -> None:
        """Send velocities, unless the robot could not be braked in time after them."""
        moving = self._sent.any()
        if moving and state.time - self._seen_time > self.options.reaction:
            raise SlowLoop(
                f"the moving robot was not looked at for {state.time - self._seen_time:.3f} s; "
                f"at most {self.options.reaction:g} s is allowed"
            )
        self._refuse_stale(state)
        self._refuse_runaway(state)
        self._refuse_range(state, velocities)
        self._refuse_workspace(state, velocities)
        if not np.isfinite(velocities).all():  # whatever went wrong on the way here
            raise NotFinite(f"the command {velocities.tolist()} rad/s; it was not sent")
        self._seen_time = state.time
        self._robot.command(velocities)
        self._sent, self._sent_time = velocities, state.time

    def _refuse_stale(self, state: RobotState) -> None:
        age = state.time - self._image_time
        if not abs(age) <= self.options.image_age:
            raise StaleImage(
                f"the newest image is {age:.3f} s old; at most {self.options.image_age:g} s is acted on"
            )

    def _refuse_runaway(self, state: RobotState) -> None:
        share = np.abs(state.joint_velocities) / self.arm.joint_speed
        if (share > RUNAWAY).any():
            j = int(np.argmax(share))
            raise JointLimit(
                f"{self.arm.joint_names[j]} turns with "
                f"{np.rad2deg(abs(state.joint_velocities[j])):.0f} deg/s; "
                f"at most {np.rad2deg(self.arm.joint_speed[j]):.0f} deg/s was allowed"
            )

    def _refuse_range(self, state: RobotState, velocities: FloatArray) -> None:
        """Stop when a joint that goes outwards could not be braked inside its range any more."""
        arm, options, measured = self.arm, self.options, state.joint_velocities
        worst = np.where(velocities > 0.0, np.maximum(velocities, measured), np.minimum(velocities, measured))
        end = state.joint_positions + stopping_distance(worst, arm.joint_acceleration, options.reaction)
        low, high = (
            arm.joint_range[:, 0] + options.joint_reserve,
            arm.joint_range[:, 1] - options.joint_reserve,
        )
        leaving = ((velocities > 0.0) & (end > high)) | ((velocities < 0.0) & (end < low))
        if leaving.any():
            j = int(np.argmax(leaving))
            raise JointLimit(
                f"{arm.joint_names[j]} at {np.rad2deg(state.joint_positions[j]):.1f} deg, turning with "
                f"{np.rad2deg(worst[j]):.1f} deg/s, would stop at {np.rad2deg(end[j]):.1f} deg; its range is "
                f"{np.rad2deg(arm.joint_range[j, 0]):.1f} … {np.rad2deg(arm.joint_range[j, 1]):.1f} deg, "
                f"{np.rad2deg(options.joint_reserve):.1f} deg of it held back"
            )

    def _refuse_workspace(self, state: RobotState, velocities: FloatArray) -> None:
        """Stop when the camera's centre, going outwards, could not be braked inside the workspace."""
        box = self.options.workspace
        if box is None or not velocities.any():
            return
        base_T_flange, jacobian = self.arm.locate(state.joint_positions)
        initial_R_base = self._initial_T_base[:, :3]
        base_T_camera = base_T_flange @ self._flange_T_camera
        to_camera = twist_matrix(self.flange_T_camera)[:3]
        along = initial_R_base @ base_T_camera[:, :3] @ (to_camera @ jacobian)
        ways = along * stopping_distance(velocities, self.arm.joint_acceleration, 0.0)
        centre = initial_R_base @ base_T_camera[:, 3] + self._initial_T_base[:, 3]
        speed = along @ velocities
        # Braking, the joints do not come to rest together: on the way only some may have moved.
        reached = centre + speed * self.options.reaction
        lowest = reached + np.minimum(ways, 0.0).sum(axis=1)
        highest = reached + np.maximum(ways, 0.0).sum(axis=1)
        leaving = ((speed < 0.0) & (lowest < box[0])) | ((speed > 0.0) & (highest > box[1]))
        if leaving.any():
            i = int(np.argmax(leaving))
            end = lowest[i] if speed[i] < 0.0 else highest[i]
            raise WorkspaceLimit(
                f"the camera at {'xyz'[i]} = {centre[i]:.3f} m, moving with {speed[i]:.3f} m/s, could stop "
                f"only at {end:.3f} m; its workspace is {box[0, i]:g} … {box[1, i]:g} m"
            )


def _checked(state: RobotState, dof: int) -> RobotState:
    """Return the state if all of it is finite."""
    for name, value in (
        ("time", np.array([state.time])),
        ("joint_positions", state.joint_positions),
        ("joint_velocities", state.joint_velocities),
    ):
        if not np.isfinite(value).all():
            raise NotFinite(f"the robot reports {name} {np.asarray(value).tolist()}")
    if np.shape(state.joint_positions) != (dof,) or np.shape(state.joint_velocities) != (dof,):
        raise InputError(f"the robot reports {len(state.joint_positions)} joints; the arm has {dof}")
    return state
