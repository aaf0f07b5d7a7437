"""Loops over arrays of numbers. NumPy's own of the same meaning take a kernel most of a second to compile."""

import math

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import leaf


@leaf
def fill(values: FloatArray, value: float) -> None:
    """Set every item of (n,) to ``value``."""
    for i in range(values.shape[0]):
        values[i] = value


@leaf
def write(values: FloatArray, into: FloatArray) -> None:
    """Copy (n,) to the first n items of ``into``."""
    for i in range(values.shape[0]):
        into[i] = values[i]


@leaf
def copy_into(source: FloatArray, out: FloatArray) -> None:
    """Copy (m, n) into (m, n)."""
    for i in range(source.shape[0]):
        for j in range(source.shape[1]):
            out[i, j] = source[i, j]


@leaf
def smallest(values: FloatArray) -> float:
    """Return the smallest of ``values``; infinity where there are none."""
    least = math.inf
    for i in range(values.shape[0]):
        least = min(least, values[i])
    return least
