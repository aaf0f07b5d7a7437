"""What every value of a planning problem is checked for."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray, finite_array, finite_number, frozen

LARGEST = 1e6
"""Coordinates and lengths are at most this [m]: squares and their squares stay far from overflow."""

SMALLEST = 1e-9
"""What is round has radii of at least this [m]: their squares stay far from underflow."""


def bounded_array(name: str, value: npt.ArrayLike, shape: Sequence[int | None]) -> FloatArray:
    """Return ``value`` as a read-only array of this shape with every number in [−1e6, 1e6].

    Raises:
        InputError: not numbers, of another shape, not finite, or larger.
    """
    array = frozen(finite_array(name, value, shape))
    if array.size and np.abs(array).max() > LARGEST:
        raise InputError(f"{name}: {array.flat[np.abs(array).argmax()]:g} given; legal: -1e6 to 1e6")
    return array


HIGHEST_MOTION = 16
"""Highest degree of an obstacle's motion."""


def own_motion(value: npt.ArrayLike | None) -> FloatArray | None:
    """Return an obstacle's displacement m(w) as a read-only array (3, k+1), highest power first [m].

    Raises:
        InputError: not finite, of another shape, of a degree above 16, or a coefficient beyond 1e6 m.
    """
    if value is None:
        return None
    motion = bounded_array("motion", value, (3, None))
    if not 1 <= motion.shape[1] <= HIGHEST_MOTION + 1:
        raise InputError(
            f"motion: {motion.shape[1]} coefficients an axis given; legal: 1 to {HIGHEST_MOTION + 1}"
        )
    return motion


NEAR_UNIT = 1e-6
"""Unit vectors are accepted within this and normalised."""

_ROUNDED_UNIT = 1e-15
"""A vector this near to length 1 is kept as it is: what was normalised once reads back unchanged."""


def unit_vector(name: str, vector: npt.ArrayLike, size: int) -> FloatArray:
    """Return the vector (size,) with length 1, read-only.

    Raises:
        InputError: its length differs from 1 by more than 1e-6.
    """
    array = finite_array(name, vector, (size,))
    length = math.hypot(*array)
    if not abs(length - 1.0) <= NEAR_UNIT:
        raise InputError(f"{name}: length {length:.9g} given; legal: 1 within {NEAR_UNIT:g}")
    return frozen(array if abs(length - 1.0) <= _ROUNDED_UNIT else array / length)


def own_clearance(value: float | None) -> float | None:
    """Return an obstacle's own clearance [m], None where the problem's counts.

    Raises:
        InputError: negative, not finite, or beyond 1e6 m.
    """
    return None if value is None else finite_number("clearance", value, minimum=0.0, maximum=LARGEST)
