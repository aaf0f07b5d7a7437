"""Whether an arm keeps clear of everything and of itself on its way, between any samples too."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from omniservo.geometry.arrays import FloatArray, IntArray, finite_number
from omniservo.robots.arm_bodies import ArmBodies
from omniservo.robots.gap_kernels import middle_of_piece
from omniservo.robots.joint_path import JointPath

SELF_CLEARANCE = 0.002
"""What parts of the arm keep from each other [m], where nothing else is asked for."""

_ROUNDING = 1e-8
"""[m] that floating point, and axes taken to be one, may have taken from a gap"""

_MOST_POSTURES = 20_000
_SHORTEST = 2.0**-24

_SCANNED = 33
"""places at which a path that is too close is looked at for the worst"""


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


@dataclass(frozen=True)
class ArmClearance:
    """What has been proven of a joint path: of the path itself, not of how an arm tracks it."""

    status: Literal["clear", "too_close", "undecided"]
    """clear: proven for every w. too_close: `closest` shows where it is not so. undecided: something comes so
    near to what is asked that no number of postures settles it"""
    clearance: float
    """asked of the arm and what stands around [m]"""
    self_clearance: float
    """asked of the arm's own parts [m]"""
    closest: Closeness | None
    """where least is left of what is asked, at the postures that were looked at; None: nothing came near"""
    proven: float
    """lower bound over all pairs and all w of what is left beyond what is asked [m]; −∞ unless clear"""
    postures: int
    """that were looked at"""

    @property
    def reason(self) -> str:
        """Why it is not clear; "" where it is."""
        if self.status == "clear" or self.closest is None:
            return ""
        found = self.closest
        left = f"{found.link} and {found.other} are {1e3 * found.gap:.2f} mm apart at w = {found.w:.4f}"
        if found.gap <= 0.0:
            left = f"{found.link} and {found.other} overlap by {-1e3 * found.gap:.2f} mm at w = {found.w:.4f}"
        left = f"{left}; {1e3 * found.asked:g} mm are asked for"
        return left if self.status == "too_close" else f"undecided: {left}"


def arm_clearance(
    bodies: ArmBodies, path: JointPath, *, clearance: float, self_clearance: float = SELF_CLEARANCE
) -> ArmClearance:
    """Prove that every pair of bodies keeps its clearance on the whole path, or show where not.

    The path is halved until, in the middle of each part, every pair is farther apart than its clearance plus
    what the joints can take of it before the part ends (`gap_kernels.farthest_moves`; how far a joint
    strays from the middle is bounded by the Bernstein coefficients of its polynomial). Distances there are
    bounded from below by a slab between the two bodies (`gap_kernels.lower_gaps`).

    Args:
        bodies: the arm and what stands around.
        path: of that arm.
        clearance: of the arm, and of what it carries, to what stands around [m], ≥ 0.
        self_clearance: of the arm's parts to each other [m], ≥ 0.

    Raises:
        InputError: a clearance that is negative or not finite.
    """
    finite_number("clearance", clearance, minimum=0.0)
    finite_number("self_clearance", self_clearance, minimum=0.0)
    search = _Search(bodies, bodies.asked(clearance, self_clearance))
    everything = np.arange(len(bodies.pairs))
    knots, pieces = path.bernstein_pieces()
    status: Literal["clear", "too_close", "undecided"] = "clear"
    work = [(float(knots[i]), float(knots[i + 1]), pieces[i], everything) for i in range(len(pieces))][::-1]
    while work and status == "clear":
        begin, end, piece, pairs = work.pop()
        first, second = np.empty_like(piece), np.empty_like(piece)
        turns = np.empty(piece.shape[1])
        middle_of_piece(piece, first, second, turns)
        open_pairs = search.look(0.5 * (begin + end), first[-1], turns, pairs)
        if search.failed:
            status = "too_close"
        elif len(open_pairs) and (end - begin < _SHORTEST or search.postures >= _MOST_POSTURES):
            status = "undecided"
        elif len(open_pairs):
            middle = 0.5 * (begin + end)
            work += [(middle, end, second, open_pairs), (begin, middle, first, open_pairs)]
    if status == "too_close":
        for w in np.linspace(knots[0], knots[-1], _SCANNED):
            search.look(float(w), path(float(w)), np.zeros(pieces.shape[2]), everything)
    proven = search.proven if status == "clear" else -math.inf
    return ArmClearance(status, clearance, self_clearance, search.closest, proven, search.postures)


class _Search:
    """Looks at postures; remembers the least that was left."""

    def __init__(self, bodies: ArmBodies, asked: FloatArray) -> None:
        self._bodies, self._asked = bodies, asked
        self._least = math.inf
        self.proven = math.inf
        self.closest: Closeness | None = None
        self.postures = 0
        self.failed = False

    def look(self, w: float, q: FloatArray, turns: FloatArray, pairs: IntArray) -> IntArray:
        """Return those of the pairs that the middle's posture does not settle for its part of the path."""
        bodies, asked = self._bodies, self._asked
        self.postures += 1
        bodies.place(q)
        needed = asked + bodies.moves(turns) + _ROUNDING
        gaps = bodies.lower_gaps(pairs)
        unsettled = np.flatnonzero(gaps < needed[pairs])
        for i in unsettled.tolist():
            bodies.measure(int(pairs[i]))
        gaps[unsettled] = bodies.lower_gaps(pairs[unsettled])
        left = gaps - needed[pairs]
        settled = left >= 0.0
        if settled.any():
            self.proven = min(self.proven, float(left[settled].min()))
        self._remember(w, pairs, gaps, unsettled)
        return pairs[~settled]

    def _remember(self, w: float, pairs: IntArray, gaps: FloatArray, measured: IntArray) -> None:
        if not len(measured):
            return
        left = gaps[measured] - self._asked[pairs[measured]]
        worst = int(measured[np.argmin(left)])
        if left.min() < self._least:
            self._least = float(left.min())
            pair = int(pairs[worst])
            self.closest = Closeness(
                *self._bodies.names(pair), w, float(gaps[worst]), float(self._asked[pair])
            )
        self.failed = self._least < 0.0
