"""Who waits for the compiler is informed: Numba says when it compiles, and how long that and loading take."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from time import perf_counter
from typing import Any, Self

from numba.core import event as numba_events

_COMPILING, _LOCKED = "numba:compile", "numba:compiler_lock"
"""Numba holds the lock while it compiles a function, and while it loads one that was compiled before."""


class CompilerWatch(numba_events.Listener):  # type: ignore[misc]
    """Counts what Numba does while this is entered.

    Args:
        tell: called with the name of each function that is going to be compiled.
    """

    def __init__(self, tell: Callable[[str], object] = lambda name: None) -> None:
        self._tell = tell
        self._depth, self._since = 0, 0.0
        self._entered = ExitStack()
        self.compiled = 0
        """functions that were compiled; those that were only loaded are not counted"""
        self.seconds = 0.0
        """[s] of compiling and loading"""

    def __enter__(self) -> Self:
        for kind in (_COMPILING, _LOCKED):
            self._entered.enter_context(numba_events.install_listener(kind, self))
        return self

    def __exit__(self, *raised: object) -> None:
        self._entered.close()

    def on_start(self, event: Any) -> None:
        """Numba begins to compile, or takes its lock."""
        if event.kind == _COMPILING:
            self.compiled += 1
            self._tell(event.data["dispatcher"].py_func.__name__)
            return
        if self._depth == 0:
            self._since = perf_counter()
        self._depth += 1

    def on_end(self, event: Any) -> None:
        """Numba has compiled, or gives its lock back."""
        if event.kind == _LOCKED:
            self._depth -= 1
            if self._depth == 0:
                self.seconds += perf_counter() - self._since
