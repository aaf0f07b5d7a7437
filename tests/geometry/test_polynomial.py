"""Bernstein polynomials: exact references in rational arithmetic."""

from fractions import Fraction
from math import comb

import numpy as np
import pytest

from omniservo.geometry.polynomial import (
    BINOMIALS,
    MAX_DEGREE,
    UNIT,
    add_product,
    bernstein_from_power,
    halve,
    magnitude,
    power_from_bernstein,
    scale,
)
from omniservo.geometry.subdivision import PROVEN, REFUTED, UNDECIDED, prove_nonnegative


def exact_controls(powers: list[Fraction]) -> list[Fraction]:
    """Bernstein coefficients of Σ aₖ wᵏ, ``powers`` lowest first."""
    n = len(powers) - 1
    return [sum(Fraction(comb(i, k), comb(n, k)) * powers[k] for k in range(i + 1)) for i in range(n + 1)]


def exact_value(powers: list[Fraction], w: Fraction) -> Fraction:
    return sum((a * w**k for k, a in enumerate(powers)), Fraction(0))


def lowest_first(coefficients: np.ndarray) -> list[Fraction]:
    return [Fraction(float(a)) for a in coefficients[::-1]]


def test_every_binomial_is_exact():
    for n in range(MAX_DEGREE + 1):
        for k in range(n + 1):
            assert BINOMIALS[n, k] == comb(n, k)
            assert int(BINOMIALS[n, k]) == comb(n, k)


@pytest.mark.parametrize("degree", [1, 2, 3, 6, 16, 32])
def test_conversion_error_stays_below_its_bound(degree):
    rng = np.random.default_rng(degree)
    worst = 0.0
    for _ in range(30):
        powers = rng.normal(size=(1, degree + 1)) * 10.0 ** rng.uniform(-6, 6, size=(1, degree + 1))
        controls = bernstein_from_power(powers)[0]
        exact = exact_controls(lowest_first(powers[0]))
        error = max(abs(Fraction(float(c)) - e) for c, e in zip(controls, exact, strict=True))
        worst = max(worst, float(error) / ((degree + 2) * UNIT * magnitude(powers)))
    assert worst <= 1.0


@pytest.mark.parametrize("degree", [1, 2, 5, 12])
def test_power_and_bernstein_coefficients_are_inverse(degree):
    powers = np.random.default_rng(3).normal(size=(3, degree + 1))
    assert np.allclose(power_from_bernstein(bernstein_from_power(powers)), powers, atol=1e-12 * 4.0**degree)


@pytest.mark.parametrize(("m", "n"), [(1, 1), (2, 4), (4, 2), (8, 3), (16, 16)])
def test_product_error_stays_below_its_bound(m, n):
    rng = np.random.default_rng(m * 20 + n)
    for _ in range(20):
        a, b = rng.normal(size=(1, m + 1)), rng.normal(size=(1, n + 1))
        out = np.zeros(m + n + 1)
        add_product(scale(a)[0], scale(b)[0], out)
        size = np.abs(a).max() * np.abs(b).max()
        for k in range(m + n + 1):
            exact = sum(
                comb(m, i) * Fraction(float(a[0, i])) * comb(n, k - i) * Fraction(float(b[0, k - i]))
                for i in range(m + 1)
                if 0 <= k - i <= n
            ) / comb(m + n, k)
            error = abs(Fraction(float(out[k] / BINOMIALS[m + n, k])) - exact)
            assert float(error) <= (min(m, n) + 5) * UNIT * size


