"""CDR, the form in which DDS and ROS 2 send messages: little-endian, version 1, read within bounds.

Source: OMG, *DDS Interoperability Wire Protocol* (RTPS) 2.5, §10, and CORBA 3, §9.3. A number is aligned to
its own size, counted from behind the four bytes that say which form it is. What a message claims counts only
as far as its bytes go, so that no message takes more memory than a small multiple of its own length.
"""

from __future__ import annotations

import struct
from typing import Any, TypeVar

import numpy as np

from omniservo.errors import InputError, spelled
from omniservo.ros_messages.messages import Numbers, RosMessage, Scalar

M = TypeVar("M", bound=RosMessage)

MOST_ITEMS = 10_000
"""Longest list of names or of trajectory points that is read or written."""

_HEADER = b"\x00\x01\x00\x00"
_FORMS = {
    0x0000: "big-endian CDR",
    0x0002: "a parameter list, big-endian",
    0x0003: "a parameter list",
    0x0006: "XCDR 2, big-endian",
    0x0007: "XCDR 2",
    0x0008: "delimited XCDR 2, big-endian",
    0x0009: "delimited XCDR 2",
    0x000A: "a parameter list of XCDR 2, big-endian",
    0x000B: "a parameter list of XCDR 2",
}
_MOST_PADDING = 3


def encode(message: RosMessage) -> bytes:
    """Return a message's bytes, with the four in front that name their form.

    Raises:
        InputError: a value does not fit its field, which is named.
    """
    writer = _Writer(message.ros_type)
    writer.message(message, "")
    return b"".join(writer.parts)


def decode(kind: type[M], data: bytes) -> M:
    """Return the message of a type that the bytes hold.

    Bytes of images are not copied: they are a view of ``data``.

    Raises:
        InputError: another form than little-endian CDR, cut short, longer than the type, a length beyond
            the end, or text that is not UTF-8; the message's type and field are named.
    """
    reader = _Reader(kind.ros_type, data)
    message: M = reader.message(kind, "")
    rest = len(data) - reader.at
    if rest > _MOST_PADDING:
        raise InputError(f"{kind.ros_type}: {rest} bytes are left over: a message of another type?")
    return message


class _Writer:
    def __init__(self, name: str) -> None:
        self.name = name
        self.parts: list[bytes] = [_HEADER]
        self.at = 0

    def message(self, message: RosMessage, place: str) -> None:
        for field, kind, many in message.wire_fields():
            value = getattr(message, field)
            try:
                (self.items if many else self.value)(kind, value, f"{place}.{field}")
            except InputError:
                raise
            except (struct.error, TypeError, ValueError, AttributeError, OverflowError) as error:
                raise InputError(f"{self.name}{place}.{field}: {spelled(value)} given: {error}") from None

    def value(self, kind: Any, value: Any, place: str) -> None:
        if isinstance(kind, Scalar):
            self.put(struct.pack("<" + kind.code, value), kind.size)
        elif isinstance(kind, Numbers):
            self.numbers(kind, value, place)
        elif kind is str:
            text = value.encode()
            if b"\0" in text:
                raise InputError(f"{self.name}{place}: {spelled(value)} given; no text has a NUL")
            self.length(len(text) + 1)
            self.put(text + b"\0", 1)
        else:
            if not isinstance(value, kind):
                raise InputError(f"{self.name}{place}: {spelled(value)} given; legal: {kind.__name__}")
            self.message(value, place)

    def items(self, kind: Any, values: Any, place: str) -> None:
        if len(values) > MOST_ITEMS:
            raise InputError(f"{self.name}{place}: {len(values)} items given; at most {MOST_ITEMS} are sent")
        self.length(len(values))
        for value in values:
            self.value(kind, value, place)

    def numbers(self, kind: Numbers, value: Any, place: str) -> None:
        array = np.frombuffer(value, np.uint8) if isinstance(value, bytes) else np.asarray(value)
        if kind.dtype == "u1" and array.dtype != np.uint8:  # others wrap around
            wrong = array[~((array >= 0) & (array <= 255))]
            if len(wrong):
                raise InputError(f"{self.name}{place}: {wrong[0]} given; legal: 0 to 255")
        array = np.ascontiguousarray(array, dtype=kind.dtype).reshape(-1)
        if kind.count is None:
            self.length(len(array))
        elif len(array) != kind.count:
            raise InputError(f"{self.name}{place}: {len(array)} numbers given; legal: {kind.count}")
        if len(array):
            self.put(array.data.cast("B"), array.itemsize)

    def length(self, count: int) -> None:
        self.put(struct.pack("<I", count), 4)

    def put(self, data: Any, size: int) -> None:
        gap = -self.at % size
        if gap:
            self.parts.append(bytes(gap))
        self.parts.append(data)
        self.at += gap + len(data)


class _Reader:
    def __init__(self, name: str, data: bytes) -> None:
        self.name, self.data, self.at = name, data, 4
        if len(data) < len(_HEADER):
            raise InputError(f"{name}: {len(data)} bytes are no message")
        form = int.from_bytes(data[:2], "big")
        if form != 1:
            known = _FORMS.get(form, f"form 0x{form:04x}")
            raise InputError(f"{name}: sent as {known}; legal: little-endian CDR, version 1")

    def message(self, kind: type[RosMessage], place: str) -> Any:
        values = []
        for field, of, many in kind.wire_fields():
            inner = f"{place}.{field}"
            if many:
                count = self.length(inner)
                self.refuse_many(count, inner)
                values.append([self.value(of, inner) for _ in range(count)])
            else:
                values.append(self.value(of, inner))
        return kind(*values)

    def value(self, kind: Any, place: str) -> Any:
        if isinstance(kind, Scalar):
            at = self.skip(kind.size, kind.size, place)
            if kind.code == "?" and self.data[at] > 1:
                raise InputError(f"{self.name}{place}: {self.data[at]} is no truth value; legal: 0, 1")
            return struct.unpack_from("<" + kind.code, self.data, at)[0]
        if isinstance(kind, Numbers):
            count = self.length(place) if kind.count is None else kind.count
            dtype = np.dtype(kind.dtype)
            at = self.skip(count * dtype.itemsize, dtype.itemsize, place) if count else 0
            array = np.frombuffer(self.data, dtype, count, at)
            return array if dtype.itemsize == 1 else array.astype(np.float64)
        if kind is str:
            return self.text(place)
        return self.message(kind, place)

    def text(self, place: str) -> str:
        size = self.length(place)
        at = self.skip(size, 1, place)
        raw = bytes(self.data[at : at + size])
        if raw.find(b"\0") != size - 1:
            raise InputError(f"{self.name}{place}: a text that does not end with its first NUL")
        try:
            return raw[:-1].decode()
        except UnicodeDecodeError:
            raise InputError(f"{self.name}{place}: a text that is not UTF-8") from None

    def refuse_many(self, count: int, place: str) -> None:
        if count > MOST_ITEMS:
            raise InputError(f"{self.name}{place}: {count} items claimed; at most {MOST_ITEMS} are read")

    def length(self, place: str) -> int:
        at = self.skip(4, 4, place)
        return int(struct.unpack_from("<I", self.data, at)[0])

    def skip(self, size: int, alignment: int, place: str) -> int:
        """Return where so many bytes begin, and go behind them."""
        begin = self.at + (4 - self.at) % alignment
        if begin + size > len(self.data):
            raise InputError(
                f"{self.name}{place}: {size} bytes claimed at byte {begin}; the message has {len(self.data)}"
            )
        self.at = begin + size
        return begin
