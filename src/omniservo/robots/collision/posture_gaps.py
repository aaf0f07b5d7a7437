"""How near bodies are in many configurations at once, and how the joints change that."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.geometry.held import held
from omniservo.geometry.kernel import kernel
from omniservo.robots.collision.arm_bodies import ArmBodies
from omniservo.robots.collision.clearance_kernels import place_all
from omniservo.robots.collision.gap_kernels import lower_gaps
from omniservo.robots.collision.gap_search import widen
from omniservo.robots.collision.shapes import Bodies, PlacedShapes, Shapes
from omniservo.robots.kinematics.chain import Chain


class Postures(NamedTuple):
    """A scene for each of m configurations; see `PlacedShapes`."""

    anchors: FloatArray
    """(m, n, 3)"""
    directions: FloatArray
    """(m, n, 3)"""
    places: FloatArray
    """(m, g, 3)"""
    axes: FloatArray
    """(m, g, 9)"""
    normals: FloatArray
    """(m, p, 3) directions between pairs, as last found in that configuration; 0: none"""
    ends: FloatArray
    """(m, p, 6) their nearest points, likewise [m]"""
    nearest: FloatArray
    """(m, p) upper bounds of their distances [m]; ∞: they may touch"""


class PostureGaps:
    """Measures configurations again and again as they move: what was found in each before spares measuring.

    Gaps are those of `widen`; where it has no answer, because bodies may touch, MuJoCo's.
    """

    def __init__(self, bodies: ArmBodies, count: int) -> None:
        """Prepare for ``count`` configurations of an arm among bodies."""
        self.count = count
        joints, shapes, pairs = bodies.arm.dof, len(bodies.shapes.kinds), len(bodies.pairs)
        self._bodies = bodies
        self.postures = Postures(
            np.empty((count, joints, 3)),
            np.empty((count, joints, 3)),
            np.empty((count, shapes, 3)),
            np.empty((count, shapes, 9)),
            np.zeros((count, pairs, 3)),
            np.empty((count, pairs, 6)),
            np.empty((count, pairs)),
        )
        """as last measured"""

    def measure(self, posture: IntArray, pair: IntArray, touching: IntArray, gaps: FloatArray) -> None:
        """Write the gaps of those of the pairs in configurations, see `near_pairs`, that may touch."""
        postures = self.postures
        for k in touching.tolist():
            i, j = int(posture[k]), int(pair[k])
            self._bodies.show(postures.places[i], postures.axes[i])
            gaps[k] = self._bodies.measure(j, postures.ends[i, j], postures.normals[i, j])

    def worst(self, joints: FloatArray, asked: FloatArray, least: float) -> tuple[int, int, float] | None:
        """Return configuration, pair and gap [m] where least is left; None: not below ``least``.

        Args:
            joints: (m, n) [rad], m ≤ ``count``.
            asked: (p,) [m].
            least: what is left somewhere else [m].
        """
        bodies, postures = self._bodies, self.postures
        bounds = np.empty((len(joints), len(asked)))
        within = asked + least
        _write_bounds(bodies.arm.chain, bodies.shapes, bodies.scene.frames, joints, within, postures, bounds)
        left, found = bounds - asked, None
        for at in np.argsort(left, axis=None).tolist():
            i, j = divmod(at, len(asked))
            if left[i, j] >= least:
                break
            gap = float(bounds[i, j])
            if postures.nearest[i, j] == np.inf:
                bodies.show(postures.places[i], postures.axes[i])
                gap = bodies.measure(j)
            if gap - asked[j] < least:
                least, found = gap - float(asked[j]), (i, j, gap)
        return found


@kernel
def near_pairs(
    chain: Chain,
    shapes: Shapes,
    frames: FloatArray,
    joints: FloatArray,
    within: FloatArray,
    postures: Postures,
) -> tuple[IntArray, IntArray, FloatArray, IntArray]:
    """Return configuration, pair and gap [m] of what is closer than ``within`` (p,) at joints (m, n).

    In the order of the configurations. The last array says which of them may touch: `PostureGaps.measure` has
    the gaps of these.
    """
    bounds = np.empty((joints.shape[0], within.shape[0]))
    _write_bounds(chain, shapes, frames, joints, within, postures, bounds)
    most, count, touched = bounds.size, 0, 0
    posture, pair, touching = (np.empty(most, np.int64), np.empty(most, np.int64), np.empty(most, np.int64))
    gaps = np.empty(most)
    for i in range(joints.shape[0]):
        for k in range(within.shape[0]):
            if bounds[i, k] < within[k]:
                posture[count], pair[count], gaps[count] = i, k, bounds[i, k]
                if postures.nearest[i, k] == np.inf:
                    touching[touched] = count
                    touched += 1
                count += 1
    return posture[:count], pair[:count], gaps[:count], touching[:touched]


@kernel
def _write_bounds(
    chain: Chain,
    shapes: Shapes,
    frames: FloatArray,
    joints: FloatArray,
    within: FloatArray,
    postures: Postures,
    bounds: FloatArray,
) -> None:
    """Place everything at all joints (m, n); write lower bounds of all gaps (m, p) [m].

    Those that may be below ``within`` (p,) are what `widen` comes to.
    """
    chain, shapes, postures = held(chain), held(shapes), held(postures)
    simplex, every, none = np.empty((4, 7)), np.arange(bounds.shape[1]), np.empty((0, 0))
    for i in range(joints.shape[0]):
        places, axes, normals = postures.places[i], postures.axes[i], postures.normals[i]
        scene = PlacedShapes(frames, postures.anchors[i], postures.directions[i], places, axes, none, normals)
        place_all(chain, shapes, joints[i], held(scene))
        bodies = Bodies(shapes.kinds, shapes.sizes, shapes.radii, shapes.corners, shapes.firsts, places, axes)
        lower_gaps(bodies, shapes.pairs, every, normals, within, bounds[i])
        for k in range(bounds.shape[1]):
            if bounds[i, k] < within[k]:
                width, postures.nearest[i, k] = widen(
                    bodies, shapes.pairs[k, 0], shapes.pairs[k, 1], normals[k], postures.ends[i, k], simplex
                )
                bounds[i, k] = max(bounds[i, k], width)
