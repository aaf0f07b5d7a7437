"""Frames as a video file."""

from __future__ import annotations

import io
import tempfile
from collections.abc import Iterable
from itertools import chain
from pathlib import Path

import cv2
from PIL import Image

from omniservo.errors import InputError
from omniservo.geometry.arrays import ByteArray

_CODECS = {".mp4": "mp4v", ".avi": "MJPG"}
VIDEO_ENDINGS = (*_CODECS, ".gif")
"""Endings of the videos that are written."""


def video_bytes(frames: Iterable[ByteArray], ending: str, rate: float) -> bytes:
    """Return frames (height, width, 3), of one size, as the bytes of a video file.

    Args:
        frames: colours, at least one; they are taken one after the other and not kept. In .mp4 and .avi,
            whose sides are even, an odd one has its last row or column twice.
        ending: of `VIDEO_ENDINGS`.
        rate: frames a second.

    Raises:
        InputError: another ending, or OpenCV writes no such video here.
    """
    if ending not in VIDEO_ENDINGS:
        raise InputError(f"video: {ending!r} given; legal: {', '.join(VIDEO_ENDINGS)}")
    rest = iter(frames)
    first = next(rest)
    if ending == ".gif":
        more, stream = (Image.fromarray(frame).quantize() for frame in rest), io.BytesIO()
        shown = Image.fromarray(first).quantize()
        shown.save(stream, "GIF", save_all=True, append_images=more, duration=round(1000.0 / rate), loop=0)
        return stream.getvalue()
    height, width = first.shape[:2]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"video{ending}"
        codec = cv2.VideoWriter.fourcc(*_CODECS[ending])
        grown = (0, height % 2, 0, width % 2)
        writer = cv2.VideoWriter(str(file), codec, rate, (width + width % 2, height + height % 2))
        for frame in chain([first], rest):
            even = cv2.copyMakeBorder(frame, *grown, cv2.BORDER_REPLICATE)
            writer.write(cv2.cvtColor(even, cv2.COLOR_RGB2BGR))
        writer.release()
        if not file.is_file() or not file.stat().st_size:
            raise InputError(f"video: OpenCV cannot write {ending} here; legal: .gif")
        return file.read_bytes()
