"""How long a call takes."""

from __future__ import annotations

import math
from collections.abc import Callable
from time import perf_counter


def shortest(call: Callable[[], object], rounds: int = 3) -> float:
    """Return the shortest of a few calls [µs]: a shared machine only adds."""
    best = math.inf
    for _ in range(rounds):
        before = perf_counter()
        call()
        best = min(best, perf_counter() - before)
    return 1e6 * best
