"""Numbers that a study draws: what its file says of them, and one draw."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, PlainSerializer, ValidationInfo

Kind = Literal["value", "uniform", "log_uniform", "normal", "choice"]

_MOST = 1e9
"""of a number: whatever is drawn of such is finite"""
_TWO = {"uniform": "[LEAST, MOST]", "log_uniform": "[LEAST, MOST] above 0", "normal": "[MEAN, SIGMA]"}
_LEGAL = "legal: a number, {uniform: [LEAST, MOST]}, {log_uniform: …}, {normal: [MEAN, SIGMA]}, {choice: […]}"


@dataclass(frozen=True)
class Distribution:
    """One number, drawn anew for each scene."""

    kind: Kind
    numbers: tuple[float, ...]
    """the value; least and most; mean and standard deviation; or what is chosen from, each as likely"""

    def draw(self, random: np.random.Generator) -> float:
        """Return a draw. Every kind takes one number of the generator, whatever it makes of it."""
        share = float(random.random())
        first, last = self.numbers[0], self.numbers[-1]
        if self.kind == "value":
            return first
        if self.kind == "uniform":
            return first + share * (last - first)
        if self.kind == "log_uniform":
            return first * math.pow(last / first, share)
        if self.kind == "choice":
            return self.numbers[min(int(share * len(self.numbers)), len(self.numbers) - 1)]
        from scipy.special import ndtri

        return first + last * float(ndtri(share or 0.5))

    @property
    def bounds(self) -> tuple[float, float]:
        """Least and most that is drawn."""
        if self.kind == "normal":
            mean, sigma = self.numbers
            return (mean, mean) if sigma == 0.0 else (-math.inf, math.inf)
        return min(self.numbers), max(self.numbers)

    def scaled(self, factor: float) -> Distribution:
        """Return the same in another unit."""
        return Distribution(self.kind, tuple(factor * number for number in self.numbers))

    def to_field(self) -> Any:
        """Return what a study file says of it."""
        return self.numbers[0] if self.kind == "value" else {self.kind: list(self.numbers)}


def read_distribution(field: Any) -> Distribution:
    """Return the distribution that a field of a file states.

    Raises:
        ValueError: it states none.
    """
    if isinstance(field, Distribution):
        return field
    if _is_number(field):
        return Distribution("value", (float(field),))
    if not isinstance(field, dict) or len(field) != 1:
        raise ValueError(f"{_LEGAL}; numbers within ±{_MOST:g}")
    kind, numbers = next(iter(field.items()))
    if kind not in ("uniform", "log_uniform", "normal", "choice"):
        raise ValueError(_LEGAL)
    if not isinstance(numbers, list) or not numbers or not all(map(_is_number, numbers)):
        raise ValueError(f"{kind}: numbers within ±{_MOST:g} are needed; {_LEGAL}")
    if kind in _TWO and len(numbers) != 2:
        raise ValueError(f"{kind}: {len(numbers)} numbers; legal: {_TWO[kind]}")
    first, last = numbers[0], numbers[-1]
    if kind == "log_uniform" and first > 0 and last / first > _MOST**2:
        raise ValueError(f"log_uniform: legal: MOST at most {_MOST**2:g} times LEAST")
    if kind in ("uniform", "log_uniform") and (last < first or (kind == "log_uniform" and first <= 0)):
        raise ValueError(f"{kind}: legal: {_TWO[kind]}")
    if kind == "normal" and last < 0:
        raise ValueError("normal: SIGMA must be 0 or more")
    return Distribution(kind, tuple(map(float, numbers)))


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= _MOST


def _in(unit: str | None, least: float, most: float, whole: bool = False) -> Callable[..., Distribution]:
    """Return what reads a distribution, in metres or radians, of which every draw is within bounds."""

    def read(field: Any, info: ValidationInfo) -> Distribution:
        found = read_distribution(field)
        if unit is not None:
            found = found.scaled(float((info.context or {}).get(unit, 1.0)))
        low, high = found.bounds
        legal = f"legal: {least:g} to {most:g}" if math.isfinite(most) else f"legal: {least:g} or more"
        if low < least or high > most:
            also = " (a normal distribution has no bounds)" if found.kind == "normal" else ""
            raise ValueError(f"{legal}{also}")
        if whole and (found.kind not in ("value", "choice") or any(n % 1.0 for n in found.numbers)):
            raise ValueError("legal: a whole number, or {choice: [whole numbers]}")
        return found

    return read


_AS_FIELD = PlainSerializer(Distribution.to_field)

Number = Annotated[Distribution, BeforeValidator(_in(None, -math.inf, math.inf)), _AS_FIELD]
NonNegative = Annotated[Distribution, BeforeValidator(_in(None, 0.0, math.inf)), _AS_FIELD]
Share = Annotated[Distribution, BeforeValidator(_in(None, 0.0, 1.0)), _AS_FIELD]
Lengths = Annotated[Distribution, BeforeValidator(_in("length", 0.0, 1e3)), _AS_FIELD]
"""[m], given in the file's unit of length"""
Angles = Annotated[Distribution, BeforeValidator(_in("angle", 0.0, math.pi + 1e-9)), _AS_FIELD]
"""[rad], given in the file's unit of angle"""


def whole(least: int, most: int) -> Any:
    """Return the annotation of a whole number within bounds."""
    return Annotated[Distribution, BeforeValidator(_in(None, least, most, whole=True)), _AS_FIELD]


def constant(value: float) -> Distribution:
    """Return the distribution of one value."""
    return Distribution("value", (float(value),))
