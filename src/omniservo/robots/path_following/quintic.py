"""Quintics through samples of a motion with its first and second derivatives, in the Bernstein basis."""

from __future__ import annotations

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel, leaf


def quintic_pieces(w: FloatArray, q: FloatArray, slope: FloatArray, bend: FloatArray) -> FloatArray:
    """Return Bernstein coefficients (m − 1, 6, n) of the motion with q, q′, q″ (m, n) at w (m,), m ≥ 2.

    From either end of a piece h long: q, q ± h q′/5, q ± 2h q′/5 + h² q″/20.
    """
    h = np.diff(w)[:, None]
    begin, end = q[:-1], q[1:]
    a, b = h * slope[:-1], h * slope[1:]
    c, d = h * h * bend[:-1], h * h * bend[1:]
    after, before = begin + 0.4 * a + c / 20.0, end - 0.4 * b + d / 20.0
    return np.stack([begin, begin + a / 5.0, after, before, end - b / 5.0, end], axis=1)


@kernel
def pieces_between(
    w: FloatArray, pieces: FloatArray, begin: float, end: float
) -> tuple[FloatArray, FloatArray]:
    """Return where the pieces between two places of a motion begin and end (k + 1,), and them (k, 6, n).

    Args:
        w: (m,) where all pieces begin and end, ascending.
        pieces: (m − 1, 6, n) Bernstein coefficients.
        begin: w₀ ≤ begin
        end: begin < end ≤ w of the last.
    """
    first = 0
    while w[first + 1] <= begin:
        first += 1
    last = first
    while w[last + 1] < end:
        last += 1
    knots, found = w[first : last + 2].copy(), pieces[first : last + 1].copy()
    u, k = (begin - knots[0]) / (knots[1] - knots[0]), last - first
    for level in range(5):
        for c in range(5 - level):
            found[0, c] += u * (found[0, c + 1] - found[0, c])
    knots[0] = begin
    u = (knots[k + 1] - end) / (knots[k + 1] - knots[k])
    for level in range(5):
        for c in range(5, level, -1):
            found[k, c] += u * (found[k, c - 1] - found[k, c])
    knots[k + 1] = end
    return knots, found


@kernel
def quintic_values(w: FloatArray, pieces: FloatArray, at: FloatArray, order: int) -> FloatArray:
    """Return the values (k, n), or derivatives of order 1 or 2, at places (k,) within w.

    Args:
        w: (m,) where pieces begin and end, ascending.
        pieces: (m − 1, 6, n) Bernstein coefficients.
        at: (k,)
        order: 0, 1 or 2.
    """
    n = pieces.shape[2]
    found, basis = np.empty((at.shape[0], n)), np.empty(6)
    i, last = 0, pieces.shape[0] - 1
    for k in range(at.shape[0]):
        if at[k] < w[i]:
            i = 0
        while i < last and w[i + 1] <= at[k]:
            i += 1
        h = w[i + 1] - w[i]
        u = (at[k] - w[i]) / h
        basis[0] = 1.0
        for degree in range(1, 6 - order):
            basis[degree] = 0.0
            for c in range(degree, 0, -1):
                basis[c] = (1.0 - u) * basis[c] + u * basis[c - 1]
            basis[0] *= 1.0 - u
        scale = 1.0 if order == 0 else 5.0 / h if order == 1 else 20.0 / (h * h)
        for j in range(n):
            value = 0.0
            for c in range(6 - order):
                value += basis[c] * _difference(pieces, i, c, j, order)
            found[k, j] = scale * value
    return found


@leaf
def _difference(pieces: FloatArray, i: int, c: int, j: int, order: int) -> float:
    """Return the difference of an order 0, 1 or 2 between coefficients from c on."""
    if order == 0:
        return float(pieces[i, c, j])
    first = pieces[i, c + 1, j] - pieces[i, c, j]
    if order == 1:
        return float(first)
    return float((pieces[i, c + 2, j] - pieces[i, c + 1, j]) - first)
