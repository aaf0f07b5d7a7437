"""Numbers in a task file; lengths and angles are stated in the file's units, kept in metres and radians."""

import math
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, Field, ValidationInfo

from omniservo.planning.checks import LARGEST

_SHORTEST = 1e-9
"""of a direction"""


def _a_number(value: Any) -> Any:
    if isinstance(value, bool | str | bytes):  # which pydantic would take for numbers
        raise ValueError("a number is needed")
    return value


def _metres(value: float, info: ValidationInfo) -> float:
    return _within(value * float((info.context or {}).get("length", 1.0)), "m")


def _radians(value: float, info: ValidationInfo) -> float:
    return _within(value * float((info.context or {}).get("angle", 1.0)), "rad")


def _within(value: float, unit: str) -> float:
    if abs(value) > LARGEST:
        raise ValueError(f"legal: -{LARGEST:g} to {LARGEST:g} {unit}")
    return value


def _some_length(direction: tuple[float, float, float]) -> tuple[float, float, float]:
    if math.hypot(*direction) < _SHORTEST:
        raise ValueError("its length must not be 0")
    return direction


A_NUMBER = BeforeValidator(_a_number)
"""Stands behind all that else limits a whole number: texts and flags are none."""

Real = Annotated[float, Field(strict=True, allow_inf_nan=False)]
"""A finite number; texts and flags are none."""

Length = Annotated[Real, AfterValidator(_metres)]
"""A length [m], given in the file's unit of length."""

PositiveLength = Annotated[Real, Field(gt=0.0), AfterValidator(_metres)]
"""A length > 0 [m]."""

NonNegativeLength = Annotated[Real, Field(ge=0.0), AfterValidator(_metres)]
"""A length ≥ 0 [m]."""

Angle = Annotated[Real, AfterValidator(_radians)]
"""An angle [rad], given in the file's unit of angle."""

Point = tuple[Length, Length, Length]
"""A position [m]."""

Direction = Annotated[tuple[Real, Real, Real], AfterValidator(_some_length)]
"""A direction; its length does not matter but must not be 0."""
