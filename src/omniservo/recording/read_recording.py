"""Reading a recording, which need not be trusted, record by record, in the order in which it was written.

Source: the MCAP format specification, version 0. Nothing is accepted beyond what the file's own bytes allow:
a record, and what a compressed chunk comes to, is bounded before it is held in memory.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TypeAlias

import zstandard

from omniservo.errors import InputError, spelled
from omniservo.files import require_file
from omniservo.recording.topics import TYPES
from omniservo.ros_messages import RosMessage, decode

MAGIC = b"\x89MCAP0\r\n"
"""The first bytes of the file."""

MOST_BYTES = 2**28
"""Largest record, and largest chunk once it is decompressed [bytes]: an image of 10⁸ pixels fits."""

MOST_CHANNELS = 10_000
"""So many topics and types are distinguished; more are no recording of ours."""

_LONGEST_NAME = 200
"""letters of a type's name that are kept: of a longer one, which is none of ours, few stay in memory"""

_WINDOW = 2**27
"""[bytes] that the decompressor looks back, at most"""

_HEAD = struct.Struct("<BQ")


@dataclass(frozen=True)
class Attachment:
    """A file inside the recording."""

    name: str
    """as it was given"""
    data: bytes
    """what it holds"""


@dataclass(frozen=True)
class Parameters:
    """Metadata."""

    name: str
    """of the whole"""
    values: dict[str, str]
    """by name"""


@dataclass(frozen=True)
class Recorded:
    """A message of one of the topics that are known here."""

    topic: str
    """one of `TYPES`"""
    time: float
    """when it became known [s]"""
    message: RosMessage
    """of the topic's type"""
    size: int
    """as it is stored [bytes]"""


Entry: TypeAlias = Attachment | Parameters | Recorded
"""What `RecordedRun` is made of."""


class RecordedRun:
    """What an MCAP file holds, of what is known here; other topics are passed over.

    A file that was cut off, as by a crash, is read up to there; ``cut`` tells so once the end is reached.

    Args:
        path: of the file.
        more: called where the file ends before its own end; whether to read on there, as of one that grows.

    Raises:
        InputError: no file, or not one of MCAP; while it is read: what is damaged, named with its place.
    """

    def __init__(self, path: str | Path, more: Callable[[], bool] = lambda: False) -> None:
        require_file(path)
        self.path = Path(path)
        """as given"""
        self._more = more
        self.cut = False
        """whether the file ends before its own end; known once it is read"""
        self._schemas: dict[int, str] = {}
        self._topics: dict[int, str] = {}
        try:
            with self.path.open("rb") as stream:
                begin = stream.read(len(MAGIC))
        except OSError as error:
            raise InputError(f"{path}: {error.strerror or error}") from None
        if begin != MAGIC:
            raise InputError(f"{path}: not an MCAP file: it begins with {spelled(begin.hex(' '))}")

    def __iter__(self) -> Iterator[Entry]:
        """Yield what the file holds, one after the other.

        Raises:
            InputError: it is damaged, or a message is not of its topic's type.
        """
        self._schemas, self._topics = {}, {}
        try:
            with self.path.open("rb") as stream:
                stream.seek(len(MAGIC))
                yield from self._entries(stream)
        except OSError as error:
            raise InputError(f"{self.path}: {error.strerror or error}") from None

    def _entries(self, stream: IO[bytes]) -> Iterator[Entry]:
        while True:
            place = stream.tell()
            head = stream.read(_HEAD.size)
            kind, size = _HEAD.unpack(head) if len(head) == _HEAD.size else (0, 0)
            if size > MOST_BYTES:
                raise self._error(place, f"a record of {size} bytes; at most {MOST_BYTES} are read")
            content = stream.read(size)
            if len(head) + len(content) < _HEAD.size + size:
                if self._more():
                    stream.seek(place)
                    continue
                self.cut = True
                return
            if kind == _DATA_END:
                return
            try:
                if kind == _CHUNK:
                    yield from self._in_chunk(content)
                else:
                    yield from self._of(kind, content)
            except (InputError, struct.error, UnicodeDecodeError, IndexError) as error:
                raise self._error(place, str(error)) from None

    def _in_chunk(self, content: bytes) -> Iterator[Entry]:
        data = _decompressed(_Fields(content))
        at = 0
        while at < len(data):
            kind, size = _HEAD.unpack_from(data, at)
            at += _HEAD.size
            if size > len(data) - at:
                raise InputError(f"a record of {size} bytes in a chunk that has {len(data) - at} left")
            yield from self._of(kind, data[at : at + size])
            at += size

    def _of(self, kind: int, content: bytes) -> Iterator[Entry]:
        fields = _Fields(content)
        if kind == _SCHEMA:
            number, name = fields.u16(), fields.text()
            self._schemas[number] = name[:_LONGEST_NAME]
        elif kind == _CHANNEL:
            self._channel(fields)
        elif kind == _MESSAGE:
            yield from self._message(fields)
        elif kind == _ATTACHMENT:
            yield _attachment(fields)
        elif kind == _METADATA:
            name = fields.text()
            yield Parameters(name, fields.texts())
        if max(len(self._schemas), len(self._topics)) > MOST_CHANNELS:
            raise InputError(f"more than {MOST_CHANNELS} topics")

    def _channel(self, fields: _Fields) -> None:
        number, schema, topic, encoding = fields.u16(), fields.u16(), fields.text(), fields.text()
        if topic not in TYPES:
            return
        wanted, given = TYPES[topic].ros_type, self._schemas.get(schema, "")
        if encoding != "cdr" or given != wanted:
            raise InputError(
                f"{topic}: {spelled(given)} as {spelled(encoding)} given; legal: {wanted} as 'cdr'"
            )
        self._topics[number] = topic

    def _message(self, fields: _Fields) -> Iterator[Recorded]:
        number, _, time, _ = fields.u16(), fields.u32(), fields.u64(), fields.u64()
        topic = self._topics.get(number)
        if topic is None:
            return
        data = fields.rest()
        try:
            message = decode(TYPES[topic], data)
        except InputError as error:
            raise InputError(f"{topic}: {error}") from None
        yield Recorded(topic, time * 1e-9, message, len(data))

    def _error(self, place: int, what: str) -> InputError:
        return InputError(f"{self.path}: damaged at byte {place}: {what}")


