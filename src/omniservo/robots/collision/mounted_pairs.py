"""Which parts of what an arm carries may meet the link that the last joint turns it against."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.robots.collision.gap_search import widen
from omniservo.robots.collision.shapes import Bodies, Shapes

_POSTURES = 64


def mounted_pairs(
    shapes: Shapes,
    before: IntArray,
    mounted: IntArray,
    hinge: tuple[FloatArray, FloatArray],
    ends: FloatArray,
) -> tuple[IntArray, IntArray]:
    """Return pairs (k, 2) that may meet, and those (m, 2) that overlap in every configuration.

    Args:
        shapes: at q = 0.
        before: (a,) those of the link before the last joint.
        mounted: (b,) those that the last joint carries.
        hinge: a point on its axis (3,) [m], and the axis (3,), at q = 0.
        ends: (2,) of its range [rad]; 64 places of it are checked.
    """
    turns = Rotation.from_rotvec(np.outer(np.linspace(ends[0], ends[1], _POSTURES), hinge[1]))
    pairs = np.stack(np.meshgrid(before, mounted, indexing="ij"), axis=-1).reshape(-1, 2)
    meet = np.array([_are_ever_apart(shapes, pair, hinge[0], turns) for pair in pairs], dtype=np.bool_)
    return pairs[meet], pairs[~meet]


def _are_ever_apart(shapes: Shapes, pair: IntArray, anchor: FloatArray, turns: Rotation) -> bool:
    first, second = pair.tolist()
    places, axes, ends, simplex = shapes.places.copy(), shapes.axes.copy(), np.empty(6), np.empty((4, 7))
    bodies = Bodies(shapes.kinds, shapes.sizes, shapes.radii, shapes.corners, shapes.firsts, places, axes)
    for turn in turns:
        places[second] = anchor + turn.apply(shapes.places[second] - anchor)
        axes[second] = (turn.as_matrix() @ shapes.axes[second].reshape(3, 3)).ravel()
        _, most = widen(bodies, first, second, np.zeros(3), ends, simplex)
        if 0.0 < most < np.inf:
            return True
    return False
