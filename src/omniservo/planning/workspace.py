"""Where the camera centre stays."""

from __future__ import annotations

from dataclasses import dataclass

from omniservo.errors import InputError
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray, frozen_again
from omniservo.planning.checks import bounded_array
from omniservo.planning.obstacles.half_space import HalfSpace

MOST_HALF_SPACES = 1000
"""Half-spaces that a workspace may have."""


@with_field_docs
@dataclass(frozen=True, eq=False)
class Workspace:
    """Where the camera centre stays, in the initial camera frame: a box, half-spaces, or both.

    Raises:
        InputError: nothing given, only one of min and max, min ≥ max, or what `HalfSpace` refuses.
    """

    min: FloatArray | None = None
    """(3,) [m], read-only; None where there is no box"""
    max: FloatArray | None = None
    """(3,) [m], read-only"""
    half_spaces: tuple[HalfSpace, ...] = ()
    """free is normal·t ≥ offset: no clearance is added, so theirs must be None; nor do they move"""

    __setstate__ = frozen_again

    def __post_init__(self) -> None:
        self._check_half_spaces()
        if self.min is not None and self.max is not None:
            self._check_box(self.min, self.max)
        elif self.min is not None or self.max is not None:
            missing = "min" if self.min is None else "max"
            raise InputError(f"workspace.{missing}: missing; legal: min and max, or neither")
        elif not self.half_spaces:
            raise InputError("workspace: empty; legal: min and max, half_spaces, or all three")

    def _check_box(self, low: FloatArray, high: FloatArray) -> None:
        low, high = bounded_array("workspace.min", low, (3,)), bounded_array("workspace.max", high, (3,))
        for axis in range(3):
            if not low[axis] < high[axis]:
                raise InputError(
                    f"workspace: min {low[axis]:g}, max {high[axis]:g} given on axis {'xyz'[axis]}; "
                    "legal: min < max"
                )
        object.__setattr__(self, "min", low)
        object.__setattr__(self, "max", high)

    def _check_half_spaces(self) -> None:
        half_spaces = tuple(self.half_spaces)
        if len(half_spaces) > MOST_HALF_SPACES:
            raise InputError(
                f"workspace.half_spaces: {len(half_spaces)} given; legal: at most {MOST_HALF_SPACES}"
            )
        for i, side in enumerate(half_spaces):
            if not isinstance(side, HalfSpace):
                what = type(side).__name__
            elif side.clearance is not None or side.motion is not None:
                what = "with a clearance" if side.motion is None else "with a motion"
            else:
                continue
            raise InputError(
                f"workspace.half_spaces[{i}]: {what} given; legal: a HalfSpace without clearance and motion"
            )
        object.__setattr__(self, "half_spaces", half_spaces)
