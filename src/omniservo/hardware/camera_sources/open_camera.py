"""Opens a camera by its URI."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from urllib.parse import SplitResult, urlsplit

from omniservo.errors import InputError, spelled
from omniservo.geometry.arrays import finite_number
from omniservo.hardware.camera_sources.folder_reader import FolderReader
from omniservo.hardware.camera_sources.frame_reader import FrameReader
from omniservo.hardware.camera_sources.mjpeg_reader import MjpegReader
from omniservo.hardware.camera_sources.newest_frame import NewestFrame
from omniservo.hardware.camera_sources.opencv_reader import OpencvReader, VideoReader

LEGAL = "v4l2:0, 0, /dev/video0, rtsp://…, http://… (MJPEG), a video file, folder:PATH, folder:PATH?rate=30"


def open_camera(uri: str | int, *, patience: float = 10.0) -> NewestFrame:
    """Open a camera, and wait for its first frame.

    ==========================  =============================================================================
    ``v4l2:0``, 0, /dev/video0  a camera of this machine; exposure is the kernel's stamp
    ``rtsp://…``                a network camera, by OpenCV's FFmpeg; stamps of the stream
    ``http://…``, ``https://…`` MJPEG; stamps of the header `X-Timestamp` where images have it
    a file's path               a video, which begins now
    ``folder:PATH``             images, each when its line `NAME SECONDS` in `stamps.txt` has it, from now on
    ``folder:PATH?rate=30``     images in the order of their names
    ==========================  =============================================================================

    What is assumed where frames have no usable stamps, the source's `notice` says.

    Args:
        uri: see above.
        patience: for opening, and for the first frame [s].

    Raises:
        InputError: no such camera, no one there, another protocol, no frame.
    """
    finite_number("patience", patience, above=0.0)
    name, reader = _reader_of(str(uri), patience)
    return NewestFrame(name, reader, patience=patience)


def _reader_of(uri: str, patience: float) -> tuple[str, Callable[[], FrameReader]]:
    """Return what messages call a source, and what opens it."""
    url = _url(uri)
    if url.scheme in ("http", "https") and url.hostname:
        return _without_password(url), lambda: MjpegReader(url, patience)
    if url.scheme in ("rtsp", "rtsps") and url.hostname:
        return _without_password(url), lambda: OpencvReader(uri, patience)
    device = re.fullmatch(r"(?:v4l2:)?(\d{1,3}|/dev/\S+)", uri, re.ASCII)
    if device is not None:
        source = int(device[1]) if device[1].isdigit() else device[1]
        return uri, lambda: OpencvReader(source, patience)
    folder = re.fullmatch(r"folder:(.+?)(?:\?rate=(.*))?", uri, re.DOTALL)
    if folder is not None:
        rate = None if folder[2] is None else _rate(uri, folder[2])
        return uri, lambda: FolderReader(Path(folder[1]), rate)
    path = Path(uri)
    if re.match(r"[a-z0-9]+:", uri) is None or path.is_file():
        if not path.is_file():
            raise InputError(f"camera {spelled(uri)}: no such file; legal: {LEGAL}")
        return uri, lambda: VideoReader(path)
    raise InputError(f"camera {spelled(uri)}: legal: {LEGAL}")


def _url(uri: str) -> SplitResult:
    try:
        url = urlsplit(uri)
        _ = url.port
    except ValueError as error:
        raise InputError(f"camera {spelled(uri)}: {error}; legal: {LEGAL}") from None
    return url


def _rate(uri: str, text: str) -> float:
    try:
        return finite_number("rate", float(text), above=0.0, maximum=1000.0)
    except ValueError:
        raise InputError(
            f"camera {spelled(uri)}: rate is images per second, above 0 and at most 1000"
        ) from None


def _without_password(url: SplitResult) -> str:
    """Return a URL for messages."""
    host = url.netloc.rpartition("@")[2]
    return url._replace(netloc=host, query="").geturl()
