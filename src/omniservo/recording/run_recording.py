"""Writing a run as an MCAP file, while it goes on."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import chain, count
from pathlib import Path
from types import TracebackType
from typing import BinaryIO

from mcap.writer import Writer

from omniservo.errors import NotWritten
from omniservo.files import writable
from omniservo.geometry.arrays import finite_number
from omniservo.recording.topics import DROPPED, FORMAT, PARAMETERS, TYPES
from omniservo.ros_messages import RosMessage, definition, encode

_CHUNK = 2**17
"""[bytes] of messages that are compressed and written together: what a crash loses, or one image"""

_LIBRARY = "omniservo"

_LATEST = 1.8e10
"""[s]; 2⁶⁴ ns are a little more"""


@dataclass(frozen=True)
class RecordedAs:
    """How much of a run its recording has."""

    images: int
    """that were taken in; 0: not counted, all of them"""
    dropped: int
    """images that were not: the disk was too slow"""
    failure: NotWritten | None
    """why nothing more was written; None: everything was"""

    @property
    def notice(self) -> str:
        """What a person must know of it; empty: nothing."""
        if self.failure is not None:
            return f"the recording ends early, the run went on: {self.failure}"
        if self.dropped:
            whole = self.images + self.dropped
            return f"the recording lacks {self.dropped} of {whole} images: the disk was too slow"
        return ""


class RunRecording:
    """An MCAP file of ROS 2 messages (profile "ros2", CDR, compressed by Zstandard) that grows with a run.

    Until `close` it is ``NAME.unfinished.mcap`` beside the path (``NAME-2.unfinished.mcap`` where there is
    one that another process writes or a killed one left): whatever ends the process, what was written before
    can be read, up to the last `_CHUNK`. `close` adds the index and gives the file its name.

    Times are seconds of any one clock; they are stored in whole nanoseconds.

    Args:
        path: of the file.
        force: an existing one is replaced.

    Raises:
        InputError: the path exists and ``force`` is False, or its folder does not; `NotWritten`.
    """

    def __init__(self, path: str | Path, *, force: bool = False) -> None:
        self.path = Path(path)
        """as given"""
        writable(self.path, force=force)
        self._channels: dict[str, int] = {}
        self._schemas: dict[type[RosMessage], int] = {}
        self._time = 0
        self.unfinished, self._stream = _begun(self.path)
        """where it is until it is closed"""
        self._writer = Writer(self._stream, chunk_size=_CHUNK)
        self._writer.start(profile="ros2", library=_LIBRARY)
        with suppress(OSError):  # said with the first message; whoever watches the file finds what it is
            self._stream.flush()

    def parameters(self, values: Mapping[str, str]) -> None:
        """Note what was run, under the name `PARAMETERS`; the format's version is added."""
        with self._writing():
            self._writer.flush()
            self._writer.add_metadata(PARAMETERS, {"format": FORMAT, **values})

    def note_dropped(self, images: int) -> None:
        """Note, under the name `DROPPED`, that so many images are missing here."""
        with self._writing():
            self._writer.flush()
            self._writer.add_metadata(DROPPED, {"images": str(images)})

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Put a file in, at the time of the last message.

        Args:
            name: of the file, with / between its folders.
            media_type: such as "application/json".
            data: what it holds.
        """
        with self._writing():
            self._writer.flush()
            self._writer.add_attachment(0, self._time, name, media_type, data)

    def write(self, topic: str, message: RosMessage, time: float, *, stamp: float | None = None) -> None:
        """Add a message.

        Args:
            topic: one of `TYPES`.
            message: of the topic's type.
            time: when it became known [s].
            stamp: what it is about [s]; None: the same.

        Raises:
            InputError: a value does not fit its field, or a time is none.
        """
        self._add(topic, encode(message), time, time if stamp is None else stamp)

    def _add(self, topic: str, data: bytes, time: float, stamp: float) -> None:
        """Add a message that is encoded."""
        if topic not in self._channels:
            self._channels[topic] = self._writer.register_channel(topic, "cdr", self._schema(TYPES[topic]))
        self._time = nanoseconds(time)
        with self._writing():
            self._writer.add_message(self._channels[topic], self._time, data, nanoseconds(stamp))

    def settle(self) -> RecordedAs:
        """Have written what was given so far, and say how much of it was."""
        return RecordedAs(0, 0, None)

    def close(self) -> None:
        """End the file and give it its name; a second call does nothing.

        Raises:
            InputError: it cannot be written (`NotWritten`).
        """
        if self._stream.closed:
            return
        try:
            with self._stream as stream:
                self._writer.finish()
                stream.flush()
                os.fsync(stream.fileno())
            self.unfinished.replace(self.path)
        except OSError as error:
            raise NotWritten(self.path, error.strerror or str(error)) from None

    def discard(self) -> None:
        """Remove what was written; nothing is left."""
        with suppress(OSError):  # of what a full disk did not take
            self._stream.close()
        self.unfinished.unlink(missing_ok=True)

    def __enter__(self) -> RunRecording:
        """Return the recording, which is closed where the block ends, however it ends."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close it."""
        self.close()

    def _schema(self, kind: type[RosMessage]) -> int:
        if kind not in self._schemas:
            text = definition(kind).encode()
            self._schemas[kind] = self._writer.register_schema(kind.ros_type, "ros2msg", text)
        return self._schemas[kind]

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """Give the operating system what is compressed by then: it outlives the process."""
        try:
            yield
            self._stream.flush()
        except OSError as error:
            raise NotWritten(self.unfinished, error.strerror or str(error)) from None


def _begun(path: Path) -> tuple[Path, BinaryIO]:
    """Begin the file that a recording is in until it is closed; none that is there is written into.

    Raises:
        NotWritten: it cannot be begun.
    """
    stems = chain((path.stem,), (f"{path.stem}-{number}" for number in count(2)))
    while True:
        unfinished = path.with_name(f"{next(stems)}.unfinished.mcap")
        try:
            return unfinished, unfinished.open("wb" if unfinished.is_char_device() else "xb")
        except FileExistsError:
            continue
        except OSError as error:
            raise NotWritten(unfinished, error.strerror or str(error)) from None


def nanoseconds(seconds: float) -> int:
    """Return a time in whole nanoseconds; MCAP has none before 0.

    Raises:
        InputError: not finite, or later than MCAP has.
    """
    return max(round(finite_number("time", seconds, maximum=_LATEST) * 1e9), 0)
