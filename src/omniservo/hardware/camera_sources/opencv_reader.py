"""Frames by OpenCV: cameras of this machine (V4L2), network streams (RTSP), video files."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Event, Lock
from typing import Any

import cv2
import numpy as np

from omniservo.hardware.camera_sources.frame_reader import (
    EndOfFrames,
    Frame,
    FrameLoss,
    StampClock,
    UnlikeFrame,
)

_LOW_DELAY = {"OPENCV_FFMPEG_CAPTURE_OPTIONS": "rtsp_transport;tcp|fflags;nobuffer|flags;low_delay"}
_SILENT = {"OPENCV_FFMPEG_LOGLEVEL": "-8"}  # read when FFmpeg is used first
_ENVIRONMENT = Lock()

SILENCE = 5.0
"""A stream that gives nothing for so long is lost [s]."""


class OpencvReader:
    """A `FrameReader` of what is being filmed now: a camera of this machine, or a network stream.

    Stamps are OpenCV's: of a camera the kernel's, on this machine's clock; of a stream the sender's.

    Args:
        source: a device's number or path, or a URL.
        patience: for opening [s]; a camera of this machine takes as long as it takes.

    Raises:
        FrameLoss: it cannot be opened.
    """

    is_live = True
    """see FrameReader"""

    def __init__(self, source: int | str, patience: float) -> None:
        is_stream = isinstance(source, str) and "://" in source
        self.clock = StampClock.SENDER if is_stream else StampClock.OWN
        """see FrameReader"""
        if is_stream:
            waits = [
                cv2.CAP_PROP_OPEN_TIMEOUT_MSEC,
                1e3 * patience,
                cv2.CAP_PROP_READ_TIMEOUT_MSEC,
                1e3 * SILENCE,
            ]
            with _opening(**_LOW_DELAY):
                self._capture = cv2.VideoCapture(source, cv2.CAP_FFMPEG, [int(each) for each in waits])
        else:
            device = Path(f"/dev/video{source}" if isinstance(source, int) else source)
            if not device.exists():
                raise FrameLoss(f"there is no {device}")
            with _opening():
                self._capture = cv2.VideoCapture(str(device), cv2.CAP_V4L2)
            self._capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        if not self._capture.isOpened():
            raise FrameLoss("cannot be opened: nobody there, in use, or no format that OpenCV reads")

    def read(self) -> Frame:
        """See FrameReader."""
        found, pixels = self._capture.read()
        arrival = time.monotonic()
        if not found:
            raise FrameLoss("no more frames")
        stamp = float(self._capture.get(cv2.CAP_PROP_POS_MSEC)) / 1e3
        return Frame(grey(pixels), stamp if stamp > 0.0 else None, arrival)

    def hang_up(self) -> None:
        """See FrameReader; OpenCV waits on, for `SILENCE` at most."""

    def close(self) -> None:
        """See FrameReader."""
        self._capture.release()


class VideoReader:
    """A `FrameReader` of a video file, which gives each frame when it is due, from now on.

    Raises:
        FrameLoss: it is no video that OpenCV reads.
    """

    clock = StampClock.OWN
    """see FrameReader"""
    is_live = False
    """see FrameReader"""

    def __init__(self, path: Path) -> None:
        with _opening():
            self._capture = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
        if not self._capture.isOpened():
            raise FrameLoss("not a video that OpenCV reads")
        rate = float(self._capture.get(cv2.CAP_PROP_FPS))
        self._period = 1.0 / rate if rate > 0.0 else 0.0
        self._pace = Pace()
        self._last = -1.0

    def read(self) -> Frame:
        """See FrameReader."""
        found, pixels = self._capture.read()
        if not found:
            raise EndOfFrames
        stated = float(self._capture.get(cv2.CAP_PROP_POS_MSEC)) / 1e3
        self._last = stated if stated > self._last else self._last + (self._period or 0.04)
        due = self._pace.wait(self._last)
        return Frame(grey(pixels), due, time.monotonic())

    def hang_up(self) -> None:
        """See FrameReader."""
        self._pace.end()

    def close(self) -> None:
        """See FrameReader."""
        self._capture.release()


class Pace:
    """Lets recorded frames come when they are due: the first now, the others as their times have it."""

    def __init__(self) -> None:
        self._begin: float | None = None
        self._ended = Event()

    def wait(self, at: float) -> float:
        """Wait until what was recorded ``at`` [s] is due; return that instant of this machine's clock [s].

        Raises:
            FrameLoss: `end` was called.
        """
        if self._begin is None:
            self._begin = time.monotonic() - at
        due = self._begin + at
        if self._ended.wait(max(due - time.monotonic(), 0.0)):
            raise FrameLoss("closed")
        return due

    def end(self) -> None:
        """Let no one wait any more."""
        self._ended.set()


def grey(pixels: Any) -> np.ndarray[Any, np.dtype[np.uint8]]:
    """Return grey values of what OpenCV read.

    Raises:
        UnlikeFrame: neither grey nor colours of 8 bits.
    """
    pixels = np.asarray(pixels)
    if pixels.dtype != np.uint8 or pixels.ndim not in (2, 3):
        raise UnlikeFrame(
            f"frames of {pixels.dtype}, {pixels.ndim} dimensions; 8 bits, grey or colour, are read"
        )
    if pixels.ndim == 3:
        pixels = cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY) if pixels.shape[2] == 3 else pixels[:, :, 0]
    return np.ascontiguousarray(pixels)


@contextmanager
def _opening(**variables: str) -> Iterator[None]:
    """Open with these variables in the environment, but for those that the user has there.

    OpenCV and FFmpeg write nothing: what is wrong is one message, ours.
    """
    with _ENVIRONMENT:
        ours = {name: value for name, value in (_SILENT | variables).items() if name not in os.environ}
        os.environ.update(ours)
        level = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_ERROR)
        try:
            yield
        finally:
            cv2.utils.logging.setLogLevel(level)
            for name in ours:
                del os.environ[name]
