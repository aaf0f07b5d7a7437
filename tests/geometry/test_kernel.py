"""What kernels promise about their compilation."""

import math
import os
import signal
import threading

import numpy as np
import pytest

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel, leaf


@kernel
def _power(x: float, exponent: int) -> float:
    return float(x**exponent)


@kernel
def _square_and_cube(x: float) -> float:
    return _power(x, 2) + _power(x, 3)


@kernel
def _sum_of_new(n: int) -> float:
    return float(np.ones(n).sum())


@leaf
def _first_and_new(x: FloatArray) -> tuple[float, float]:
    return x[0], _sum_of_new(3)


@leaf
def _makes_an_array(n: int) -> float:
    return float(np.ones(n).sum())


@kernel
def _slowly_several(n: int) -> tuple[int, FloatArray, FloatArray, FloatArray]:
    total = np.zeros(3)
    for k in range(n):
        total[k % 3] += math.sin(k)
    return n, total, 2.0 * total, 3.0 * total


def test_a_ctrl_c_while_a_kernel_works_is_an_interrupt_and_no_crash():
    _slowly_several(1)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # what a shell starts with & ignores it
    try:
        pressed = threading.Timer(0.02, os.kill, (os.getpid(), signal.SIGINT))
        pressed.start()
        with pytest.raises(KeyboardInterrupt):
            for _ in range(100):
                _slowly_several(10_000_000)
        pressed.join()
    finally:
        signal.signal(signal.SIGINT, before)


def test_a_kernel_is_compiled_once_for_all_constants_that_kernels_call_it_with():
    assert _square_and_cube(2.0) == 12.0
    assert _power(2.0, 4) == 16.0
    assert len(_power.signatures) == 1


def test_what_a_leaf_calls_may_make_arrays():
    assert _first_and_new(np.array([5.0, 6.0])) == (5.0, 3.0)


def test_a_leaf_that_makes_an_array_is_refused():
    with pytest.raises(Exception, match="Only accept returning of array|NRT required"):
        _makes_an_array(3)


def test_a_leaf_that_would_return_an_array_is_refused():
    def view(x: FloatArray) -> FloatArray:
        return x[1:]

    with pytest.raises(TypeError, match="numbers alone"):
        leaf(view)
