"""The core: integer polynomials, decisions on [0, 1], rational enclosures."""

from fractions import Fraction
from math import comb

import mpmath
import numpy as np
import pytest

from omniservo.verification.decision import HOLDS, decide, nonnegative, root_sum
from omniservo.verification.enclosures import ERROR, cosine_and_sine, root_above, root_below, rounded_up
from omniservo.verification.polynomials import (
    bernstein,
    halves,
    integers,
    minus,
    sign_changes,
    squares,
    sturm_chain,
    times,
    value,
)

RNG = np.random.default_rng(7)


def random_polynomial(degree, size=10**20):
    return [int(x * size) for x in RNG.normal(size=degree + 1)]


@pytest.mark.parametrize("degree", [0, 1, 2, 6, 12, 24])
def test_bernstein_coefficients_reproduce_the_polynomial(degree):
    p = random_polynomial(degree)
    b = bernstein(p)
    factor = Fraction(b[0], p[0])
    for w in (Fraction(0), Fraction(1, 3), Fraction(5, 7), Fraction(1)):
        terms = (b[i] * comb(degree, i) * w**i * (1 - w) ** (degree - i) for i in range(degree + 1))
        assert sum(terms) == factor * value(p, w)


@pytest.mark.parametrize("degree", [1, 2, 6, 13])
def test_halves_are_the_polynomial_on_both_halves(degree):
    p = random_polynomial(degree)
    left, right = halves(bernstein(p))
    half = Fraction(1, 2)
    first = [a * half**i for i, a in enumerate(p)]
    for part, shift in ((left, Fraction(0)), (right, half)):
        moved = integers(*(value(p, shift + Fraction(k, 2 * degree)) for k in range(degree + 1)))
        again = [
            sum(part[i] * comb(degree, i) * w**i * (1 - w) ** (degree - i) for i in range(degree + 1))
            for w in (Fraction(k, degree) for k in range(degree + 1))
        ]
        assert len({Fraction(a, b) for a, b in zip(again, moved, strict=True) if b}) == 1
    assert len(first) == len(left)


def test_sturm_counts_distinct_roots_with_multiplicity_ignored():
    p = times(times([-1, 3], [-1, 3]), times([-2, 3], [5, 1]))  # 1/3 twice, 2/3, -5
    chain = sturm_chain(p)
    count = sign_changes(chain, Fraction(1, 100)) - sign_changes(chain, Fraction(99, 100))
    assert count == 2


@pytest.mark.parametrize("degree", [3, 8, 15])
def test_sturm_agrees_with_numpy_roots(degree):
    for _ in range(20):
        p = random_polynomial(degree, 1000)
        if p[-1] == 0:
            continue
        roots = np.roots(p[::-1])
        expected = sum(abs(r.imag) < 1e-9 and 0 < r.real < 1 for r in roots)
        chain = sturm_chain(p)
        assert sign_changes(chain, Fraction(0)) - sign_changes(chain, Fraction(1)) == expected


def test_touching_zero_between_dyadic_points_holds():
    assert nonnegative(squares([-1, 3])) == HOLDS
    assert nonnegative(times(squares([-1, 3]), squares([-5, 7]))) == HOLDS


def test_touching_zero_is_no_strict_positivity():
    assert decide([squares([-1, 3])], [[0]], strict=True).verdict == "undecided"
    assert decide([squares([-1, 2])], [[0]], strict=True).verdict == "violated"


@pytest.mark.parametrize("below", [Fraction(1, 10**9), Fraction(1, 10**15), Fraction(1, 2**90)])
def test_dip_below_zero_is_found_however_small(below):
    found = nonnegative(minus(squares([-1, 3]), below))
    assert found.verdict == "violated"
    assert value(squares([-1, 3]), found.w) < below


@pytest.mark.parametrize("above", [Fraction(1, 10**9), Fraction(1, 2**90)])
def test_tiny_positive_minimum_is_proven(above):
    assert nonnegative(minus(squares([-1, 3]), -above)) == HOLDS
    assert decide([minus(squares([-1, 3]), -above)], [[0]], strict=True) == HOLDS