def test_halves_are_the_polynomial_on_half_the_interval():
    rng = np.random.default_rng(5)
    for degree in (1, 2, 6, 12):
        controls = rng.normal(size=(3, degree + 1))
        left, right = np.empty_like(controls), np.empty_like(controls)
        halve(controls, left, right)
        for row in range(3):
            exact = [Fraction(float(c)) for c in controls[row]]
            for k in range(degree + 1):
                first = sum(comb(k, i) * exact[i] for i in range(k + 1)) / 2**k
                last = sum(comb(k, i) * exact[degree - i] for i in range(k + 1)) / 2**k
                bound = degree * UNIT * np.abs(controls[row]).max()
                assert abs(float(Fraction(float(left[row, k])) - first)) <= bound
                assert abs(float(Fraction(float(right[row, degree - k])) - last)) <= bound


def test_halving_in_place_gives_the_same_halves():
    controls = np.random.default_rng(6).normal(size=(2, 7))
    left, right = np.empty_like(controls), np.empty_like(controls)
    halve(controls, left, right)
    again, own = np.empty_like(controls), controls.copy()
    halve(own, again, own)
    assert np.array_equal(left, again)
    assert np.array_equal(right, own)


def decide(powers: np.ndarray) -> tuple[int, float]:
    """Decide a polynomial given by powers, highest first."""
    coefficients = np.ascontiguousarray(powers[None, :])
    n = len(powers) - 1
    return prove_nonnegative(bernstein_from_power(coefficients), n + 2.0, magnitude(coefficients))


@pytest.mark.parametrize("relative", [1e-3, 1e-6, 1e-9, 1e-11])
def test_a_dip_below_zero_is_never_proven_however_narrow(relative):
    rng = np.random.default_rng(11)
    for _ in range(300):
        w0 = rng.uniform(0.0, 1.0)
        touching = np.array([1.0, -2.0 * w0, w0 * w0])
        quadratic = np.polymul([rng.uniform(0.1, 3.0)], touching)
        other = np.polymul(touching, [1.0, 0.0, rng.uniform(0.5, 2.0)]) if rng.random() < 0.5 else quadratic
        dipping = other.copy()
        dipping[-1] -= relative * np.abs(other).sum()
        lifted = other.copy()
        lifted[-1] += relative * np.abs(other).sum()
        status, w = decide(dipping)
        assert status == REFUTED
        assert exact_value(lowest_first(dipping), Fraction(w)) < 0
        assert decide(lifted)[0] == PROVEN


def test_a_polynomial_that_touches_zero_inside_is_undecided():
    assert decide(np.array([1.0, -1.0, 0.25]))[0] == UNDECIDED
    third = 1.0 / 3.0
    assert decide(np.array([1.0, -2.0 * third, third * third]))[0] != REFUTED


@pytest.mark.slow
def test_random_polynomials_are_decided_as_exact_arithmetic_decides():
    rng = np.random.default_rng(7)
    seen = {PROVEN: 0, REFUTED: 0}
    for _ in range(500):
        powers = rng.normal(size=rng.integers(2, 8)) + 0.0
        powers[-1] = abs(powers[-1]) * 2.0
        status, w = decide(powers)
        seen[status] += 1
        exact = lowest_first(powers)
        smallest = min(exact_value(exact, Fraction(i, 256)) for i in range(257))
        if status == PROVEN:
            assert smallest >= 0
        else:
            assert exact_value(exact, Fraction(w)) < 0
    assert min(seen.values()) > 50


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_is_never_proven(bad):
    for k in range(4):
        controls = np.ones((1, 4))
        controls[0, k] = bad
        if bad != np.inf:
            assert prove_nonnegative(controls, 5.0, 1.0)[0] != PROVEN
        assert prove_nonnegative(controls, 5.0, abs(bad))[0] != PROVEN


def test_tiny_and_huge_polynomials_are_decided_safely():
    assert decide(np.array([1e-200, 1e-200, 1e-200]))[0] == PROVEN
    assert decide(np.array([1e-200, 0.0, -1e-200]))[0] == REFUTED
    assert decide(np.array([1e-300, 0.0, 1e-310]))[0] == UNDECIDED
    assert decide(np.array([1e300, -1e300, 1e300]))[0] == PROVEN
