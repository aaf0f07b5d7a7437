"""A port that clients connect to, a thread for each: what stand-in servers listen with."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable
from contextlib import suppress
from threading import Lock, Thread

from omniservo.errors import InputError


class Listener:
    """Accepts connections, and hands each to ``handle`` in a thread of its own, which ends the connection.

    Args:
        host: own address that is listened at.
        port: 0 takes a free one.
        handle: gets each connection; an `OSError` that it raises is the connection's end.

    Raises:
        InputError: the port cannot be had.
    """

    def __init__(self, host: str, port: int, handle: Callable[[socket.socket], None]) -> None:
        try:
            self._socket = socket.create_server((host, port))
        except OSError as error:  # whose own words have the address once more
            why = os.strerror(error.errno) if error.errno and error.errno > 0 else error
            raise InputError(f"{host}:{port}: cannot be listened at: {why}") from None
        self.port: int = self._socket.getsockname()[1]
        """which is listened at"""
        self._handle = handle
        self._lock = Lock()
        self._connections: dict[socket.socket, Thread] = {}
        self._closed = False
        self._thread = Thread(target=self._accept, name=f"port {self.port}", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End every connection, and listen no more."""
        with self._lock:
            self._closed = True
            connections = dict(self._connections)
        for line in [self._socket, *connections]:
            with suppress(OSError):
                line.shutdown(socket.SHUT_RDWR)
        for thread in [self._thread, *connections.values()]:
            thread.join()
        self._socket.close()

    def _accept(self) -> None:
        while True:
            try:
                line, _ = self._socket.accept()
            except OSError:
                return
            thread = Thread(target=self._serve, args=(line,), daemon=True)
            with self._lock:
                if self._closed:
                    line.close()
                    return
                self._connections[line] = thread
                thread.start()

    def _serve(self, line: socket.socket) -> None:
        with line:
            with suppress(OSError):
                line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                self._handle(line)
            with self._lock:
                del self._connections[line]