@pytest.mark.parametrize("root", [Fraction(1, 2), Fraction(3, 8), Fraction(0)])
def test_negative_beside_a_root_at_the_end_of_a_piece_is_found(root):
    # (w - root)(w - root - 2^-90): the first root is an end of every piece that the second one lies in.
    gap = Fraction(1, 2**90)
    p = integers(root * (root + gap), -(2 * root + gap), Fraction(1))
    found = nonnegative(p)
    assert found.verdict == "violated"
    assert value(p, found.w) < 0


def test_negative_between_two_close_roots_is_found():
    eps = Fraction(1, 10**12)
    p = integers(*(Fraction(1, 3) * (Fraction(1, 3) + eps), -(Fraction(2, 3) + eps), Fraction(1)))
    assert nonnegative(p).verdict == "violated"


def test_branches_that_meet_in_one_point_hold_together():
    # w <= 1/3 or w >= 1/3: both are 0 at 1/3 and there is no overlap
    assert decide([[1, -3], [-1, 3]], [[0], [1]]) == HOLDS
    assert decide([[1, -3], [-2, 3]], [[0], [1]]).verdict == "violated"


def test_a_gap_between_two_branches_is_found_however_small():
    """w <= 1/3 or w >= 1/3 + 2^-60: each alone changes its sign once on a piece of 2^-40."""
    begin, end = Fraction(1, 3), Fraction(1, 3) + Fraction(1, 2**60)
    found = decide([integers(begin, Fraction(-1)), integers(-end, Fraction(1))], [[0], [1]])
    assert found.verdict == "violated"
    assert begin < found.w < end


def test_zero_polynomial_holds_but_not_strictly():
    assert nonnegative([0, 0, 0]) == HOLDS
    assert decide([[0, 0]], [[0]], strict=True).verdict == "violated"


def test_root_sum_agrees_with_dense_samples():
    w = np.linspace(0, 1, 4001)
    seen = {"holds": 0, "violated": 0}
    for _ in range(400):
        a, b = RNG.integers(-9, 10, size=(2, 4)).tolist()
        a = [a[0] + int(RNG.integers(0, 12)), *a[1:]]
        q = squares(RNG.integers(-5, 6, size=3).tolist(), RNG.integers(-5, 6, size=3).tolist())
        sampled = np.polyval(a[::-1], w) + np.polyval(b[::-1], w) * np.sqrt(np.polyval(q[::-1], w).clip(0))
        if abs(sampled.min()) < 1e-3:
            continue
        verdict = root_sum(a, b, q).verdict
        assert verdict == ("holds" if sampled.min() > 0 else "violated")
        assert root_sum(a, b, q, strict=True).verdict == verdict
        seen[verdict] += 1
    assert min(seen.values()) > 30


def test_root_sum_that_vanishes_everywhere_holds_but_not_strictly():
    p = [3, -1, 5]
    assert root_sum([-a for a in p], [1], squares(p)) == HOLDS
    assert root_sum([-a for a in p], [1], squares(p), strict=True).verdict != "holds"


@pytest.mark.parametrize("angle", [0.0, 1e-12, 0.3, 1.0, 1.6, 3.14, 3.2, -1.6, 4.0])
def test_cosine_and_sine_lie_within_the_stated_error(angle):
    mpmath.mp.prec = 500
    for ours, theirs in zip(cosine_and_sine(Fraction(angle)), (mpmath.cos, mpmath.sin), strict=True):
        exact = mpmath.mpf(ours.numerator) / ours.denominator
        assert abs(exact - theirs(mpmath.mpf(angle))) < mpmath.mpf(2) ** -290
    assert Fraction(1, 2**290) == ERROR


@pytest.mark.parametrize("x", [Fraction(0), Fraction(2), Fraction(1, 3), Fraction(9, 4), Fraction(10**40, 7)])
def test_roots_are_enclosed(x):
    assert root_below(x) ** 2 <= x <= root_above(x) ** 2
    assert root_above(x) - root_below(x) <= Fraction(1, 2**320)


def test_rounding_up_never_lowers():
    for x in (Fraction(1, 3), Fraction(-1, 3), Fraction(5), Fraction(-7, 2**200)):
        assert 0 <= rounded_up(x) - x < Fraction(1, 2**127)
