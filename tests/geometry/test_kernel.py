"""What a kernel promises about its compilation."""

from omniservo.geometry.kernel import kernel


@kernel
def _power(x: float, exponent: int) -> float:
    return float(x**exponent)


@kernel
def _square_and_cube(x: float) -> float:
    return _power(x, 2) + _power(x, 3)


def test_a_kernel_is_compiled_once_for_all_constants_that_kernels_call_it_with():
    assert _square_and_cube(2.0) == 12.0
    assert _power(2.0, 4) == 16.0
    assert len(_power.signatures) == 1
