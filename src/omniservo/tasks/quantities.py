"""Numbers in a task file; lengths and angles are stated in the file's units, kept in metres and radians."""

from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, Field, ValidationInfo

from omniservo.planning.checks import LARGEST


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

Direction = tuple[Real, Real, Real]
"""A direction; its length does not matter but must not be 0."""
