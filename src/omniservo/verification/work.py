"""How much exact arithmetic one call may take: counted, so that the answer is the same on every machine.

What an operation costs depends on how long its integers are: a file may put 1e-300 beside 1e300, and their
products have tens of thousands of bits.
"""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from fractions import Fraction

MOST_OPERATIONS = 100_000_000
"""What one plan may cost. The unit is an addition of two short integers, about 60 ns in CPython."""
_left: ContextVar[list[int] | None] = ContextVar("left", default=None)


class WorkExceeded(Exception):
    """The plan would take more work than one call may."""


@contextmanager
def bounded() -> Iterator[list[int]]:
    """Count the work done inside; what is left of it stands in the list."""
    left = [MOST_OPERATIONS]
    token = _left.set(left)
    try:
        yield left
    finally:
        _left.reset(token)


def spend(operations: int) -> None:
    """Count operations; outside of `bounded` nothing is counted.

    Raises:
        WorkExceeded: they are more than are left.
    """
    left = _left.get()
    if left is not None:
        left[0] -= operations
        if left[0] < 0:
            raise WorkExceeded(f"more work than this verifier takes on: {MOST_OPERATIONS} operations")


def bits(integers: Iterable[int]) -> int:
    """Return the length of the longest."""
    return max(map(int.bit_length, integers), default=0)


def products(count: int, first: int, second: int) -> int:
    """Return what products of integers of so many bits cost."""
    return count * (1 + (first * second >> 16))


def spend_on_fractions(count: int, *like: Fraction) -> None:
    """Count operations on fractions of such lengths: each of them takes a common divisor out."""
    longest = bits(x for f in like for x in (f.numerator, f.denominator))
    spend(count * (16 + (longest * longest >> 13)))
