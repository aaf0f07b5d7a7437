"""The real roots of a polynomial."""

import math

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel

MOST_STEPS = 80


@kernel
def real_roots(coefficients: FloatArray, bound: float, roots: FloatArray) -> int:
    """Write the real roots in [−bound, bound], ascending, and return how many they are.

    ``coefficients`` (d + 1,), lowest power first; ``roots`` has room for d. Between the roots of its
    derivative a polynomial is monotonic, so each such interval holds at most one root, which a bracketed
    Newton iteration finds; the derivatives come first, from the line upwards. A root at which the sign does
    not change is not found.
    """
    degree = coefficients.shape[0] - 1
    largest = 0.0
    for i in range(degree + 1):
        largest = max(largest, abs(coefficients[i]))
    while degree > 0 and abs(coefficients[degree]) <= 1e-15 * largest:
        degree -= 1
    p, turns = np.empty(degree + 1), np.empty(degree + 2)
    count = 0
    turns[0], turns[1] = -bound, bound
    for order in range(degree - 1, -1, -1):
        # p: the derivative of this order, of degree − order
        for i in range(degree - order + 1):
            p[i] = coefficients[i + order]
            for k in range(order):
                p[i] *= i + order - k
        count = _roots_between(p, degree - order, turns, count, roots)
        for i in range(count):
            turns[i + 1] = roots[i]
        turns[count + 1] = bound
    return count


@kernel
def _roots_between(p: FloatArray, degree: int, turns: FloatArray, count: int, roots: FloatArray) -> int:
    """Write the root, if any, of each of the count + 1 intervals between ``turns``; return how many."""
    found = 0
    low = turns[0]
    at_low, _ = _value(p, degree, low)
    for i in range(count + 1):
        high = turns[i + 1]
        at_high, _ = _value(p, degree, high)
        if (at_low < 0.0) != (at_high < 0.0):
            roots[found] = _root(p, degree, low, high, at_low < 0.0)
            found += 1
        low, at_low = high, at_high
    return found


@kernel
def _root(p: FloatArray, degree: int, low: float, high: float, rising: bool) -> float:
    """Return the root between ``low`` and ``high``: Newton's steps, and halving where they lead outside."""
    x = 0.5 * (low + high)
    before = high - low
    for _ in range(MOST_STEPS):
        value, slope = _value(p, degree, x)
        if (value < 0.0) == rising:
            low = x
        else:
            high = x
        step = value / slope if slope != 0.0 else math.inf
        trial = x - step
        if not low < trial < high or abs(step) > 0.5 * before:
            trial = 0.5 * (low + high)
            step = x - trial
        before = abs(step)
        if before <= 4e-16 * abs(x) + 1e-300 or trial == x:
            return trial
        x = trial
    return x


@kernel
def _value(p: FloatArray, degree: int, x: float) -> tuple[float, float]:
    """Return p(x) and p'(x)."""
    value, slope = p[degree], 0.0
    for i in range(degree - 1, -1, -1):
        slope = slope * x + value
        value = value * x + p[i]
    return value, slope
