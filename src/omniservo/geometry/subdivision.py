"""Claims about a curve on [0, 1], decided piece by piece: the one loop that halves until all is proven.

A curve is given by Bernstein coefficients, and each piece of it lies in the convex hull of its own. A family
of constraints only says, of one piece, whether these coefficients show its claim for the whole piece, or
whether an end of the piece shows that it fails (its `decide`). `subdivide` does the rest.

Why PROVEN is true:

- The pieces that are still to be decided, and those that were taken away, cover [0, 1] at every moment.
- A piece is taken away only where its coefficients show the claim for *every* curve whose coefficients are
  within ``bound`` of these. The exact ones are: they were so within count · error before any halving, and
  halving n-degree coefficients once adds n roundings (`polynomial.halve`), so after ``level`` halvings they
  are within (count + level · growth) · error + TINY.
- PROVEN is said when no piece is left.

REFUTED is as sound: an end coefficient is the curve's value there, within the same bound. All else is
UNDECIDED. docs/certificate.md derives the counts.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.geometry.kernel import inlined, kernel, leaf
from omniservo.geometry.polynomial import TINY, UNIT, halve
from omniservo.geometry.vectors import copy_into

PROVEN, REFUTED, UNDECIDED = 1, -1, 0
"""What a proof on [0, 1] can say."""

HOLDS, FAILS_AT_START, FAILS_AT_END, OPEN = 0, 1, 2, 3
"""What one piece can show."""

MAX_LEVEL = 26
"""An interval is halved at most so often: below 2⁻²⁶ a Bernstein bound gains less than it rounds."""

MAX_PIECES = 20_000
"""A proof that needs more pieces stops as UNDECIDED, so that its time is bounded."""


class Pieces(NamedTuple):
    """Room for the pieces of [0, 1] that are still to be decided, a stack; `first_piece` makes it."""

    curve: FloatArray
    """Coefficients (MAX_LEVEL + 2, m, n+1)."""
    ends: FloatArray
    """Coefficients of a second curve on the same pieces (MAX_LEVEL + 2, 3, k+1); (…, 3, 0): there is none."""
    start: FloatArray
    """Where each piece begins (MAX_LEVEL + 2,)."""
    level: IntArray
    """How often it was halved (MAX_LEVEL + 2,)."""
    left: IntArray
    """What of the claim is not shown yet on the piece (MAX_LEVEL + 2, p), as the family writes it; its halves
    inherit it."""


class Piece(NamedTuple):
    """One piece, as a family sees it."""

    curve: FloatArray
    """(m, n+1)"""
    ends: FloatArray
    """(3, k+1 or 0)"""
    left: IntArray
    """(p,), may be written to."""
    start: float
    width: float
    bound: float
    """No exact coefficient is farther from the computed one, in units of what ``error`` was stated for."""


class Bounds(NamedTuple):
    """How far computed coefficients may be from the exact ones, and when a proof gives up."""

    roundings: float
    """Before any halving, those of the family's test included (a count)."""
    growth: float
    """Roundings that a halving adds: the degree."""
    error: float
    """What one rounding may be."""
    levels: int
    """Most halvings of one piece, up to MAX_LEVEL."""
    most: int
    """Most halvings altogether."""


@kernel
def first_piece(curve: FloatArray, ends: FloatArray, left: int) -> Pieces:
    """Return room for pieces whose first is the whole curve (m, n+1) with ``ends`` (3, k+1 or 0)."""
    depth = MAX_LEVEL + 2
    pieces = Pieces(
        np.empty((depth, curve.shape[0], curve.shape[1])),
        np.empty((depth, ends.shape[0], ends.shape[1])),
        np.empty(depth),
        np.empty(depth, dtype=np.int64),
        np.zeros((depth, left), dtype=np.int64),
    )
    copy_into(curve, pieces.curve[0])
    copy_into(ends, pieces.ends[0])
    return pieces


@inlined
def subdivide(
    decide: Callable[[Piece, Any], tuple[int, int]], data: Any, pieces: Pieces, bounds: Bounds
) -> tuple[int, float, int]:
    """Decide a claim on [0, 1]; see above for why the answer is true.

    Args:
        decide: of one piece and ``data``: HOLDS, FAILS_AT_START, FAILS_AT_END or OPEN, and what it is about.
        data: whatever ``decide`` needs.
        pieces: the whole curve lies in row 0; all else is set here, ``left`` to 0.
        bounds: see there.

    Returns:
        PROVEN, or REFUTED or UNDECIDED with the w where that was found, and what it is about.
    """
    pieces.start[0], pieces.level[0] = 0.0, 0
    for k in range(pieces.left.shape[1]):
        pieces.left[0, k] = 0
    top, halvings = 0, 0
    while top >= 0:
        level = pieces.level[top]
        start, width = pieces.start[top], 0.5**level
        bound = (bounds.roundings + level * bounds.growth) * bounds.error + TINY
        curve, ends, left = pieces.curve[top], pieces.ends[top], pieces.left[top]
        shown, about = decide(Piece(curve, ends, left, start, width, bound), data)
        if shown == HOLDS:
            top -= 1
            continue
        if shown != OPEN:
            return REFUTED, start + (width if shown == FAILS_AT_END else 0.0), about
        halvings += 1
        if level >= bounds.levels or halvings > bounds.most:
            return UNDECIDED, start, about
        halve(curve, pieces.curve[top + 1], curve)
        if ends.shape[1] > 0:
            halve(ends, pieces.ends[top + 1], ends)
        for k in range(left.shape[0]):
            pieces.left[top + 1, k] = left[k]
        # The left half goes on top: a failure is found at the smallest w first.
        pieces.start[top + 1], pieces.level[top + 1] = start, level + 1
        pieces.start[top], pieces.level[top] = start + 0.5 * width, level + 1
        top += 1
    return PROVEN, 0.0, 0


@kernel
def prove_nonnegative(controls: FloatArray, count: float, size: float) -> tuple[int, float]:
    """Decide whether a polynomial is ≥ 0 on [0, 1]: PROVEN, REFUTED with a w that shows it, or UNDECIDED.

    Args:
        controls: Bernstein coefficients (1, n+1), each within count · UNIT · size of the exact one.
        count: the count of those coefficients.
        size: their magnitude.
    """
    n = controls.shape[1] - 1
    if _all_at_least(controls, count * UNIT * size + TINY):
        return PROVEN, 0.0
    bounds = Bounds(count, float(n), UNIT * size, MAX_LEVEL, MAX_PIECES)
    status, w, _ = subdivide(_sign, 0, first_piece(controls, np.empty((3, 0)), 0), bounds)
    return status, w


@leaf
def _sign(piece: Piece, data: int) -> tuple[int, int]:
    """Show a polynomial ≥ 0, or < 0 at an end."""
    if _all_at_least(piece.curve, piece.bound):
        return HOLDS, 0
    if piece.curve[0, 0] < -piece.bound:
        return FAILS_AT_START, 0
    if piece.curve[0, piece.curve.shape[1] - 1] < -piece.bound:
        return FAILS_AT_END, 0
    return OPEN, 0


@leaf
def _all_at_least(controls: FloatArray, bound: float) -> bool:
    """Tell whether every coefficient (1, n+1) is ≥ bound; NaN is not."""
    holds = True
    for k in range(controls.shape[1]):
        holds = holds and controls[0, k] >= bound
    return holds
