"""What is computed again, beside what was recorded."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

TOLERANCE = 1e-6
"""Numbers that differ by no more, in their units (px, m, rad, m/s, rad/s), count as equal: on another
processor sums are rounded otherwise."""


class Comparison:
    """Collects where two runs differ."""

    def __init__(self) -> None:
        self.largest = 0.0
        """of all differences within the tolerance; 0: equal bit by bit"""
        self._found: dict[str, tuple[str, int]] = {}

    @property
    def differences(self) -> tuple[str, ...]:
        """Each quantity that differs: where it does first, and how often."""
        return tuple(
            words if count == 1 else f"{words} (and {count - 1} more)"
            for words, count in self._found.values()
        )

    def differ(self, name: str, words: str) -> None:
        """Note that a quantity differs."""
        first, count = self._found.get(name, (f"{name}: {words}", 0))
        self._found[name] = first, count + 1

    def numbers(self, name: str, place: str, recorded: npt.ArrayLike, replayed: npt.ArrayLike) -> None:
        """Compare arrays; NaN is equal to NaN. ``place`` says where in the run."""
        then, now = np.asarray(recorded, dtype=np.float64), np.asarray(replayed, dtype=np.float64)
        if then.shape != now.shape:
            self.differ(name, f"{place}{then.shape} numbers recorded, {now.shape} replayed")
            return
        off = np.where((then == now) | (np.isnan(then) & np.isnan(now)), 0.0, np.abs(then - now))
        if not off.size:
            return
        worst = int(np.argmax(np.where(np.isnan(off), np.inf, off)))
        most = float(off.ravel()[worst])
        if most <= TOLERANCE:
            self.largest = max(self.largest, most)
        else:
            self.differ(name, f"{place}{then.ravel()[worst]:.9g} recorded, {now.ravel()[worst]:.9g} replayed")

    def documents(self, name: str, recorded: Any, replayed: Any, skip: frozenset[str]) -> None:
        """Compare fields of documents one by one; those called as in ``skip`` are not checked."""
        if isinstance(recorded, dict) and isinstance(replayed, dict):
            for key in {**recorded, **replayed}:
                if key not in skip:
                    self.documents(f"{name}.{key}", recorded.get(key), replayed.get(key), skip)
        elif isinstance(recorded, list) and isinstance(replayed, list):
            if _is_numbers(recorded) and _is_numbers(replayed):
                self.numbers(name, "", _floats(recorded), _floats(replayed))
            elif len(recorded) != len(replayed):
                self.differ(name, f"{len(recorded)} recorded, {len(replayed)} replayed")
            else:
                for then, now in zip(recorded, replayed, strict=True):
                    self.documents(name, then, now, skip)
        elif _is_number(recorded) and _is_number(replayed):
            self.numbers(name, "", recorded, replayed)
        elif recorded != replayed:
            self.differ(name, f"{_short(recorded)} recorded, {_short(replayed)} replayed")


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _is_numbers(values: list[Any]) -> bool:
    return all(value is None or _is_number(value) for value in values)


def _floats(values: list[Any]) -> list[float]:
    return [math.nan if value is None else float(value) for value in values]


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
