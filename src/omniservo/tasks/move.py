"""What happens on the way: an obstacle is put elsewhere while the arm moves."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, Field

from omniservo.tasks.quantities import A_NUMBER, Point, Real
from omniservo.tasks.section import Section


def _once(numbers: tuple[int, ...]) -> tuple[int, ...]:
    if len(set(numbers)) < len(numbers):
        raise ValueError(f"{max(numbers, key=numbers.count)} given twice; once is legal")
    return numbers


_Indices = Annotated[
    tuple[Annotated[int, Field(ge=0), A_NUMBER], ...], Field(min_length=1), AfterValidator(_once)
]


class Move(Section):
    """Some bodies are moved, and the planner is given at once what it knows of them."""

    time: Annotated[Real, Field(ge=0, le=3600)]
    """since the servo's start [s]; at the first image from then on"""
    by: Point
    """in the initial camera frame [m]"""
    bodies: _Indices
    """which of the task's ``obstacles``"""
    known: _Indices
    """which of ``planning.obstacles`` stand for them"""
