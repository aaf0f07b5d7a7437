"""Warnings of the libraries that read files, taken otherwise for as long as a file is read."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from threading import RLock
from typing import Literal

_ONE_AT_A_TIME = RLock()
"""Filters of warnings are those of the whole process: of two threads that change them at once, the one that
ends last puts those of the other back, and they stay."""


@contextmanager
def own_warnings(action: Literal["ignore", "error"], message: str = "") -> Iterator[None]:
    """Ignore or raise warnings that begin with ``message`` while the block runs, in one thread at a time."""
    with _ONE_AT_A_TIME, warnings.catch_warnings():
        warnings.filterwarnings(action, message)
        yield
