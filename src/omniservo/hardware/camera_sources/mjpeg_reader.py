"""Motion JPEG over HTTP: what most network cameras, and small programs beside a camera, offer."""

from __future__ import annotations

import base64
import http.client
import io
import math
import socket
import time
from collections import deque
from contextlib import suppress
from urllib.parse import SplitResult, unquote

import cv2
import numpy as np
from PIL import Image

from omniservo.errors import spelled
from omniservo.geometry.arrays import ByteArray
from omniservo.hardware.camera_sources.frame_reader import Frame, FrameLoss, StampClock
from omniservo.hardware.camera_sources.multipart import MultipartError, MultipartParser, boundary_of

SILENCE = 5.0
"""A camera that sends nothing for so long is lost [s]."""

MOST_PIXELS = 50_000_000
"""Larger images are not decoded; Pillow, which reads their size, warns of larger ones yet."""

MOST_BROKEN = 30
"""So many images in a row that cannot be decoded are a loss."""


class MjpegReader:
    """A `FrameReader` of one connection. Its stamps are the images' headers `X-Timestamp` [s], if any.

    Args:
        url: http or https; a name and password in it are sent as basic authentication.
        patience: for the connection and its answer [s].

    Raises:
        FrameLoss: no one is there, or what is there sends no MJPEG.
    """

    clock = StampClock.SENDER
    """see FrameReader"""
    is_live = True
    """see FrameReader"""

    def __init__(self, url: SplitResult, patience: float) -> None:
        kind = http.client.HTTPSConnection if url.scheme == "https" else http.client.HTTPConnection
        headers = {"User-Agent": "omniservo"}
        if url.username is not None:
            pair = f"{unquote(url.username)}:{unquote(url.password or '')}"
            headers["Authorization"] = "Basic " + base64.b64encode(pair.encode()).decode()
        path = (url.path or "/") + (f"?{url.query}" if url.query else "")
        self._waiting: deque[tuple[dict[str, str], bytes]] = deque()
        self._connection = kind(url.hostname or "", url.port, timeout=patience)
        try:
            self._connection.connect()
            self._line: socket.socket = self._connection.sock
            self._connection.request("GET", path, headers=headers)
            self._answer = self._connection.getresponse()
            if self._answer.status != http.client.OK:
                raise FrameLoss(f"answers {self._answer.status} {spelled(self._answer.reason)}")
            self._parser = MultipartParser(boundary_of(self._answer.headers.get("Content-Type", "")))
            self._line.settimeout(SILENCE)
        except (OSError, http.client.HTTPException, ValueError, FrameLoss) as error:
            self.close()
            raise FrameLoss(_words(error)) from None

    def read(self) -> Frame:
        """See FrameReader; images that cannot be decoded are passed over."""
        for _ in range(MOST_BROKEN):
            headers, content = self._next_part()
            arrival = time.monotonic()
            pixels = decoded(content)
            if pixels is not None:
                return Frame(pixels, _stamp(headers.get("x-timestamp")), arrival)
        raise FrameLoss(f"{MOST_BROKEN} images in a row that are no JPEG")

    def _next_part(self) -> tuple[dict[str, str], bytes]:
        while not self._waiting:
            try:
                stream = self._answer.read1(0x10000)
                if not stream:
                    raise FrameLoss("the camera closed the connection")
                self._waiting.extend(self._parser.feed(stream))
            except TimeoutError:
                raise FrameLoss(f"silent for {SILENCE:g} s") from None
            except (OSError, http.client.HTTPException, MultipartError) as error:
                raise FrameLoss(_words(error)) from None
        return self._waiting.popleft()

    def hang_up(self) -> None:
        """See FrameReader."""
        with suppress(OSError):
            self._line.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """See FrameReader."""
        answer = getattr(self, "_answer", None)
        if answer is not None:
            answer.close()
        self._connection.close()


def decoded(content: bytes) -> ByteArray | None:
    """Return a JPEG's grey values as they are stored; None: it is none, or has more pixels than are read."""
    try:
        with Image.open(io.BytesIO(content), formats=("JPEG",)) as picture:
            width, height = picture.size
    except Exception:  # the reader of headers raises whatever it meets
        return None
    if width * height > MOST_PIXELS:
        return None
    try:
        flags = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION
        pixels = cv2.imdecode(np.frombuffer(content, np.uint8), flags)
    except cv2.error:
        return None
    return None if pixels is None else np.asarray(pixels, dtype=np.uint8)


def _stamp(text: str | None) -> float | None:
    """Return the seconds that a header states, or None."""
    try:
        value = float(text or "")
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _words(error: Exception) -> str:
    if isinstance(error, TimeoutError):
        return "no answer"
    if isinstance(error, http.client.BadStatusLine):
        return "answers, but not by HTTP"
    return getattr(error, "strerror", None) or str(error) or type(error).__name__