_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = 0x03, 0x04, 0x05, 0x06
_ATTACHMENT, _METADATA, _DATA_END = 0x09, 0x0C, 0x0F


class _Fields:
    """The fields of one record, one after the other."""

    def __init__(self, content: bytes) -> None:
        self._content, self._at = content, 0

    def take(self, size: int) -> bytes:
        """Return the next so many bytes."""
        part = self._content[self._at : self._at + size]
        if len(part) < size:
            raise InputError(f"{size} bytes claimed in a record that has {len(part)} left")
        self._at += size
        return part

    def u16(self) -> int:
        """Return a number of two bytes."""
        return int.from_bytes(self.take(2), "little")

    def u32(self) -> int:
        """Return a number of four bytes."""
        return int.from_bytes(self.take(4), "little")

    def u64(self) -> int:
        """Return a number of eight bytes."""
        return int.from_bytes(self.take(8), "little")

    def text(self) -> str:
        """Return a text with its length before it."""
        return self.take(self.u32()).decode()

    def texts(self) -> dict[str, str]:
        """Return texts by name."""
        inner, found = _Fields(self.take(self.u32())), {}
        while not inner.is_empty:
            name = inner.text()
            found[name] = inner.text()
        return found

    def rest(self) -> bytes:
        """Return what is left."""
        part, self._at = self._content[self._at :], len(self._content)
        return part

    @property
    def behind(self) -> int:
        """So many bytes were taken."""
        return self._at

    @property
    def is_empty(self) -> bool:
        """Whether nothing is left."""
        return self._at == len(self._content)

    def checksum(self, size: int) -> int:
        """Return the CRC-32 of the first so many bytes."""
        return zlib.crc32(self._content[:size])


def _attachment(fields: _Fields) -> Attachment:
    fields.take(16)  # times
    name, _ = fields.text(), fields.text()
    data = fields.take(fields.u64())
    size = fields.behind
    stated = fields.u32()
    if stated not in (0, fields.checksum(size)):
        raise InputError(f"attachment {spelled(name)}: its checksum is wrong")
    return Attachment(name, data)


def _decompressed(fields: _Fields) -> bytes:
    """Return the records of a chunk."""
    fields.take(16)  # times
    size, stated, compression = fields.u64(), fields.u32(), fields.text()
    if size > MOST_BYTES:
        raise InputError(f"a chunk of {size} bytes; at most {MOST_BYTES} are read")
    packed = fields.take(fields.u64())
    if compression not in ("", "zstd"):
        raise InputError(f"compression {spelled(compression)}; legal: 'zstd' or none")
    data = _unpacked(packed, size) if compression else packed
    if len(data) != size:
        raise InputError(f"a chunk of more or fewer bytes than the {size} that it states")
    if stated not in (0, zlib.crc32(data)):
        raise InputError("a chunk's checksum is wrong")
    return data


def _unpacked(packed: bytes, size: int) -> bytes:
    """Return what is packed, one byte more than stated at most, whatever it claims to come to."""
    try:
        with zstandard.ZstdDecompressor(max_window_size=_WINDOW).stream_reader(packed) as reader:
            return bytes(reader.read(size + 1))
    except (zstandard.ZstdError, MemoryError) as error:
        raise InputError(f"a chunk that does not decompress: {error}") from None
