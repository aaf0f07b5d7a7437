"""What every value of a planning problem is checked for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray, finite_array, frozen

LARGEST = 1e6
"""Coordinates and lengths are at most this [m]: squares and their squares stay far from overflow."""


def bounded_array(name: str, value: npt.ArrayLike, shape: Sequence[int | None]) -> FloatArray:
    """Return ``value`` as a read-only array of this shape with every number in [−1e6, 1e6].

    Raises:
        InputError: not numbers, of another shape, not finite, or larger.
    """
    array = frozen(finite_array(name, value, shape))
    if array.size and np.abs(array).max() > LARGEST:
        raise InputError(f"{name}: {array.flat[np.abs(array).argmax()]:g} given; legal: -1e6 to 1e6")
    return array
