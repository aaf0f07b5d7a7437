"""Packets of Universal Robots' Real-Time Data Exchange (RTDE), protocol version 2.

A packet is its length in bytes (uint16, big-endian, header included), one byte of kind, and a body. Universal
Robots publishes the protocol as the *RTDE guide*.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from enum import IntEnum

PROTOCOL_VERSION = 2

HEADER = struct.Struct(">HB")
"""length of the whole packet [bytes], kind"""

MOST_BODY = 0xFFFF - HEADER.size
"""longest body of a packet [bytes]"""

FORMATS = {
    "BOOL": "?",
    "UINT8": "B",
    "UINT32": "I",
    "UINT64": "Q",
    "INT32": "i",
    "DOUBLE": "d",
    "VECTOR3D": "3d",
    "VECTOR6D": "6d",
    "VECTOR6INT32": "6i",
    "VECTOR6UINT32": "6I",
}
"""the types of variables, as `struct` spells them"""

NOT_FOUND, IN_USE = "NOT_FOUND", "IN_USE"
"""in place of a type: the controller has no such variable; another client writes it"""


class PacketKind(IntEnum):
    """What a packet is."""

    VERSION = ord("V")
    """the protocol's version, and whether it is spoken"""
    CONTROLLER = ord("v")
    """the version of the controller's software"""
    TEXT = ord("M")
    """a message for people"""
    DATA = ord("U")
    """the values of a recipe's variables"""
    OUTPUTS = ord("O")
    """which variables the controller shall send"""
    INPUTS = ord("I")
    """which variables the client will write"""
    START = ord("S")
    """send outputs from now on"""
    PAUSE = ord("P")
    """send no more outputs"""


class PacketError(ValueError):
    """What was heard is not RTDE, or not what was agreed."""


def packet(kind: PacketKind, body: bytes = b"") -> bytes:
    """Return a packet.

    Raises:
        PacketError: the body is too long.
    """
    if len(body) > MOST_BODY:
        raise PacketError(f"a body of {len(body)} bytes; at most {MOST_BODY}")
    return HEADER.pack(HEADER.size + len(body), kind) + body


class PacketBuffer:
    """Cuts a stream of bytes into packets."""

    def __init__(self) -> None:
        self._bytes = bytearray()

    def feed(self, part: bytes) -> Iterator[tuple[PacketKind, bytes]]:
        """Yield kind and body of every packet that is whole with this part of the stream.

        Raises:
            PacketError: a length or a kind that no packet has.
        """
        self._bytes += part
        while len(self._bytes) >= HEADER.size:
            length, kind = HEADER.unpack_from(self._bytes)
            if length < HEADER.size:
                raise PacketError(f"a packet of {length} bytes")
            try:
                known = PacketKind(kind)
            except ValueError:
                raise PacketError(f"a packet of unknown kind {kind}") from None
            if len(self._bytes) < length:
                return
            body = bytes(self._bytes[HEADER.size : length])
            del self._bytes[:length]
            yield known, body


class Recipe:
    """Variables that travel together, in their order.

    Args:
        number: what the controller calls it.
        types: of the variables, keys of `FORMATS`.

    Raises:
        PacketError: an unknown type.
    """

    def __init__(self, number: int, types: Sequence[str]) -> None:
        unknown = [each for each in types if each not in FORMATS]
        if unknown:
            raise PacketError(f"variables of unknown type {unknown[0][:40]!r}")
        self.number = number
        """what the controller calls it"""
        self._widths = [int(FORMATS[each][:-1] or 1) for each in types]
        self._struct = struct.Struct(">B" + "".join(FORMATS[each] for each in types))

    def pack(self, values: Sequence[object]) -> bytes:
        """Return the body of a data packet; ``values`` are all numbers, one after the other."""
        return self._struct.pack(self.number, *values)

    def unpack(self, body: bytes) -> list[tuple[float, ...]]:
        """Return each variable's numbers.

        Raises:
            PacketError: another recipe's, or another length.
        """
        if len(body) != self._struct.size:
            raise PacketError(f"data of {len(body)} bytes; agreed were {self._struct.size}")
        number, *numbers = self._struct.unpack(body)
        if number != self.number:
            raise PacketError(f"data of recipe {number}; agreed was {self.number}")
        values, at = [], 0
        for width in self._widths:
            values.append(tuple(numbers[at : at + width]))
            at += width
        return values
