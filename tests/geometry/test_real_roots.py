import numpy as np
import pytest

from omniservo.geometry.real_roots import real_roots


def found(coefficients, bound=1e4):
    roots = np.empty(len(coefficients))
    count = real_roots(np.asarray(coefficients, dtype=float), bound, roots)
    return roots[:count]


@pytest.mark.parametrize("degree", [1, 2, 5, 10])
def test_roots_agree_with_the_eigenvalues_of_the_companion_matrix(degree):
    rng = np.random.default_rng(degree)
    for _ in range(100):
        coefficients = rng.normal(size=degree + 1)
        all_roots = np.roots(coefficients[::-1])
        expected = np.sort(all_roots[(np.abs(all_roots.imag) < 1e-9) & (np.abs(all_roots) < 1e4)].real)
        np.testing.assert_allclose(found(coefficients), expected, rtol=1e-7)


def test_roots_outside_the_bound_are_left_out():
    np.testing.assert_allclose(found(np.poly([-3.0, 0.5, 2.0])[::-1], bound=1.0), [0.5])


def test_vanishing_leading_coefficients_lower_the_degree():
    np.testing.assert_allclose(found([-2.0, 1.0, 0.0, 0.0]), [2.0])


def test_a_polynomial_without_real_roots_has_none():
    assert len(found([1.0, 0.0, 1.0])) == 0
    assert len(found([0.0, 0.0])) == 0
