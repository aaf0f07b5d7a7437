"""Lengths and angles in a task file: stated in the file's units, kept in metres and radians."""

from typing import Annotated

from pydantic import AfterValidator, FiniteFloat, ValidationInfo


def _metres(value: float, info: ValidationInfo) -> float:
    return value * float((info.context or {}).get("length", 1.0))


def _radians(value: float, info: ValidationInfo) -> float:
    return value * float((info.context or {}).get("angle", 1.0))


def _positive(value: float) -> float:
    if value <= 0:
        raise ValueError("must be greater than 0")
    return value


def _not_negative(value: float) -> float:
    if value < 0:
        raise ValueError("must be 0 or more")
    return value


Length = Annotated[FiniteFloat, AfterValidator(_metres)]
"""A length [m], given in the file's unit of length."""

PositiveLength = Annotated[Length, AfterValidator(_positive)]
"""A length > 0 [m]."""

NonNegativeLength = Annotated[Length, AfterValidator(_not_negative)]
"""A length ≥ 0 [m]."""

Angle = Annotated[FiniteFloat, AfterValidator(_radians)]
"""An angle [rad], given in the file's unit of angle."""

Point = tuple[Length, Length, Length]
"""A position [m]."""

Direction = tuple[FiniteFloat, FiniteFloat, FiniteFloat]
"""A direction; its length does not matter but must not be 0."""
