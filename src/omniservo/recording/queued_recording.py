"""Writing a recording by a thread of its own, so that no disk slows down the loop that leads an arm."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from queue import SimpleQueue
from threading import Event, Lock, Thread

from omniservo.errors import NotWritten
from omniservo.recording.recorded_messages import LogMessage
from omniservo.recording.run_recording import RecordedAs, RunRecording
from omniservo.recording.topics import EVENTS, IMAGE
from omniservo.ros_messages import encode
from omniservo.ros_messages.messages import TimeMessage

MOST_IMAGES = 2**26
"""So much may wait for the disk [bytes] before images are dropped: 230 of 659 × 432 px."""

MOST_WAITING = 2**28
"""So much may wait at all [bytes]: nothing is written any more where the disk is slower than joints turn."""

_WARNING = 30


class QueuedRecording(RunRecording):
    """A `RunRecording` whose calls return at once; what cannot be written stops nothing.

    What is given to it is encoded, and waits for the thread that compresses and writes it. Where much waits
    images are dropped, which is noted in the file where they are missing; other messages never are. A file
    that cannot be written any more is left as it is, readable up to there, and `failure` says why.

    Args:
        path: of the file.
        force: an existing one is replaced.
        most_images: so much may wait [bytes] before images are dropped.
        most_waiting: so much may wait at all [bytes]; with more the recording ends.

    Raises:
        InputError: as `RunRecording`, which opens the file.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        force: bool = False,
        most_images: int = MOST_IMAGES,
        most_waiting: int = MOST_WAITING,
    ) -> None:
        super().__init__(path, force=force)
        self._most_images, self._most_waiting = most_images, most_waiting
        self._queue: SimpleQueue[tuple[Callable[[], None], int] | Event | None] = SimpleQueue()
        self._lock, self._waiting = Lock(), 0
        self._failure: NotWritten | None = None
        self._missing = 0
        self._ended, self._empty = False, True
        self.images = 0
        """that were taken in"""
        self.dropped = 0
        """images that were not, because the disk was too slow"""
        self._thread = Thread(target=self._run, name="recording", daemon=True)
        self._thread.start()

    @property
    def is_empty(self) -> bool:
        """Whether nothing was given to it."""
        return self._empty

    @property
    def failure(self) -> NotWritten | None:
        """Why nothing is written any more; None: it is."""
        return self._failure

    def parameters(self, values: Mapping[str, str]) -> None:
        """See `RunRecording`."""
        self._put(partial(super().parameters, dict(values)), 0)

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """See `RunRecording`."""
        self._put(partial(super().attach, name, media_type, data), len(data))

    def note_dropped(self, images: int) -> None:
        """See `RunRecording`."""
        self._put(partial(super().note_dropped, images), 0)

    def settle(self) -> RecordedAs:
        """See `RunRecording`; waits for the disk."""
        if not self._ended:
            written = Event()
            self._queue.put(written)
            written.wait()
        return RecordedAs(self.images, self.dropped, self._failure)

    def close(self) -> None:
        """Write what waits, end the file, and give it its name unless it is not whole: then see `failure`."""
        if self._ended:
            return
        self._tell_missing(self._time * 1e-9)
        self._end()
        if self._failure is None:
            try:
                super().close()
            except NotWritten as error:
                self._failure = error
        self._leave()

    def discard(self) -> None:
        """Remove what was written; nothing is left."""
        self._end()
        self._leave()
        self.unfinished.unlink(missing_ok=True)

    def _add(self, topic: str, data: bytes, time: float, stamp: float) -> None:
        if topic == IMAGE:
            if self._waiting + len(data) > self._most_images:
                self.dropped += 1
                self._missing += 1
                return
            self.images += 1
            self._tell_missing(time)
        self._put(partial(super()._add, topic, data, time, stamp), len(data))

    def _tell_missing(self, time: float) -> None:
        """Note images that were dropped since it was noted last."""
        missing, self._missing = self._missing, 0
        if missing:
            self.note_dropped(missing)
            words = f"{missing} images are missing before this: the disk was too slow"
            said = encode(LogMessage(TimeMessage.of(time), _WARNING, "omniservo", words))
            self._put(partial(super()._add, EVENTS, said, time, time), len(said))

    def _put(self, work: Callable[[], None], size: int) -> None:
        if self._failure is not None or self._ended:
            return
        self._empty = False
        with self._lock:
            self._waiting += size
            full = self._waiting > self._most_waiting
        if full:
            self._failure = NotWritten(self.unfinished, f"{self._waiting // 2**20} MiB wait for the disk")
        self._queue.put((work, size))

    def _run(self) -> None:
        while (item := self._queue.get()) is not None:
            if isinstance(item, Event):
                item.set()
                continue
            work, size = item
            if self._failure is None:
                try:
                    work()
                except NotWritten as error:
                    self._failure = error
                except Exception as error:  # whatever it is, the arm is led on
                    reason = error.strerror if isinstance(error, OSError) else None
                    self._failure = NotWritten(self.unfinished, reason or f"{type(error).__name__}: {error}")
            with self._lock:
                self._waiting -= size

    def _end(self) -> None:
        self._ended = True
        self._queue.put(None)
        self._thread.join()

    def _leave(self) -> None:
        """Let go of the file as it is."""
        with suppress(OSError):
            self._stream.close()
