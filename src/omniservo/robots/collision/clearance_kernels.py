"""Every pair of bodies kept apart on pieces of a joint path, compiled; the caller measures distances."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.geometry.held import held
from omniservo.geometry.kernel import inlined, kernel, leaf
from omniservo.geometry.vectors import copy_into
from omniservo.robots.collision.gap_kernels import farthest_moves, lower_gaps, middle_of_piece, rounding
from omniservo.robots.collision.gap_search import widen
from omniservo.robots.collision.shapes import Bodies, PlacedShapes, Shapes
from omniservo.robots.kinematics.chain import Chain, carry

CLEAR, MEASURE, TOO_CLOSE, UNDECIDED = range(4)
"""What `prove_pieces` returns. MEASURE: the directions between the pairs in `Work.unmeasured` are wanted, in
the configuration that the scene now shows; then it is called again."""

SIZE, UNMEASURED, POSTURES = range(3)
"""Places in `Work.counts`: pieces still to be proven, pairs to be measured, configurations checked."""

PROVEN, LEAST, LEAST_W, LEAST_GAP, LEAST_PAIR = range(5)
"""Places in `Work.found`: the least that was left beyond what was needed; and of the measured pair with the
least beyond what is required: that, w, gap and pair."""

HALVINGS = 32
"""Room for them in `Work`."""

_SAME = 1e-6
"""[m] between the bounds of a distance that count as one"""

_MOST_POSTURES = 20_000
_SHORTEST = 2.0**-24


class Work(NamedTuple):
    """The pieces that are left, the last one first, and what was found."""

    spans: FloatArray
    """(d, 2) w where each piece begins and ends"""
    pieces: FloatArray
    """(d, k, n) Bernstein coefficients [rad]"""
    pairs: IntArray
    """(d, p) those open on it"""
    sizes: IntArray
    """(d,) how many"""
    unmeasured: IntArray
    """(p,)"""
    counts: IntArray
    """(3,)"""
    found: FloatArray
    """(5,)"""


class Gaps(NamedTuple):
    """What is known of pairs, in the order in which a piece lists them, in its middle."""

    least: FloatArray
    """(p,) lower bounds of their distances [m]"""
    most: FloatArray
    """(p,) upper ones [m]; ∞: none is known"""
    needed: FloatArray
    """(p,) what each pair needs there to be clear on the whole piece [m]"""
    enough: FloatArray
    """(p,) with so much [m] a pair leaves more than is proven of others, and is not bounded any closer"""


@kernel
def prove_pieces(chain: Chain, shapes: Shapes, scene: PlacedShapes, asked: FloatArray, work: Work) -> int:
    """Halve pieces of a joint path until all pairs are clear on them; return why it stops.

    On a part of the path a pair is clear if in its middle the two are farther apart than what is required
    (p,) plus what the joints can take of that before the part ends: `farthest_moves` of the largest distance
    of the part's Bernstein coefficients from its middle. How far apart they are there is bounded from below
    by slabs (`lower_gaps`) across directions that were found in earlier configurations, or by `widen`; only
    pairs that may touch, so that `widen` has no answer, are measured. What is clear on a part is so on its
    halves.
    """
    chain, shapes, scene, work = held(chain), held(shapes), held(scene), held(work)
    counts, most = work.counts, asked.shape[0]
    rows, n = work.pieces.shape[1], work.pieces.shape[2]
    first, second, turns = np.empty((rows, n)), np.empty((rows, n)), np.empty(n)
    gaps = Gaps(np.empty(most), np.empty(most), np.empty(most), np.empty(most))
    bodies = Bodies(
        shapes.kinds, shapes.sizes, shapes.radii, shapes.corners, shapes.firsts, scene.places, scene.axes
    )
    while counts[SIZE] > 0:
        top = counts[SIZE] - 1
        pairs, count = work.pairs[top], work.sizes[top]
        middle_of_piece(work.pieces[top], first, second, turns)
        fresh = counts[UNMEASURED] == 0
        if fresh:
            counts[POSTURES] += 1
            place_all(chain, shapes, first[rows - 1], scene)
        _foresee(shapes, scene, asked, pairs[:count], turns, work.found[PROVEN], gaps)
        lower_gaps(bodies, shapes.pairs, pairs[:count], scene.normals, gaps.enough, gaps.least)
        _search(bodies, shapes.pairs, scene.normals, pairs[:count], gaps)
        if fresh and _list_open(pairs, count, gaps, work):
            return MEASURE
        for k in range(count):
            if gaps.least[k] >= gaps.needed[k]:
                work.found[PROVEN] = min(work.found[PROVEN], gaps.least[k] - gaps.needed[k])
        _remember(asked, pairs, count, gaps, work)
        if work.found[LEAST] < 0.0:
            return TOO_CLOSE
        still = 0
        for k in range(count):
            if not gaps.least[k] >= gaps.needed[k]:
                pairs[still] = pairs[k]
                still += 1
        if still == 0:
            counts[SIZE] -= 1
            continue
        begin, end = work.spans[top, 0], work.spans[top, 1]
        if end - begin < _SHORTEST or counts[POSTURES] >= _MOST_POSTURES:
            return UNDECIDED
        _push(work, top, 0.5 * (begin + end), end, second, still)
        for k in range(still):
            work.pairs[top + 1, k] = pairs[k]
        _push(work, top + 1, begin, 0.5 * (begin + end), first, still)
        counts[SIZE] += 1
    return CLEAR


@inlined
def place_all(chain: Chain, shapes: Shapes, q: FloatArray, scene: PlacedShapes) -> None:
    """Bring everything to where it is at the joints q (n,)."""
    carry(chain, q, scene.frames)
    for j in range(q.shape[0]):
        f = scene.frames[j]
        for k in range(3):
            anchor, direction = f[k, 3], 0.0
            for m in range(3):
                anchor += f[k, m] * chain.anchors[j, m]
                direction += f[k, m] * chain.axes[j, m]
            scene.anchors[j, k], scene.directions[j, k] = anchor, direction
    for g in range(shapes.places.shape[0]):
        f = scene.frames[shapes.carried[g]]
        place_shape(f, shapes.places[g], shapes.axes[g], scene.places[g], scene.axes[g])


@leaf
def place_shape(
    moved: FloatArray, place: FloatArray, axes: FloatArray, new_place: FloatArray, new_axes: FloatArray
) -> None:
    """Write place (3,) and axes (9,) of a shape whose carrier has moved by a turn and a shift (3, 4)."""
    for k in range(3):
        new_place[k] = moved[k, 3]
        for m in range(3):
            new_place[k] += moved[k, m] * place[m]
            new_axes[3 * k + m] = 0.0
            for i in range(3):
                new_axes[3 * k + m] += moved[k, i] * axes[3 * i + m]


@inlined
def _foresee(
    shapes: Shapes,
    scene: PlacedShapes,
    asked: FloatArray,
    pairs: IntArray,
    turns: FloatArray,
    proven: float,
    gaps: Gaps,
) -> None:
    """Write what pairs (m,) need in this configuration, and what is enough if others leave ``proven`` [m]."""
    farthest_moves(
        scene.anchors,
        scene.directions,
        scene.places,
        shapes.radii,
        shapes.carried,
        shapes.spins,
        turns,
        scene.moves,
    )
    for k in range(pairs.shape[0]):
        pair = pairs[k]
        i, j = shapes.pairs[pair, 0], shapes.pairs[pair, 1]
        move = scene.moves[j, shapes.first_between[pair]]
        gaps.needed[k] = asked[pair] + move + rounding(i, j, scene.places, shapes.radii)
        gaps.enough[k] = gaps.needed[k] + proven


@inlined
def _search(bodies: Bodies, shape_pairs: IntArray, normals: FloatArray, pairs: IntArray, gaps: Gaps) -> None:
    """Raise the lower bounds of pairs (m,), of ``shape_pairs``, that are not enough; write upper ones."""
    ends, simplex = np.empty(6), np.empty((4, 7))
    for k in range(pairs.shape[0]):
        gaps.most[k] = math.inf
        if not gaps.least[k] >= gaps.needed[k]:
            pair = pairs[k]
            i, j = shape_pairs[pair, 0], shape_pairs[pair, 1]
            width, gaps.most[k] = widen(bodies, i, j, normals[pair], ends, simplex)
            gaps.least[k] = max(gaps.least[k], width)


@inlined
def _list_open(pairs: IntArray, count: int, gaps: Gaps, work: Work) -> bool:
    """Write pairs that may be clear for all that is known into `Work.unmeasured`; return whether any are."""
    for k in range(count):
        if not gaps.least[k] >= gaps.needed[k] and not gaps.most[k] - gaps.least[k] <= _SAME:
            work.unmeasured[work.counts[UNMEASURED]] = pairs[k]
            work.counts[UNMEASURED] += 1
    return bool(work.counts[UNMEASURED] > 0)


@inlined
def _remember(asked: FloatArray, pairs: IntArray, count: int, gaps: Gaps, work: Work) -> None:
    """Keep the pair whose distance is known and that has the least beyond what is required."""
    top, at = work.counts[SIZE] - 1, 0
    for k in range(count):
        pair, gap = pairs[k], gaps.most[k]
        if at < work.counts[UNMEASURED] and work.unmeasured[at] == pair:
            at += 1
            gap = gaps.least[k]
        left = gap - asked[pair]
        if left < work.found[LEAST]:
            work.found[LEAST], work.found[LEAST_GAP], work.found[LEAST_PAIR] = left, gap, pair
            work.found[LEAST_W] = 0.5 * (work.spans[top, 0] + work.spans[top, 1])
    work.counts[UNMEASURED] = 0


@kernel
def _push(work: Work, at: int, begin: float, end: float, piece: FloatArray, count: int) -> None:
    work.spans[at, 0], work.spans[at, 1] = begin, end
    copy_into(piece, work.pieces[at])
    work.sizes[at] = count
