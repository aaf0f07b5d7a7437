"""A named tuple that is held says in a kernel what it says outside."""

from typing import NamedTuple

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.held import held
from omniservo.geometry.kernel import kernel


class Inner(NamedTuple):
    values: FloatArray


class Outer(NamedTuple):
    row: FloatArray
    table: FloatArray
    inner: Inner


@kernel
def add_up(outer: Outer) -> float:
    outer.row[0] += 1.0
    return float(outer.row[0] + 10.0 * outer.table[1, 0] + 100.0 * outer.inner.values[2])


@kernel
def add_up_held(outer: Outer) -> float:
    return add_up(held(held(outer)))


def test_every_field_is_where_it_was_and_arrays_are_shared():
    outer = Outer(np.array([1.0]), np.array([[2.0, 3.0], [4.0, 5.0]]), Inner(np.array([6.0, 7.0, 8.0])))
    assert add_up_held(outer) == 2.0 + 40.0 + 800.0
    assert outer.row[0] == 2.0
    assert add_up(outer) == 3.0 + 40.0 + 800.0


def test_in_the_interpreter_nothing_happens():
    outer = Inner(np.zeros(1))
    assert held(outer) is outer
