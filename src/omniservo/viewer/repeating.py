"""A thread that does one thing again whenever it is woken, with the newest there is."""

from __future__ import annotations

import threading
from collections.abc import Callable


class Repeating:
    """A thread that works when it is woken; what wakes it meanwhile counts once.

    Args:
        name: of the thread.
        work: what is done; it reads what it needs. What it raises is reported, and the thread goes on.
        failed: called with what it raised.
    """

    def __init__(self, name: str, work: Callable[[], None], failed: Callable[[Exception], None]) -> None:
        self._work, self._failed = work, failed
        self._woken, self._ended = threading.Event(), False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def start(self) -> None:
        """Begin to wait."""
        self._thread.start()

    def wake(self) -> None:
        """Have it work; at once, or again after what it works on."""
        self._woken.set()

    def woken_within(self, seconds: float) -> bool:
        """Wait until there is something newer to work on [s]; return whether there is."""
        return self._woken.wait(seconds)

    @property
    def woken(self) -> bool:
        """Whether there is something newer than what it works on."""
        return self._woken.is_set()

    def close(self) -> None:
        """End it, after what it works on."""
        self._ended = True
        self._woken.set()
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join(10.0)

    def _run(self) -> None:
        while True:
            self._woken.wait()
            self._woken.clear()
            if self._ended:
                return
            try:
                self._work()
            except Exception as error:  # whatever it is: the page lives on and says it
                self._failed(error)
