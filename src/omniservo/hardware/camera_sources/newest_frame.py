"""A camera source that reads in a thread of its own, and keeps the newest frame."""

from __future__ import annotations

import time
from collections.abc import Callable
from threading import Event, Thread

from omniservo.errors import ClockFault, InputError, InvalidData, NotFinite, ServoStop
from omniservo.geometry.arrays import finite_number
from omniservo.hardware.camera_sources.frame_reader import (
    EndOfFrames,
    Frame,
    FrameLoss,
    FrameReader,
    StampClock,
    UnlikeFrame,
)
from omniservo.hardware.camera_sources.frame_times import FrameTimes, is_own_clock
from omniservo.hardware.camera_sources.settling import Settling
from omniservo.hardware.clock_map import ClockMap
from omniservo.robots import CameraImage

AGAIN = 0.5
"""So long after a loss the source is opened again, and again [s]."""


TRIAL = 5.0
"""Stamps that prove to be none within so long after opening are left aside; later that is a fault [s]."""


class NewestFrame:
    """A `CameraSource`: `image` gives the newest frame, whose age its time stamp tells.

    Frames that a buffer held when the source was opened are dropped until their age settles. A live source
    that is lost is opened again until it is back, in the same size; meanwhile `trouble` says why.

    Args:
        name: what messages call it.
        open_reader: opens the source; raises FrameLoss where that fails.
        patience: in which the first usable frame must come [s].

    Raises:
        InputError: it cannot be opened, or gives no frame in time.
    """

    def __init__(
        self,
        name: str,
        open_reader: Callable[[], FrameReader],
        *,
        patience: float = 10.0,
    ) -> None:
        self.name = name
        """what messages call it"""
        self._open = open_reader
        self._size: tuple[int, int] | None = None
        patience = finite_number("patience", patience, above=0.0)
        self._image: CameraImage | None = None
        self._fault: ServoStop | None = None
        self._times: FrameTimes | None = None
        self._settled = False
        self.trouble: str | None = None
        """why no frames come at the moment; None: they come, or are over"""
        self.dropped = 0
        """frames that were left out, old ones after opening included"""
        self.notices: list[str] = []
        """what is assumed, a sentence each"""
        try:
            self._reader = open_reader()
        except FrameLoss as error:
            raise InputError(f"{name}: {error}") from None
        self._closing = Event()
        self._thread = Thread(target=self._run, name=f"camera {name}", daemon=True)
        self._thread.start()
        self._await_first(patience)

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) of the frames [px]."""
        return self._size or (0, 0)

    @property
    def over(self) -> bool:
        """Whether no frame comes after the newest: what was recorded is at its end."""
        return not self._thread.is_alive()

    @property
    def notice(self) -> str | None:
        """What is assumed, in one line; None where nothing is."""
        return "; ".join(self.notices) or None

    @property
    def clock(self) -> ClockMap | None:
        """From the frames' stamps to this machine's time; None: stamps of this machine, or none usable."""
        return None if self._times is None else self._times.clock

    def image(self) -> CameraImage | None:
        """Return the newest frame, whatever its age, without waiting.

        Raises:
            InvalidData: frames have another size or form than before.
            ClockFault: the clock that stamps the frames was set.
        """
        if self._fault is not None:
            raise type(self._fault)(str(self._fault))
        return self._image

    def close(self) -> None:
        """Let go of the camera; a second call does nothing."""
        self._closing.set()
        self._reader.hang_up()
        self._thread.join()
        self._reader.close()

    def _await_first(self, patience: float) -> None:
        end = time.monotonic() + patience
        while self._image is None:
            words = str(self._fault) if self._fault is not None else None
            if words is None and not self._thread.is_alive():
                words = f"{self.name}: no frame in it"
            if words is None and time.monotonic() > end:
                why = f": {self.trouble}" if self.trouble else ""
                words = f"{self.name}: no frame in {patience:g} s{why}"
            if words is not None:
                self.close()
                raise InputError(words)
            time.sleep(1e-3)

    def _run(self) -> None:
        """Read, and open again what was lost, until the source is closed or over."""
        try:
            while not self._closing.is_set():
                try:
                    self._read_all()
                except FrameLoss as error:
                    self.trouble = str(error)
                    self._open_again()
        except EndOfFrames:
            pass
        except UnlikeFrame as error:
            self._fault = InvalidData(f"{self.name}: {error}")
        except (ClockFault, NotFinite) as error:
            self._fault = type(error)(f"{self.name}: {error}")
        except Exception as error:  # whatever it was: without this thread there are no frames
            self._fault = InvalidData(f"{self.name}: {error!r}")

    def _open_again(self) -> None:
        self._reader.close()
        while not self._closing.wait(AGAIN):
            try:
                self._reader = self._open()
            except FrameLoss as error:
                self.trouble = str(error)
                continue
            return

    def _read_all(self) -> None:
        """Read frames from one opening until it is lost."""
        settling, times, began = Settling(), None, 0.0
        before: list[tuple[float | None, float]] = []
        while not self._closing.is_set():
            frame = self._reader.read()
            self._check_size(frame)
            stamp, arrival = frame.stamp, frame.arrival
            if self._reader.is_live and not settling.add(arrival, stamp):
                before.append((stamp, arrival))
                self.dropped += 1
                continue
            if times is None:
                times, began = self._begin(frame, settling, before), arrival
            try:
                exposed = times.exposure(stamp, arrival)
            except ClockFault:
                if arrival - began > TRIAL:
                    raise
                times = FrameTimes(None)
                self.notices = [f"time stamps that do not keep time are left aside; {times.notice}"]
                exposed = times.exposure(stamp, arrival)
            if exposed is None or (self._image is not None and exposed[0] <= self._image.time):
                self.dropped += 1
                continue
            self._image, self.trouble = CameraImage(exposed[0], frame.pixels, exposed[1]), None
            self._times = times

    def _begin(
        self, frame: Frame, settling: Settling, before: list[tuple[float | None, float]]
    ) -> FrameTimes:
        """Decide what the frames of one opening tell of their times."""
        clock: StampClock | None = self._reader.clock
        unusable = self._reader.is_live and not settling.stamps_are_times
        if unusable or (clock == StampClock.OWN and not is_own_clock(frame.stamp, frame.arrival)):
            clock = None
        try:
            times = FrameTimes(clock, before)
        except (ClockFault, NotFinite):
            times = FrameTimes(None, before)
        notices = [times.notice] if times.notice else []
        if settling.gave_up:
            notices.append("frames' age did not settle after opening; they may be older than they seem")
        self.notices = notices
        return times

    def _check_size(self, frame: Frame) -> None:
        height, width = frame.pixels.shape
        if self._size is None:
            self._size = width, height
        elif (width, height) != self._size:
            raise UnlikeFrame(
                f"frames of {width}×{height} pixels; {self._size[0]}×{self._size[1]} were expected"
            )
