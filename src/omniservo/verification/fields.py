"""Fields of an untrusted document as exact numbers, or one message that says what is wrong with them."""

from collections.abc import Mapping, Sequence
from fractions import Fraction
from math import inf, sqrt
from typing import Any

from omniservo.verification.work import spend

Vector = tuple[Fraction, ...]
BEYOND_FLOATS = (ArithmeticError, ValueError)
"""What floating point raises where exact arithmetic has no trouble: hints and amounts are then left out."""
_MISSING = object()
_VECTOR, _NUMBER = 16, 20
_NEAR_UNIT = Fraction(1, 10**6)


class PlanFileError(ValueError):
    """The file is no plan at all, or cannot be read."""


class Malformed(Exception):
    """The plan lacks a field, or a field has no legal value: such a plan proves nothing."""


class NotJudged(Exception):
    """The plan asks for something that this verifier does not know: it must not be called certified."""


def shown(value: Any) -> str:
    """Return the first characters of any value."""
    try:
        return f"{value!r:.60}"
    except (ValueError, RecursionError):
        return "a value too long or too deep to show"


def number(value: Any, where: str) -> Fraction:
    """Return a finite number exactly.

    Raises:
        Malformed: not a number, NaN, infinite.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise Malformed(f"{where}: {shown(value)} given; a number is needed")
    try:
        return Fraction(float(value))
    except (ValueError, OverflowError):
        raise Malformed(f"{where}: {shown(value)} given; a finite number is needed") from None


def numbers(value: Any, count: int, where: str) -> Vector:
    """Return a list of exactly ``count`` finite numbers."""
    if not isinstance(value, list | tuple) or len(value) != count:
        raise Malformed(f"{where}: {shown(value)} given; {count} numbers are needed")
    spend(_VECTOR + _NUMBER * count)
    return tuple(number(item, f"{where}[{i}]") for i, item in enumerate(value))


def near_unit(vector: Vector, where: str) -> Vector:
    """Return the vector, whose length must be 1 within 1e-6; only its direction is used from here on."""
    squared = sum(x * x for x in vector)
    if not (1 - _NEAR_UNIT) ** 2 <= squared <= (1 + _NEAR_UNIT) ** 2:
        raise Malformed(f"{where}: length {root(squared):.9g}; legal: 1 within 1e-6")
    return vector


def root(squared: Fraction | int) -> float:
    """Return the square root in floating point, for messages only."""
    try:
        return sqrt(squared)
    except OverflowError:
        return inf


class Fields:
    """One mapping of the document and where it stands."""

    def __init__(self, value: Any, where: str, known: str | None = None) -> None:
        if not isinstance(value, Mapping):
            raise Malformed(f"{where}: {shown(value)} given; an object with fields is needed")
        self.where = where
        self._value = value
        if known is not None:
            self.only(known)

    def only(self, known: str) -> None:
        """Refuse any field but the known ones: it may be a constraint."""
        unknown = sorted(shown(name) for name in self._value if name not in known.split())
        if unknown:
            raise NotJudged(f"{self.where}: this verifier does not know the field {unknown[0]}")

    def get(self, name: str, default: Any = None) -> Any:
        """Return the raw value."""
        return self._value.get(name, default)

    def exactly(self, name: str, wanted: str) -> None:
        """Check that the field has the one legal value."""
        if self.get(name) != wanted:
            raise Malformed(
                f"{self.where}.{name}: {shown(self.get(name))} given; this verifier knows {wanted!r}"
            )

    def one_of(self, name: str, legal: Sequence[str]) -> str:
        """Return one of the legal words."""
        value = self.get(name)
        if not isinstance(value, str) or value not in legal:
            raise Malformed(f"{self.where}.{name}: {shown(value)} given; legal: {', '.join(legal)}")
        return value

    def flag(self, name: str, *, default: bool) -> bool:
        """Return true or false."""
        value = self.get(name, default)
        if not isinstance(value, bool):
            raise Malformed(f"{self.where}.{name}: {shown(value)} given; legal: true, false")
        return value

    def number(
        self, name: str, *, default: Any = _MISSING, least: int | None = None, above: int | None = None
    ) -> Fraction:
        """Return the field as an exact number, ≥ ``least`` and > ``above`` where they are given."""
        value = self._value.get(name, default)
        if value is _MISSING:
            raise Malformed(f"{self.where}.{name}: missing")
        result = number(value, f"{self.where}.{name}")
        if (least is not None and result < least) or (above is not None and result <= above):
            legal = f">= {least}" if least is not None else f"> {above}"
            raise Malformed(f"{self.where}.{name}: {float(result):g} given; legal: {legal}")
        return result

    def vector(self, name: str, count: int) -> Vector:
        """Return the field as ``count`` exact numbers."""
        return numbers(self.get(name), count, f"{self.where}.{name}")

    def items(self, name: str, most: int, default: Any = None) -> Sequence[Any]:
        """Return the field as a list of at most ``most`` items."""
        value = self._value.get(name, default)
        if not isinstance(value, list | tuple):
            raise Malformed(f"{self.where}.{name}: {shown(value)} given; a list is needed")
        if len(value) > most:
            raise Malformed(f"{self.where}.{name}: {len(value)} given; at most {most} are judged")
        return value

    def vectors(self, name: str, count: int, most: int) -> tuple[Vector, ...]:
        """Return the field as a list of vectors."""
        items = self.items(name, most)
        return tuple(numbers(item, count, f"{self.where}.{name}[{i}]") for i, item in enumerate(items))

    def table(self, name: str, known: str | None = None) -> "Fields":
        """Return the field as a mapping; with ``known``, one that has no other fields."""
        where = name if self.where == "plan" else f"{self.where}.{name}"
        return Fields(self.get(name), where, known)

    def tables(self, name: str, most: int = 200_000, default: Any = None) -> list["Fields"]:
        """Return the field as a list of mappings."""
        items = self.items(name, most, default)
        return [Fields(item, f"{self.where}.{name}[{i}]") for i, item in enumerate(items)]
