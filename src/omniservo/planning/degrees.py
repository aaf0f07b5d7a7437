"""The polynomial degrees of a path."""

from dataclasses import dataclass

from omniservo.errors import InputError
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import finite_number

HIGHEST_DEGREE = 16
"""Highest degree of rotation and translation: every binomial coefficient that they need is an exact float."""


@with_field_docs
@dataclass(frozen=True)
class Degrees:
    """Highest polynomial degrees that a path may have."""

    rotation: int = 2
    """σ, 1 to 16"""
    translation: int = 2
    """τ, 1 to 16"""

    def __post_init__(self) -> None:
        for name in ("rotation", "translation"):
            value = getattr(self, name)
            number = finite_number(f"degrees.{name}", value, minimum=1, maximum=HIGHEST_DEGREE)
            if number != int(number):
                raise InputError(f"degrees.{name}: {number:g} given; a whole number is needed")
            object.__setattr__(self, name, int(number))
