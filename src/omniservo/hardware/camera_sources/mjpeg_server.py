"""A stand-in for a network camera: any camera's images as Motion JPEG over HTTP, for rehearsals and tests."""

from __future__ import annotations

import socket
import time
from threading import Condition, Event, Thread

import cv2

from omniservo.errors import InputError, OmniservoError
from omniservo.geometry.arrays import finite_number
from omniservo.hardware.link_faults import FaultyLine, LinkFaults
from omniservo.hardware.listener import Listener
from omniservo.robots import CameraSource

BOUNDARY = b"frame"

_MOST_REQUEST = 2**14
_LOOK = 1e-3
"""How often the camera is polled for a new image [s]."""


class MjpegServer:
    """Sends every new image of a camera to all who ask by HTTP, with its time stamp in `X-Timestamp`.

    Args:
        camera: gives the images; its time stamps are `time.monotonic()`.
        host: own address that is listened at.
        port: 0 takes a free one.
        faults: see LinkFaults.
        quality: of the JPEGs, 1 to 100.
        stamps: whether images have a time stamp.

    Raises:
        InputError: the port cannot be had, or another quality.
    """

    def __init__(
        self,
        camera: CameraSource,
        host: str = "127.0.0.1",
        port: int = 0,
        faults: LinkFaults | None = None,
        *,
        quality: int = 95,
        stamps: bool = True,
    ) -> None:
        self._camera, self._faults = camera, faults or LinkFaults()
        self._quality = int(finite_number("quality", quality, minimum=1.0, maximum=100.0))
        self._stamps = stamps
        self._begin = time.monotonic()
        self._clock = FaultyLine[None](self._faults, self._begin)
        self._lines: list[FaultyLine[bytes]] = []
        self._news, self._closing = Condition(), Event()
        self._listener = Listener(host, port, self._serve)
        self.url = f"http://{host}:{self._listener.port}/"
        """where the images are"""
        self._thread = Thread(target=self._run, name="MJPEG server", daemon=True)
        self._thread.start()

    def __enter__(self) -> MjpegServer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def clients(self) -> int:
        """How many are being sent images."""
        return len(self._lines)

    def close(self) -> None:
        """End all connections, and listen no more."""
        self._closing.set()
        with self._news:
            self._news.notify_all()
        self._listener.close()
        self._thread.join()

    def _run(self) -> None:
        """Hand every new image to all lines."""
        newest = float("-inf")
        while not self._closing.wait(_LOOK):
            try:
                image = self._camera.image()
            except OmniservoError:  # the camera is gone; so are its images
                continue
            if image is None or image.time <= newest:
                continue
            newest = image.time
            if not self._lines:
                continue
            done, jpeg = cv2.imencode(".jpg", image.pixels, [cv2.IMWRITE_JPEG_QUALITY, self._quality])
            if not done:
                raise InputError(f"an image of {image.pixels.shape} is no JPEG")
            part = self._part(jpeg.tobytes(), self._clock.stamp(image.time))
            with self._news:
                for line in self._lines:
                    line.put(part, time.monotonic())
                self._news.notify_all()

    def _part(self, jpeg: bytes, stamp: float) -> bytes:
        head = b"--" + BOUNDARY + b"\r\nContent-Type: image/jpeg\r\n"
        head += f"Content-Length: {len(jpeg)}\r\n".encode()
        if self._stamps:
            head += f"X-Timestamp: {stamp:.6f}\r\n".encode()
        return head + b"\r\n" + jpeg + b"\r\n"

    def _serve(self, connection: socket.socket) -> None:
        """Answer one request with images until its connection or the server ends."""
        request = b""
        while b"\r\n\r\n" not in request:
            part = connection.recv(4096)
            request += part
            if not part or len(request) > _MOST_REQUEST:
                return
        if not request.startswith(b"GET "):
            connection.sendall(b"HTTP/1.1 405 Method Not Allowed\r\nAllow: GET\r\nConnection: close\r\n\r\n")
            return
        connection.sendall(
            b"HTTP/1.1 200 OK\r\nCache-Control: no-store\r\nConnection: close\r\n"
            b"Content-Type: multipart/x-mixed-replace; boundary=" + BOUNDARY + b"\r\n\r\n"
        )
        line = FaultyLine[bytes](self._faults, self._begin)
        with self._news:
            self._lines.append(line)
        try:
            while not self._closing.is_set():
                arrived = line.due(time.monotonic())
                if arrived:
                    connection.sendall(arrived[-1])  # who reads slowly misses images, and gets no old ones
                else:
                    self._wait(line)
        finally:
            with self._news:
                self._lines.remove(line)

    def _wait(self, line: FaultyLine[bytes]) -> None:
        """Wait until an image may have arrived at the end of a line."""
        with self._news:
            due = line.next_due()
            if not self._closing.is_set():
                self._news.wait(None if due is None else max(due - time.monotonic(), 0.0))
