"""The loop that halves: what it covers, what it allows for rounding, what halves inherit, when it ends.

Families have tests of their own; here a family does nothing but write down what it is shown.
"""

from typing import NamedTuple

import numpy as np
import pytest

from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.geometry.kernel import kernel
from omniservo.geometry.polynomial import TINY
from omniservo.geometry.subdivision import (
    FAILS_AT_END,
    FAILS_AT_START,
    HOLDS,
    MAX_LEVEL,
    OPEN,
    PROVEN,
    REFUTED,
    UNDECIDED,
    Bounds,
    Piece,
    Pieces,
    first_piece,
    subdivide,
)

CURVE = np.array([[1.0, -2.0, 3.0, 5.0], [0.0, 4.0, 1.0, -1.0]])
ENDS = np.array([[0.5, 2.0], [1.0, -3.0], [2.0, 2.5]])


class Log(NamedTuple):
    """What a family was shown, and what it is to answer."""

    rows: FloatArray
    """start, width, bound, left, then the first and last coefficients of both curves, for each call"""
    count: IntArray
    depth: int
    """HOLDS at pieces halved so often"""
    answer: int
    """at the piece that begins at ``at``"""
    at: float


@kernel
def write_down(piece: Piece, log: Log) -> tuple[int, int]:
    row, last = log.rows[log.count[0]], piece.curve.shape[1] - 1
    log.count[0] += 1
    row[0], row[1], row[2], row[3] = piece.start, piece.width, piece.bound, piece.left[0]
    for k in range(2):
        row[4 + k], row[6 + k] = piece.curve[k, 0], piece.curve[k, last]
    if piece.ends.shape[1] > 0:
        for k in range(3):
            row[8 + k], row[11 + k] = piece.ends[k, 0], piece.ends[k, piece.ends.shape[1] - 1]
    piece.left[0] += 1
    if piece.start == log.at:
        return log.answer, 7
    return (HOLDS if piece.width <= 0.5**log.depth else OPEN), 3


@kernel
def decide_again(pieces: Pieces, bounds: Bounds, log: Log) -> tuple[int, float, int]:
    return subdivide(write_down, log, pieces, bounds)


@kernel
def decide(curve: FloatArray, ends: FloatArray, bounds: Bounds, log: Log) -> tuple[int, float, int]:
    return subdivide(write_down, log, first_piece(curve, ends, 1), bounds)


def run(depth, *, answer=HOLDS, at=-1.0, ends=ENDS, **limits):
    given = {"roundings": 5.0, "growth": 3.0, "error": 1e-3, "levels": MAX_LEVEL, "most": 1000} | limits
    log = Log(np.zeros((4000, 14)), np.zeros(1, dtype=np.int64), depth, answer, at)
    return decide(CURVE, ends, Bounds(**given), log), log.rows[: log.count[0]]


def at(controls, w):
    """A polynomial by de Casteljau's algorithm."""
    b = controls.copy()
    while b.shape[1] > 1:
        b = (1 - w) * b[:, :-1] + w * b[:, 1:]
    return b[:, 0]


@pytest.mark.slow
def test_proven_pieces_cover_all_of_the_interval_and_none_twice():
    answer, rows = run(4)
    assert answer == (PROVEN, 0.0, 0)
    held = rows[rows[:, 1] == 0.5**4]
    assert held[:, 0].tolist() == [k / 16 for k in range(16)]
    assert len(rows) == 31


def test_the_bound_grows_with_every_halving():
    _, rows = run(6)
    level = -np.log2(rows[:, 1])
    np.testing.assert_array_equal(rows[:, 2], (5.0 + level * 3.0) * 1e-3 + TINY)


def test_every_piece_has_the_coefficients_of_both_curves_on_it():
    _, rows = run(5)
    for row in rows:
        for w, first in ((row[0], True), (row[0] + row[1], False)):
            np.testing.assert_allclose(row[4:6] if first else row[6:8], at(CURVE, w), atol=1e-14)
            np.testing.assert_allclose(row[8:11] if first else row[11:14], at(ENDS, w), atol=1e-14)


def test_a_second_curve_may_be_missing():
    assert run(3, ends=np.zeros((3, 0)))[0] == (PROVEN, 0.0, 0)


def test_halves_inherit_what_is_shown_of_a_piece_and_a_new_proof_begins_with_nothing():
    pieces = first_piece(CURVE, ENDS, 1)
    for _ in range(2):
        log = Log(np.zeros((100, 14)), np.zeros(1, dtype=np.int64), 4, HOLDS, -1.0)
        pieces.curve[0], pieces.ends[0] = CURVE, ENDS
        decide_again(pieces, Bounds(5.0, 3.0, 1e-3, MAX_LEVEL, 1000), log)
        rows = log.rows[: log.count[0]]
        np.testing.assert_array_equal(rows[:, 3], -np.log2(rows[:, 1]))


@pytest.mark.parametrize(("shown", "w"), [(FAILS_AT_START, 0.375), (FAILS_AT_END, 0.5)])
def test_a_failure_is_told_with_its_end_and_what_it_is_about(shown, w):
    answer, rows = run(3, answer=shown, at=0.375)
    assert answer == (REFUTED, w, 7)
    assert rows[-1, 1] == 0.125  # the first piece that begins there


def test_a_piece_is_halved_so_often_and_no_more():
    answer, rows = run(10, levels=4)
    assert answer == (UNDECIDED, 0.0, 3)
    assert rows[:, 1].tolist() == [0.5**k for k in range(5)]


def test_a_proof_takes_so_many_halvings_and_no_more():
    assert run(4, most=15)[0][0] == PROVEN
    answer, rows = run(4, most=14)
    assert answer[0] == UNDECIDED
    assert len(rows) < 31
