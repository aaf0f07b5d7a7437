"""Rational bounds of the few numbers that are not rational: square roots, cosines and sines."""

from fractions import Fraction
from math import isqrt

_BITS = 320
ERROR = Fraction(1, 1 << 290)
"""Every value returned here is at most this far from the truth."""
_COARSE = 1 << 128


def root_below(x: Fraction) -> Fraction:
    """Return a number ≤ √x, for x ≥ 0."""
    return Fraction(isqrt((x.numerator << 2 * _BITS) // x.denominator), 1 << _BITS)


def root_above(x: Fraction) -> Fraction:
    """Return a number ≥ √x, for x ≥ 0."""
    below = root_below(x)
    return below if below * below == x else below + Fraction(1, 1 << _BITS)


def cosine_and_sine(angle: Fraction) -> tuple[Fraction, Fraction]:
    """Return cos and sin of an angle [rad], |angle| ≤ 4, within `ERROR`.

    128 terms of the exponential series in units of 2⁻³²⁰. Rounding the angle moves both by at most a unit;
    a term is off by at most e⁴ < 55 units, all together by less than 2¹³; the rest of the series is below
    4¹²⁹/129! < 2⁻⁴⁰⁰.
    """
    unit = 1 << _BITS
    x = (angle.numerator * unit) // angle.denominator
    sums, term = [0, 0], unit
    for k in range(128):
        sums[k % 2] += -term if k % 4 > 1 else term
        term = (term * x // unit) // (k + 1)
    return Fraction(sums[0], unit), Fraction(sums[1], unit)


def rounded_up(x: Fraction) -> Fraction:
    """Return a number ≥ x with few digits, at most 2⁻¹²⁸ above it."""
    return Fraction(-((-x.numerator * _COARSE) // x.denominator), _COARSE)
