"""Frames as a video file."""

from __future__ import annotations

import io
import tempfile
from collections.abc import Sequence
from pathlib import Path

import cv2
from PIL import Image

from omniservo.errors import InputError
from omniservo.geometry.arrays import ByteArray

_CODECS = {".mp4": "mp4v", ".avi": "MJPG"}
VIDEO_ENDINGS = (*_CODECS, ".gif")
"""Endings of the videos that are written."""


def video_bytes(frames: Sequence[ByteArray], ending: str, rate: float) -> bytes:
    """Return frames (height, width, 3), of one size, as the bytes of a video file.

    Args:
        frames: colours, at least one.
        ending: of `VIDEO_ENDINGS`.
        rate: frames a second.

    Raises:
        InputError: another ending, or OpenCV writes no such video here.
    """
    if ending == ".gif":
        first, *rest = [Image.fromarray(frame).quantize() for frame in frames]
        stream = io.BytesIO()
        first.save(stream, "GIF", save_all=True, append_images=rest, duration=round(1000.0 / rate), loop=0)
        return stream.getvalue()
    if ending not in _CODECS:
        raise InputError(f"video: {ending!r} given; legal: {', '.join(VIDEO_ENDINGS)}")
    height, width = frames[0].shape[:2]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"video{ending}"
        codec = cv2.VideoWriter.fourcc(*_CODECS[ending])
        writer = cv2.VideoWriter(str(file), codec, rate, (width, height))
        for frame in frames:
            writer.write(cv2.cvtColor(frame, cv2.COLOR_RGB2BGR))
        writer.release()
        if not file.is_file() or not file.stat().st_size:
            raise InputError(f"video: OpenCV cannot write {ending} here; legal: .gif")
        return file.read_bytes()
