"""A client's connection by RTDE: versions and recipes agreed, then packets in both directions."""

from __future__ import annotations

import select
import socket
import struct
import time
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import suppress

from omniservo.errors import ConnectionLost, InputError, NotInControl, spelled
from omniservo.hardware.rtde.packets import (
    IN_USE,
    NOT_FOUND,
    PROTOCOL_VERSION,
    PacketBuffer,
    PacketError,
    PacketKind,
    Recipe,
    packet,
)

CB3_RATE, RATE = 125.0, 500.0
"""states per second of the controllers before software 5, and since [Hz]"""

_KEPT = 64


class RtdeStream:
    """Connects and asks for both recipes; `start` lets the controller send.

    Args:
        host: name or address.
        port: of RTDE; controllers have 30004.
        patience: in which the controller must answer each question [s].

    Raises:
        InputError: no one is there, or speaks something else; the message says what was heard.
    """

    def __init__(self, host: str, port: int, patience: float) -> None:
        self.where = f"{host}:{port}"
        """what messages call the controller"""
        self._patience = patience
        try:
            self._socket = socket.create_connection((host, port), timeout=patience)
        except (OSError, UnicodeError) as error:
            raise InputError(f"{self.where}: no connection by RTDE: {_reason(error)}") from None
        self._socket.settimeout(None)  # `send` and `receive` never wait on it
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._buffer = PacketBuffer()
        self._waiting: list[tuple[PacketKind, bytes]] = []
        try:
            self._agree_on_version()
        except BaseException:
            self.close()
            raise

    def _agree_on_version(self) -> None:
        spoken = self._ask(PacketKind.VERSION, struct.pack(">H", PROTOCOL_VERSION))
        if spoken != b"\1":
            raise InputError(f"{self.where}: does not speak version {PROTOCOL_VERSION} of RTDE")
        version = self._ask(PacketKind.CONTROLLER)
        if len(version) != struct.calcsize(">4I"):
            raise InputError(f"{self.where}: a controller's version of {len(version)} bytes; RTDE has 16")
        self.version: tuple[int, ...] = struct.unpack(">4I", version)
        """of the controller's software: major, minor, bugfix, build"""

    @property
    def rate(self) -> float:
        """States per second that this controller can send [Hz]."""
        return RATE if self.version[0] >= 5 else CB3_RATE

    def outputs(self, names: Sequence[str]) -> Recipe:
        """Ask for these variables at the controller's full rate.

        Raises:
            InputError: the controller lacks one.
        """
        body = struct.pack(">d", self.rate) + ",".join(names).encode()
        return self._recipe("outputs", names, self._ask(PacketKind.OUTPUTS, body))

    def inputs(self, names: Sequence[str]) -> Recipe:
        """Say which variables will be written.

        Raises:
            InputError: the controller lacks one.
            NotInControl: another client writes one.
        """
        return self._recipe("inputs", names, self._ask(PacketKind.INPUTS, ",".join(names).encode()))

    def start(self) -> None:
        """Let the controller send.

        Raises:
            InputError: it refuses.
        """
        if self._ask(PacketKind.START) != b"\1":
            raise InputError(f"{self.where}: the controller does not start to send")

    def send(self, kind: PacketKind, body: bytes) -> None:
        """Send a packet without waiting.

        Raises:
            ConnectionLost: the connection is gone, or full of what no one reads.
        """
        data = packet(kind, body)
        try:
            sent = self._socket.send(data, socket.MSG_DONTWAIT)
        except OSError as error:
            raise ConnectionLost(f"{self.where}: {_reason(error)}") from None
        if sent != len(data):
            raise ConnectionLost(f"{self.where}: the controller no longer reads")

    def receive(self, patience: float, silence: str = "") -> Iterator[tuple[PacketKind, bytes]]:
        """Wait for the next part of the stream, and yield its packets.

        Args:
            patience: the longest silence [s].
            silence: words for it.

        Raises:
            ConnectionLost: the connection was closed, is broken, or was silent for so long.
            PacketError: what came is not RTDE.
        """
        waiting, self._waiting = self._waiting, []
        yield from waiting
        try:
            if not select.select([self._socket], [], [], max(patience, 0.0))[0]:
                raise ConnectionLost(f"{self.where}: {silence or f'silent for {patience:.1f} s'}")
            part = self._socket.recv(0x10000)
        except (OSError, ValueError) as error:
            raise ConnectionLost(f"{self.where}: {_reason(error)}") from None
        if not part:
            raise ConnectionLost(f"{self.where}: the controller closed the connection")
        yield from self._buffer.feed(part)

    def hang_up(self) -> None:
        """End what another thread waits for in `receive`."""
        with suppress(OSError):  # it may be gone already
            self._socket.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """Close the connection."""
        self._socket.close()

    def _ask(self, kind: PacketKind, body: bytes = b"") -> bytes:
        """Send a question and return its answer; what else comes is kept for `receive`."""
        said, other = "", deque[tuple[PacketKind, bytes]](maxlen=_KEPT)
        end, none_came = time.monotonic() + self._patience, f"no answer in {self._patience:g} s"
        try:
            self.send(kind, body)
            answer: bytes | None = None
            while answer is None:
                if time.monotonic() > end:
                    raise ConnectionLost(f"{self.where}: {none_came}")
                for got, content in self.receive(end - time.monotonic(), none_came):
                    if got == kind and answer is None:
                        answer = content
                    elif got == PacketKind.TEXT:
                        said = text_of(content)
                    else:
                        other.append((got, content))
        except PacketError as error:
            raise InputError(f"{self.where}: answers, but not by RTDE: {error}") from None
        except ConnectionLost as error:
            words = f"; it said {spelled(said)}" if said else ""
            raise InputError(f"{error} when asked for {kind.name.lower()} by RTDE{words}") from None
        self._waiting += other
        return answer

    def _recipe(self, what: str, names: Sequence[str], answer: bytes) -> Recipe:
        types = answer[1:].decode("ascii", "replace").split(",")
        if not answer or len(types) != len(names):
            raise InputError(f"{self.where}: {len(types)} types for {len(names)} {what}")
        missing = [name for name, each in zip(names, types, strict=True) if each == NOT_FOUND]
        if missing:
            version = ".".join(map(str, self.version[:3]))
            raise InputError(f"{self.where}: software {version} has no {what} {', '.join(missing)}")
        taken = [name for name, each in zip(names, types, strict=True) if each == IN_USE]
        if taken:
            raise NotInControl(f"{self.where}: another client of RTDE commands: it writes {taken[0]}")
        try:
            return Recipe(answer[0], types)
        except PacketError as error:
            raise InputError(f"{self.where}: {error}") from None


def text_of(body: bytes) -> str:
    """Return the words of a text packet."""
    length = body[0] if body else 0
    return body[1 : 1 + length].decode("utf-8", "replace")


def _reason(error: Exception) -> str:
    return getattr(error, "strerror", None) or str(error) or type(error).__name__
