"""What the two processes say to each other: one message a packet, of fixed binary form."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from omniservo.errors import InvalidData, ServoStop
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray
from omniservo.robots import ArmMode

VERSION = 1
"""of all messages; another one is refused"""

LARGEST = 4096
"""No message is longer [bytes]."""

_HEAD = struct.Struct("<BB")
_SEEN = struct.Struct("<d")
_MOVE = struct.Struct("<IBBddd")
_STATUS = struct.Struct("<BBBBIIddd")
_MODES = tuple(ArmMode)
LIMITS = ("joint_speed", "twist", "acceleration")
"""what may have slowed a command, a bit each"""


class Kind(IntEnum):
    """What a message is."""

    ARM = 1
    """prove that commands arrive, and be ready for motion"""
    SEEN = 2
    """an image was delivered"""
    MOVE = 3
    """twist or joint velocities"""
    STOP = 4
    """brake"""
    RELEASE = 5
    """a stop is over"""
    CLOSE = 6
    """brake, and end"""
    STATUS = 16
    """what the drive is doing"""


class Phase(IntEnum):
    """What the drive is doing."""

    CONNECTING = 0
    """opening the arm's driver"""
    LISTENING = 1
    """joints are read; nothing is commanded"""
    ARMED = 2
    """zeros are sent, and the arm was seen to stand by them"""
    MOVING = 3
    """commands are followed until their deadlines"""
    BRAKING = 4
    """on the way to rest"""
    STOPPED = 5
    """for a reason that must be released"""


@with_field_docs
@dataclass(frozen=True, eq=False)
class DriveCommand:
    """A command and its times, all of this machine's monotonic clock."""

    number: int
    """counts on from command to command"""
    acts_at: float
    """when it is meant to act [s]"""
    seen_at: float
    """when the newest image that it rests on was exposed, at the earliest [s]"""
    valid_until: float
    """the arm is braked then, unless another came [s]"""
    twist: FloatArray | None
    """(6,) of the camera, linear [m/s] and angular [rad/s]; None: joint velocities"""
    joints: FloatArray | None
    """(n,) joint velocities, or those wished for beside the twist [rad/s]"""

    def packed(self) -> bytes:
        """Return it as a message."""
        parts = [part for part in (self.twist, self.joints) if part is not None]
        head = _HEAD.pack(VERSION, Kind.MOVE) + _MOVE.pack(
            self.number, self.twist is not None, self.joints is not None,
            self.acts_at, self.seen_at, self.valid_until,
        )  # fmt: skip
        return head + b"".join(part.astype("<f8").tobytes() for part in parts)

    @classmethod
    def of(cls, body: bytes, dof: int) -> DriveCommand:
        """Return what a message's body says.

        Raises:
            InvalidData: it is no such body.
        """
        try:
            number, has_twist, has_joints, acts_at, seen_at, valid_until = _MOVE.unpack_from(body)
            numbers = np.frombuffer(body, dtype="<f8", offset=_MOVE.size).astype(np.float64)
        except (struct.error, ValueError) as error:
            raise InvalidData(f"a command that cannot be read: {error}") from None
        if len(numbers) != 6 * has_twist + dof * has_joints or not (has_twist or has_joints):
            raise InvalidData(f"a command of {len(numbers)} numbers for {dof} joints")
        if not np.isfinite([acts_at, seen_at, valid_until]).all():
            raise InvalidData(f"a command of the times {acts_at}, {seen_at}, {valid_until} s")
        twist, joints = numbers[: 6 * has_twist], numbers[6 * has_twist :]
        own = joints if has_joints else None
        return cls(number, acts_at, seen_at, valid_until, twist if has_twist else None, own)


@with_field_docs
@dataclass(frozen=True, eq=False)
class Status:
    """What the drive process says 200 times a second, and after every command."""

    phase: Phase
    """what the drive is doing"""
    mode: ArmMode
    """of the arm"""
    number: int
    """of the last command that was dealt with"""
    limits: tuple[str, ...]
    """what slowed it"""
    late_ticks: int
    """so many ticks were more than 5 ms late since the drive began"""
    time: float
    """when this was said [s]"""
    state_time: float
    """of the newest joint reading [s]; NaN before the first"""
    lateness: float
    """of the last tick [s]"""
    joints: FloatArray
    """(5, n): positions [rad], velocities, those sent, those aimed for, those of the last command [rad/s]"""
    reason: str = ""
    """what the drive was stopped for"""
    words: str = ""
    """likewise, in words"""

    def packed(self) -> bytes:
        """Return it as a message."""
        bits = sum(1 << k for k, name in enumerate(LIMITS) if name in self.limits)
        head = _HEAD.pack(VERSION, Kind.STATUS) + _STATUS.pack(
            self.phase, _MODES.index(self.mode), bits, self.joints.shape[1], self.number, self.late_ticks,
            self.time, self.state_time, self.lateness,
        )  # fmt: skip
        text = f"{self.reason}\0{self.words}" if self.reason else ""
        return (head + self.joints.astype("<f8").tobytes() + text.encode(errors="replace"))[:LARGEST]

    @classmethod
    def of(cls, body: bytes) -> Status:
        """Return what a message's body says.

        Raises:
            InvalidData: it is no such body.
        """
        try:
            phase, mode, bits, dof, number, late, said, read, lateness = _STATUS.unpack_from(body)
            size = _STATUS.size + 5 * dof * 8
            joints = np.frombuffer(body[_STATUS.size : size], dtype="<f8").astype(np.float64).reshape(5, dof)
            reason, _, words = body[size:].decode(errors="replace").partition("\0")
            limits = tuple(name for k, name in enumerate(LIMITS) if bits >> k & 1)
            return cls(
                Phase(phase), _MODES[mode], number, limits, late, said, read, lateness, joints, reason, words
            )
        except (struct.error, ValueError, IndexError) as error:
            raise InvalidData(f"a status that cannot be read: {error}") from None


def packed(kind: Kind, text: str = "") -> bytes:
    """Return a message that is its kind and a text."""
    return (_HEAD.pack(VERSION, kind) + text.encode(errors="replace"))[:LARGEST]


def packed_seen(time: float) -> bytes:
    """Return the message that an image was delivered, exposed at ``time`` at the earliest [s]."""
    return _HEAD.pack(VERSION, Kind.SEEN) + _SEEN.pack(time)


def seen_time(body: bytes) -> float:
    """Return what `packed_seen` packed.

    Raises:
        InvalidData: it is no such body, or no finite number.
    """
    if len(body) != _SEEN.size or not np.isfinite(_SEEN.unpack(body)[0]):
        raise InvalidData("an image of no time")
    return float(_SEEN.unpack(body)[0])


def opened(message: bytes) -> tuple[Kind, bytes]:
    """Return a message's kind and body.

    Raises:
        InvalidData: of another version, or of no known kind.
    """
    if len(message) < _HEAD.size or message[0] != VERSION:
        raise InvalidData(f"a message of version {message[:1].hex()}; this program speaks {VERSION}")
    try:
        return Kind(message[1]), message[_HEAD.size :]
    except ValueError:
        raise InvalidData(f"a message of the kind {message[1]}") from None


def stop_named(reason: str, words: str) -> ServoStop:
    """Return the stop of this name."""
    kinds: list[type[ServoStop]] = [ServoStop]
    for kind in kinds:
        kinds += kind.__subclasses__()
    stop = next((kind for kind in kinds if kind.reason == reason), ServoStop)(words)
    stop.reason = reason
    return stop
