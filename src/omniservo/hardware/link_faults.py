"""What lines between programs do to messages, for stand-in servers: delay, jitter, loss, another clock."""

from __future__ import annotations

import heapq
import time
from dataclasses import dataclass
from itertools import count
from threading import Lock
from typing import Generic, TypeVar

import numpy as np

from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import finite_number

T = TypeVar("T")


@with_field_docs
@dataclass(frozen=True)
class LinkFaults:
    """How a server's messages reach who listens.

    Raises:
        InputError: a number that is not legal, named.
    """

    latency: float = 0.0
    """mean delay of a message [s]"""
    jitter: float = 0.0
    """a delay is off the mean by up to this, either way, evenly distributed [s]; none is below 0"""
    loss: float = 0.0
    """share of the messages that never arrive"""
    clock_offset: float = 0.0
    """the server's clock less this machine's, when the server begins [s]"""
    drift_ppm: float = 0.0
    """the server's clock runs faster by so many millionths"""
    seed: int = 0
    """of delays and losses"""
    reordered: bool = False
    """whether messages may overtake one another, as datagrams do; a stream keeps their order"""

    def __post_init__(self) -> None:
        finite_number("latency", self.latency, minimum=0.0)
        finite_number("jitter", self.jitter, minimum=0.0)
        finite_number("loss", self.loss, minimum=0.0, maximum=1.0)
        finite_number("clock_offset", self.clock_offset)
        finite_number("drift_ppm", self.drift_ppm, minimum=-1e5, maximum=1e5)


class FaultyLine(Generic[T]):
    """One line with these faults: what is put in comes out later, or never. Threads may share it.

    Args:
        faults: see LinkFaults.
        begin: when the server begins, by `time.monotonic()` [s]; None: now.
    """

    def __init__(self, faults: LinkFaults, begin: float | None = None) -> None:
        self._faults = faults
        self._begin = time.monotonic() if begin is None else begin
        self._random = np.random.default_rng(faults.seed)
        self._items: list[tuple[float, int, T]] = []
        self._last = -np.inf
        self._count = count()
        self._lock = Lock()

    def stamp(self, monotonic: float) -> float:
        """Return what the server's clock shows at a time of this machine's [s]."""
        faults = self._faults
        return monotonic + faults.clock_offset + 1e-6 * faults.drift_ppm * (monotonic - self._begin)

    def put(self, item: T, now: float) -> None:
        """Send something at the time ``now`` of this machine [s]."""
        faults = self._faults
        with self._lock:
            lost = self._random.random() < faults.loss
            delay = faults.latency + faults.jitter * self._random.uniform(-1.0, 1.0)
            if lost:
                return
            due = now + max(delay, 0.0)
            if not faults.reordered:
                due = self._last = max(due, self._last)
            heapq.heappush(self._items, (due, next(self._count), item))

    def due(self, now: float) -> list[T]:
        """Return what has arrived by ``now`` [s] and was not returned before, in the order of arrival."""
        arrived: list[T] = []
        with self._lock:
            while self._items and self._items[0][0] <= now:
                arrived.append(heapq.heappop(self._items)[2])
        return arrived

    def next_due(self) -> float | None:
        """Return when the next message arrives [s]; None where there is none."""
        with self._lock:
            return self._items[0][0] if self._items else None
