"""How an arm's controller is commanded over ROS 2: trajectories that end at rest, velocities, or a twist."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from omniservo.errors import InputError, spelled
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray, finite_number
from omniservo.hardware.ros2.reference_motion import ReferenceMotion
from omniservo.robots import Arm
from omniservo.ros_messages.messages import (
    DurationMessage,
    Float64MultiArrayMessage,
    HeaderMessage,
    JointTrajectoryMessage,
    JointTrajectoryPointMessage,
    RosMessage,
    TimeMessage,
    TwistMessage,
    TwistStampedMessage,
    Vector3Message,
)

HOLD = 0.05
"""A commanded velocity is kept for so long [s] after the last command, then braked."""

_APART = 1e-4
"""Points of a trajectory are no nearer to one another [s]."""


class ArmCommands(Protocol):
    """A topic on which an arm is commanded."""

    @property
    def topic(self) -> str:
        """Its name, "/joint_trajectory_controller/joint_trajectory"."""
        ...

    @property
    def kind(self) -> type[RosMessage]:
        """The messages' type."""
        ...

    @property
    def ends_by_itself(self) -> bool:
        """Whether every message alone brings the arm to rest; else rest is sent step by step."""
        ...

    def proven_watchdog(self, joint_names: tuple[str, ...]) -> float:
        """Return how long after the last command the arm itself begins to stop [s].

        Raises:
            InputError: it would never do so, or the joints are not those that are commanded.
        """
        ...

    def message(
        self, motion: ReferenceMotion, now: float, stamp: float, measured: FloatArray, names: tuple[str, ...]
    ) -> RosMessage:
        """Return the message of a motion.

        Args:
            motion: what to do.
            now: `time.monotonic()` [s].
            stamp: the same instant on the robot's clock [s]; 0: not known.
            measured: the joints (n,) [rad].
            names: theirs.
        """
        ...


@with_field_docs
@dataclass(frozen=True)
class TrajectoryCommands:
    """`joint_trajectory_controller`: each message ends at rest, so the arm stops when messages do."""

    topic: str = "/joint_trajectory_controller/joint_trajectory"
    """the controller's topic"""
    stamped: bool = True
    """whether trajectories begin at their time stamp, on the clock of the joint states; else on arrival, as
    those of `stop` always do"""
    kind: type[RosMessage] = field(default=JointTrajectoryMessage, init=False)
    """the messages' type"""
    ends_by_itself: bool = field(default=True, init=False)
    """every message alone brings the arm to rest"""

    def proven_watchdog(self, joint_names: tuple[str, ...]) -> float:
        """Return after what time the trajectory begins to brake [s]."""
        return HOLD

    def message(
        self, motion: ReferenceMotion, now: float, stamp: float, measured: FloatArray, names: tuple[str, ...]
    ) -> JointTrajectoryMessage:
        """Return the rest of the motion as up to four points, the last one at rest."""
        times, last = [now], max(motion.end, now + HOLD)
        for time in (motion.begin + motion.hold, motion.end):
            if times[-1] + _APART < time < last - _APART:
                times.append(time)
        points = [
            JointTrajectoryPointMessage(*motion.at(time), time_from_start=DurationMessage.of(time - now))
            for time in (*times, last)
        ]
        # A stop begins on arrival: by a clock that was set back meanwhile it would lie in the future.
        header = HeaderMessage(TimeMessage.of(stamp if self.stamped and motion.hold > 0.0 else 0.0))
        return JointTrajectoryMessage(header, list(names), points)


