"""Whether an arm keeps clear of everything and of itself on its way, between any samples too."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from omniservo.errors import InputError
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray, finite_number
from omniservo.robots.collision.arm_bodies import ArmBodies
from omniservo.robots.collision.clearance_kernels import (
    CLEAR,
    HALVINGS,
    LEAST,
    LEAST_GAP,
    LEAST_PAIR,
    LEAST_W,
    MEASURE,
    POSTURES,
    PROVEN,
    SIZE,
    TOO_CLOSE,
    UNMEASURED,
    Work,
    prove_pieces,
)
from omniservo.robots.collision.posture_gaps import PostureGaps
from omniservo.robots.path_following.joint_path import JointPath
from omniservo.short_repr import short_repr

SELF_CLEARANCE = 0.002
"""What parts of the arm keep from each other [m], where nothing else is required."""

_SCANNED = 33
"""places at which a path that is too close is checked for the worst"""


@with_field_docs
@dataclass(frozen=True)
class Closeness:
    """Two bodies at one place of the path."""

    link: str
    """the arm's link, or the camera"""
    other: str
    """what it is close to: another link, or something that stands around"""
    w: float
    gap: float
    """[m]; negative: depth"""
    asked: float
    """[m]"""


@with_field_docs
@dataclass(frozen=True)
class ArmClearance:
    """What has been proven of a joint path: of the path itself, not of how an arm tracks it."""

    status: Literal["clear", "too_close", "undecided"]
    """clear: proven for every w. too_close: `closest` shows where it is not so. undecided: something comes so
    near to what is required that no number of configurations settles it"""
    clearance: float
    """required of the arm and what stands around [m]"""
    self_clearance: float
    """required of the arm's own parts [m]"""
    closest: Closeness | None
    """where least is left of what is required, at the configurations that were checked; None: nothing came
    near"""
    proven: float
    """lower bound over all pairs and all w of what is left beyond what is required [m]; −∞ unless clear"""
    postures: int
    """that were checked"""

    __repr__ = short_repr

    @property
    def reason(self) -> str:
        """Why it is not clear; "" where it is."""
        if self.status == "clear" or self.closest is None:
            return ""
        found = self.closest
        left = f"{spelled_gap(found.link, found.other, found.gap)} at w = {found.w:.4f}"
        left = f"{left}; {1e3 * found.asked:g} mm are required"
        return left if self.status == "too_close" else f"undecided: {left}"


def spelled_gap(link: str, other: str, gap: float) -> str:
    """Return the distance of two bodies [m], or by how much they overlap, in words."""
    if gap > 0.0:
        return f"{link} and {other} are {1e3 * gap:.2f} mm apart"
    return f"{link} and {other} overlap by {-1e3 * gap:.2f} mm"


def arm_clearance(
    bodies: ArmBodies,
    path: JointPath,
    *,
    clearance: float,
    self_clearance: float = SELF_CLEARANCE,
    span: tuple[float, float] = (0.0, 1.0),
    worst: bool = True,
) -> ArmClearance:
    """Prove that every pair of bodies keeps its clearance on the whole path, or show where not.

    The path is halved until, in the middle of each part, every pair is farther apart than its clearance plus
    what the joints can take of it before the part ends (`gap_kernels.farthest_moves`; how far a joint
    deviates from the middle is bounded by the Bernstein coefficients of its polynomial). Distances there are
    bounded from below by a slab between the two bodies (`gap_kernels.lower_gaps`).

    Args:
        bodies: the arm and what stands around.
        path: of that arm.
        clearance: of the arm, and of what it carries, to what stands around [m], ≥ 0.
        self_clearance: of the arm's parts to each other [m], ≥ 0.
        span: of w, the part of the path that is checked.
        worst: a path that is too close is checked again for the worst place; False: the first one will do.

    Raises:
        InputError: a clearance that is negative or not finite; a path of another number of joints, or a span
            that is not on it.
    """
    finite_number("clearance", clearance, minimum=0.0)
    finite_number("self_clearance", self_clearance, minimum=0.0)
    asked = bodies.asked(clearance, self_clearance)
    knots, pieces = path.bernstein_pieces(*span)
    if pieces.shape[2] != bodies.arm.dof:
        raise InputError(f"path: of {pieces.shape[2]} joints; {bodies.arm.name} has {bodies.arm.dof}")
    work = _work_for(pieces, len(bodies.pairs))
    status = _proven(bodies, asked, work, knots[::-1], pieces[::-1])
    if status == "too_close" and worst:
        places = np.linspace(knots[0], knots[-1], _SCANNED)
        _look_for_worst(bodies, asked, places, path(places), work.found)
    proven = float(work.found[PROVEN]) if status == "clear" else -math.inf
    closest = _closest(bodies, asked, work.found)
    return ArmClearance(status, clearance, self_clearance, closest, proven, int(work.counts[POSTURES]))


def _work_for(pieces: FloatArray, pairs: int) -> Work:
    depth = len(pieces) + HALVINGS
    return Work(
        spans=np.empty((depth, 2)),
        pieces=np.empty((depth, *pieces.shape[1:])),
        pairs=np.empty((depth, pairs), dtype=np.int64),
        sizes=np.empty(depth, dtype=np.int64),
        unmeasured=np.empty(pairs, dtype=np.int64),
        counts=np.zeros(3, dtype=np.int64),
        found=np.array([math.inf, math.inf, 0.0, 0.0, 0.0]),
    )


def _proven(
    bodies: ArmBodies, asked: FloatArray, work: Work, knots: FloatArray, pieces: FloatArray
) -> Literal["clear", "too_close", "undecided"]:
    """Prove pieces (m, k, n) between places (m + 1,), both from the last one to the first."""
    m = len(pieces)
    work.spans[:m, 0], work.spans[:m, 1] = knots[1:], knots[:-1]
    work.pieces[:m], work.sizes[:m] = pieces, len(asked)
    work.pairs[:m] = np.arange(len(asked))
    work.counts[SIZE], work.counts[UNMEASURED] = m, 0
    while (result := prove_pieces(bodies.arm.chain, bodies.shapes, bodies.scene, asked, work)) == MEASURE:
        for pair in work.unmeasured[: work.counts[UNMEASURED]].tolist():
            bodies.measure(pair)
    return "clear" if result == CLEAR else "too_close" if result == TOO_CLOSE else "undecided"


def _look_for_worst(
    bodies: ArmBodies, asked: FloatArray, places: FloatArray, joints: FloatArray, found: FloatArray
) -> None:
    """Measure what is nearest at joints (m, n) of places (m,), where it may be worse than ``found`` knows."""
    seen = PostureGaps(bodies, len(places))
    worst = seen.worst(joints, asked, float(found[LEAST]))
    if worst is not None:
        posture, pair, gap = worst
        found[LEAST], found[LEAST_W] = gap - asked[pair], places[posture]
        found[LEAST_GAP], found[LEAST_PAIR] = gap, pair


def _closest(bodies: ArmBodies, asked: FloatArray, found: FloatArray) -> Closeness | None:
    if math.isinf(found[LEAST]):
        return None
    pair = int(found[LEAST_PAIR])
    return Closeness(*bodies.names(pair), float(found[LEAST_W]), float(found[LEAST_GAP]), float(asked[pair]))
