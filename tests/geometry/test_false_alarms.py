"""Expected false alarms against exact fractions, and where binomial coefficients are beyond floats."""

import math
from fractions import Fraction

import pytest

from omniservo.geometry.false_alarms import false_alarms


@pytest.mark.parametrize(("n", "k", "sampled"), [(8, 8, 5), (30, 11, 4), (60, 25, 8), (200, 20, 3)])
def test_it_is_what_exact_fractions_say(n, k, sampled):
    share = Fraction(3, 40)
    exact = 4 * math.comb(n, k) * math.comb(k, sampled) * share ** (k - sampled)
    assert false_alarms(n, k, sampled, float(share), 4.0) == pytest.approx(min(float(exact), math.exp(50.0)))


def test_thousands_of_data_are_counted():
    assert false_alarms(4000, 2000, 5, 0.01, 4.0) == 0.0
    assert false_alarms(4000, 60, 5, 0.01, 4.0) == math.exp(50.0)
    assert 0.0 < false_alarms(4000, 400, 5, 0.01, 4.0) < 1e-100


def test_fewer_than_a_sample_are_none_and_no_chance_leaves_the_sample_alone():
    assert false_alarms(10, 4, 5, 0.5, 4.0) == 0.0
    assert false_alarms(10, 6, 5, 0.0, 4.0) < 1e-200
    assert false_alarms(10, 5, 5, 0.0, 4.0) == pytest.approx(4.0 * math.comb(10, 5))
    assert false_alarms(10, 8, 5, 3.0, 1.0) == pytest.approx(math.comb(10, 8) * math.comb(8, 5))