@with_field_docs
@dataclass(frozen=True)
class VelocityCommands:
    """`forward_velocity_controller` of ros2_control, which keeps the last velocity for ever.

    Raises:
        InputError: a field that is not legal, named.
    """

    controller_joints: tuple[str, ...]
    """the controller's parameter ``joints``: its messages have no names, and no topic shows their order"""
    watchdog: float | None = None
    """something else stops the arm so long after the last command [s]; None, nothing does: refused"""
    topic: str = "/forward_velocity_controller/commands"
    """the controller's topic"""
    kind: type[RosMessage] = field(default=Float64MultiArrayMessage, init=False)
    """the messages' type"""
    ends_by_itself: bool = field(default=False, init=False)
    """no message ends a motion by itself"""

    def __post_init__(self) -> None:
        if self.watchdog is not None:
            finite_number("watchdog", self.watchdog, above=0.0, maximum=1.0)

    def proven_watchdog(self, joint_names: tuple[str, ...]) -> float:
        """Return the stated watchdog [s].

        Raises:
            InputError: none is stated, or the controller's joints are others.
        """
        if sorted(self.controller_joints) != sorted(joint_names):
            raise InputError(
                f"controller_joints: {spelled(self.controller_joints)} given; "
                f"legal: the joints {', '.join(joint_names)} in the controller's order"
            )
        if self.watchdog is None:
            raise InputError(
                f"watchdog: none given for {self.topic}; forward_velocity_controller of ros2_control keeps "
                "the last velocity for ever when commands end (ros2_controllers issue 95), so an arm whose "
                "program dies drives on. Use TrajectoryCommands, or state after what time [s] something of "
                "your own stops it"
            )
        return self.watchdog

    def message(
        self, motion: ReferenceMotion, now: float, stamp: float, measured: FloatArray, names: tuple[str, ...]
    ) -> Float64MultiArrayMessage:
        """Return the velocities of now in the controller's order."""
        velocities = dict(zip(names, motion.at(now)[1], strict=True))
        return Float64MultiArrayMessage(data=np.array([velocities[name] for name in self.controller_joints]))


@with_field_docs
@dataclass(frozen=True)
class TwistCommands:
    """MoveIt Servo, commanded by the flange's twist in m/s and rad/s (its ``command_in_type: speed_units``).

    Raises:
        InputError: a field that is not legal, named.
    """

    arm: Arm
    """turns joint velocities into the twist of its flange, which must be MoveIt's end-effector link"""
    frame: str = "base_link"
    """name of the arm's base frame, MoveIt's planning frame"""
    watchdog: float | None = None
    """MoveIt Servo's ``incoming_command_timeout`` [s]; None is refused"""
    topic: str = "/servo_node/delta_twist_cmds"
    """the servo node's topic"""
    kind: type[RosMessage] = field(default=TwistStampedMessage, init=False)
    """the messages' type"""
    ends_by_itself: bool = field(default=False, init=False)
    """no message ends a motion by itself"""

    def __post_init__(self) -> None:
        if self.watchdog is not None:
            finite_number("watchdog", self.watchdog, above=0.0, maximum=1.0)

    def proven_watchdog(self, joint_names: tuple[str, ...]) -> float:
        """Return the stated watchdog [s].

        Raises:
            InputError: none is stated, or the arm has another number of joints.
        """
        if len(joint_names) != self.arm.dof:
            raise InputError(f"joint_names: {len(joint_names)} given; {self.arm.name} has {self.arm.dof}")
        if self.watchdog is None:
            raise InputError(
                f"watchdog: none given for {self.topic}; whether MoveIt Servo stops when commands end is its "
                "parameter incoming_command_timeout, which no topic shows and which wrong time stamps defeat "
                "(moveit2 issue 772). State it [s] once you saw it work, or use TrajectoryCommands"
            )
        return self.watchdog

    def message(
        self, motion: ReferenceMotion, now: float, stamp: float, measured: FloatArray, names: tuple[str, ...]
    ) -> TwistStampedMessage:
        """Return the twist of the flange's origin, in axes of the base."""
        flange, jacobian = self.arm.locate(measured)
        axes: FloatArray = flange[:, :3]
        twist = jacobian @ motion.at(now)[1]
        linear, angular = (Vector3Message(*(axes @ part).tolist()) for part in (twist[:3], twist[3:]))
        header = HeaderMessage(TimeMessage.of(stamp), self.frame)
        return TwistStampedMessage(header, TwistMessage(linear, angular))
