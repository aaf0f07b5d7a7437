"""Which small move is worth making before it is planned again, and what is expected of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from omniservo.errors import InputError
from omniservo.estimation import TwoViewEstimate
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.looks.candidate_joints import candidate_joints
from omniservo.looks.certified_move import CertifiedMove, certified_move
from omniservo.looks.standing import ViewingState

STRUCTURES = 50
"""So many structures are drawn from the estimate, all of whose points a move keeps in view and off,"""

MOST_POINTS = 2000
"""of so many points together at most."""

TRIES = 8
"""Candidates that are planned from, those first that are expected to tell most"""

LEAST_GAIN = 0.05
"""A look that makes what is uncertain smaller by less than this share is not worth its time."""

Plans: TypeAlias = Callable[[ViewingState], bool]
"""Whether there is a plan from where an arm stands, with what is known there"""


@with_field_docs
@dataclass(frozen=True, eq=False)
class NextLook:
    """A move, and what is expected of the image at its end."""

    move: CertifiedMove
    size: float
    """`uncertainty_size` that is expected"""
    leads_to_plan: bool
    """whether there is expected to be a plan from there"""


def next_look(
    here: ViewingState, plans: Plans, seed: int, failed: Sequence[CertifiedMove] = ()
) -> NextLook | str:
    """Return the look that is worth most, or why there is none.

    Of certified moves to the candidates the one from whose end there is expected to be a plan, that first
    which is expected to make the uncertainty smallest; else that one, where it makes it smaller at all. Ends
    at which the arm can stand with its tube come first. Moves that ``failed``, whose images gave nothing, are
    not chosen again, and those that change the view as much come last.
    """
    rows = here.planned_rows
    samples, middle = structures(here.estimate, seed, rows), here.estimate.points[rows].mean(axis=0)
    before = uncertainty_size(here.estimate)
    found: list[tuple[bool, bool, float, int, CertifiedMove, ViewingState]] = []
    why = ""
    for q in candidate_joints(here.setting, here.start, here.singular_value, middle, seed):
        if any(np.array_equal(q, other.joints.positions[-1]) for other in failed):
            continue
        move = certified_move(here.asked, here.setting, samples, (here.start, q), here.mount)
        if isinstance(move, str):
            why = why or move
            continue
        try:
            there = here.expected_after(move)
        except InputError as error:
            why = why or str(error)
            continue
        if there is not None:
            bold = any(_as_bold(move, other) for other in failed)
            size = uncertainty_size(there.estimate)
            found.append((not there.is_free, bold, size, len(found), move, there))
    if not found:
        return f"no move to look again from elsewhere is certified; the first one tried: {why}"
    found.sort(key=lambda one: one[:4])
    for *_, size, _, move, there in found[:TRIES]:
        if _has_plan(plans, there):
            return NextLook(move, size, leads_to_plan=True)
    *_, size, _, move, _ = found[0]
    if size > (1.0 - LEAST_GAIN) * before:
        return (
            f"none of {len(found)} certified moves is expected to lead to a plan, nor to make what is "
            f"uncertain smaller than {100 * size / before:.0f}% of what it is"
        )
    return NextLook(move, size, leads_to_plan=False)


def _as_bold(move: CertifiedMove, other: CertifiedMove) -> bool:
    """Return whether a move leads the camera as far from its view as another, all but a tenth."""
    own, others = move.begin_T_end, other.begin_T_end
    return bool(
        np.linalg.norm(own.translation) > 0.9 * np.linalg.norm(others.translation)
        and own.rotation.magnitude() > 0.9 * others.rotation.magnitude()
    )


def _has_plan(plans: Plans, there: ViewingState) -> bool:
    try:
        return plans(there)
    except InputError:  # nothing is left of the image, or a joint is too near to its end
        return False


def uncertainty_size(estimate: TwoViewEstimate) -> float:
    """Return one length for all that is uncertain [m]: of the goal's place, its direction, the points.

    (σ_t · z σ_R · σ_h)^⅓: root mean squares, z the points' mean distance.
    """
    place, turn, points = uncertainty_parts(estimate)
    distance = float(np.linalg.norm(estimate.points[estimate.inliers], axis=1).mean())
    return float(np.cbrt(place * distance * turn * points))


def uncertainty_parts(estimate: TwoViewEstimate) -> tuple[float, float, float]:
    """Return σ of the goal's place [m], of its direction [rad] and of the points [m], root mean squares."""
    place, turn = (float(np.trace(estimate.covariance[at, at])) for at in (slice(3), slice(3, 6)))
    points = float(np.trace(estimate.points_covariance[estimate.inliers], axis1=1, axis2=2).mean())
    return math.sqrt(place), math.sqrt(turn), math.sqrt(points)


def structures(estimate: TwoViewEstimate, seed: int, rows: IntArray) -> FloatArray:
    """Return points (k, 3) of structures that an estimate allows, its own first [m]; of its ``rows`` (m,).

    Along its ray from the camera a point is nearer or farther by a factor, not by a difference: it stays
    before the camera.
    """
    own = estimate.points[rows]
    count = max(1, min(STRUCTURES, MOST_POINTS // len(rows) - 1))
    drawn = estimate.sample(np.random.default_rng([seed, 9]), count, rows=rows).points - own
    away = np.linalg.norm(own, axis=1)[:, None]
    ray = own / away
    along = np.sum(drawn * ray, axis=2, keepdims=True)
    factor = np.exp(np.clip(along / away, -1.0, 1.0))
    return np.concatenate((own, (factor * (own + drawn - along * ray)).reshape(-1, 3)))
