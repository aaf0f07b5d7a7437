"""The real roots of a polynomial."""

import math

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel, leaf

MOST_STEPS = 80

CLOSE = 1e-11
"""A last step of so many times the root: Newton's error after it is nearly the square of that. Required
more, the step becomes rounding, and rounding ends no iteration."""


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


@leaf
def _roots_between(p: FloatArray, degree: int, turns: FloatArray, count: int, roots: FloatArray) -> int:
    """Write the root, if any, of each of the count + 1 intervals between ``turns``; return how many."""
    found = 0
    low = turns[0]
    at_low, _ = _value(p, degree, low)
    for i in range(count + 1):
        high = turns[i + 1]
        at_high, _ = _value(p, degree, high)
        if (at_low < 0.0) != (at_high < 0.0):
            left, right = low, high
            if count > 0 and i == 0:
                left, right = _beyond(p, degree, high, low)
            elif count > 0 and i == count:
                left, right = _beyond(p, degree, low, high)
            roots[found] = _root(p, degree, left, right, at_low < 0.0)
            found += 1
        low, at_low = high, at_high
    return found


@leaf
def _beyond(p: FloatArray, degree: int, turn: float, bound: float) -> tuple[float, float]:
    """Return an interval, no wider than its distance from the outermost ``turn``, with the root beyond it."""
    at_turn, _ = _value(p, degree, turn)
    near, reach = turn, math.copysign(0.5 + 0.5 * abs(turn), bound - turn)
    while abs(turn + reach) < abs(bound):
        far = turn + reach
        at_far, _ = _value(p, degree, far)
        if (at_far < 0.0) != (at_turn < 0.0):
            return min(near, far), max(near, far)
        near, reach = far, 2.0 * reach
    return min(near, bound), max(near, bound)


@leaf
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
        if before <= CLOSE * abs(x) + 1e-300 or trial == x:
            return trial
        x = trial
    return x


@leaf
def _value(p: FloatArray, degree: int, x: float) -> tuple[float, float]:
    """Return p(x) and p'(x)."""
    value, slope = p[degree], 0.0
    for i in range(degree - 1, -1, -1):
        slope = slope * x + value
        value = value * x + p[i]
    return value, slope
