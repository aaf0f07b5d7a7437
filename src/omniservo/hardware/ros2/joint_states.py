"""Joint states of an arm out of the messages of a topic: by name, on this machine's clock."""

from __future__ import annotations

from collections import deque

import numpy as np

from omniservo.errors import InputError, NotFinite, did_you_mean, spelled
from omniservo.geometry.arrays import FloatArray
from omniservo.hardware.clock_map import ClockMap
from omniservo.robots import RobotState
from omniservo.ros_messages.messages import JointStateMessage

DIFFERENCE = 0.02
"""Velocities that no message has are differences over so much time [s]."""

_MOST_NAMES = 256


class JointStates:
    """Turns messages into states; a message without all joints is passed over.

    Several publishers may share the topic, each with joints of its own: a gripper beside an arm.

    Args:
        joint_names: the wanted joints, in the order of the arrays.
    """

    def __init__(self, joint_names: tuple[str, ...]) -> None:
        self._names = joint_names
        self.clock = ClockMap()
        self.stamped = False
        """whether the messages have stamps; else they count from their arrival"""
        self.heard: dict[str, None] = {}
        """all names that were heard, in order"""
        self.passed_over = ""
        """what was wrong with the last message that names one of the joints; empty if nothing"""
        self._stamp = -np.inf
        self._recent: deque[tuple[float, FloatArray]] = deque(maxlen=64)
        self._order: tuple[tuple[str, ...], list[int]] = (), []

    def take(self, message: JointStateMessage, arrival: float) -> RobotState | None:
        """Return the state that a message makes known, or None.

        Args:
            message: of the topic.
            arrival: `time.monotonic()` when it came [s].

        Raises:
            ClockFault: the sender's clock was set.
            NotFinite: a position is not finite, or some velocities are not: nothing may be commanded by them.
        """
        order = self._order_of(message)
        if order is None:
            return None
        self.passed_over = ""
        stamp = message.header.stamp.seconds
        self.stamped = stamp > 0.0
        time = self.clock.monotonic(stamp, arrival) if self.stamped else arrival
        if self.stamped and stamp <= self._stamp:
            return None
        self._stamp = stamp
        positions = message.position[order]
        velocities: FloatArray | None = message.velocity[order] if len(message.velocity) else None
        if velocities is None or np.isnan(velocities).all():  # so ros2_control says that there are none
            velocities = self._differences(time, positions)
        known = np.array([positions, 0.0 * positions if velocities is None else velocities])
        if not np.isfinite(known).all():
            j = int(np.argmin(np.isfinite(known).all(axis=0)))
            raise NotFinite(f"{self._names[j]!r} is at {known[0, j]} rad, turning by {known[1, j]} rad/s")
        return None if velocities is None else RobotState(time, positions, velocities)

    def missing(self) -> str:
        """Return in words which joints were not heard, and which were."""
        missing = [name for name in self._names if name not in self.heard]
        known = ", ".join(list(self.heard)[:32])
        if not missing:
            return f"joint_names: never all in one message; heard: {known}"
        guess = did_you_mean(missing[0], self.heard)
        return f"joint_names: the arm has no {', '.join(map(repr, missing))}{guess}; it has {known}"

    def _order_of(self, message: JointStateMessage) -> list[int] | None:
        names = tuple(message.name)
        if not names or names != self._order[0]:
            if len(self.heard) < _MOST_NAMES:
                self.heard.update(dict.fromkeys(names))
            lacking = [name for name in self._names if name not in names]
            if lacking:
                if len(lacking) < len(self._names):
                    self.passed_over = f"no {spelled(lacking[0])} among {spelled(names)}"
                return None
            twice = next((name for name in self._names if names.count(name) > 1), None)
            if twice is not None:
                self.passed_over = f"{twice!r} twice among {spelled(names)}"
                return None
            self._order = names, [names.index(name) for name in self._names]
        for field, count in (("position", len(message.position)), ("velocity", len(message.velocity))):
            if count != len(names) and (count or field == "position"):
                self.passed_over = f"{count} numbers in {field} for {len(names)} names"
                return None
        return self._order[1]

    def _differences(self, time: float, positions: FloatArray) -> FloatArray | None:
        """Return velocities from positions of the last `DIFFERENCE`, or of the last two messages."""
        while len(self._recent) > 1 and self._recent[1][0] <= time - DIFFERENCE:
            self._recent.popleft()
        known = self._recent[0] if self._recent else None
        if known is not None and time - known[0] < 1e-4:
            return None
        self._recent.append((time, positions))
        return None if known is None else (positions - known[1]) / (time - known[0])


def refuse_names(joint_names: tuple[str, ...]) -> None:
    """Refuse what are no names of joints.

    Raises:
        InputError: none, not text, or one twice.
    """
    if not joint_names or not all(isinstance(name, str) and name for name in joint_names):
        raise InputError(f"joint_names: {spelled(joint_names)} given; legal: the names of the arm's joints")
    if len(set(joint_names)) != len(joint_names):
        raise InputError(f"joint_names: {spelled(joint_names)} given; each name once")
