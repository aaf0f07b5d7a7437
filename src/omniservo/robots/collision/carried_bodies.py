"""Whether what the last joint carries comes too close to what stands still: no joints are needed to tell."""

from __future__ import annotations

import math

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.held import held
from omniservo.geometry.kernel import kernel
from omniservo.robots.collision.arm_bodies import ArmBodies
from omniservo.robots.collision.clearance_kernels import place_shape
from omniservo.robots.collision.gap_search import widen
from omniservo.robots.collision.shapes import Bodies, Shapes


def carried_too_close(bodies: ArmBodies, base_T_flange: FloatArray, asked: FloatArray) -> bool:
    """Return whether a body that the last joint carries is too close to one that no joint moves.

    Args:
        bodies: the arm and what stands around.
        base_T_flange: (m, 4, 4) poses of the flange, each of which rules out a path if it is one of them.
        asked: (p,) what each pair has to keep [m].
    """
    found: bool = _too_close(bodies.shapes, bodies.arm.dof, bodies.arm.chain.tool, base_T_flange, asked)
    return found


@kernel
def _too_close(shapes: Shapes, last: int, tool: FloatArray, poses: FloatArray, asked: FloatArray) -> bool:
    """See `carried_too_close`; ``last`` joints carry the flange, ``tool`` is where it is at q = 0 (3, 4)."""
    shapes = held(shapes)
    pairs, carried, radii = shapes.pairs, shapes.carried, shapes.radii
    places, axes, moved = shapes.places.copy(), shapes.axes.copy(), np.empty((3, 4))
    bodies = Bodies(shapes.kinds, shapes.sizes, radii, shapes.corners, shapes.firsts, places, axes)
    normals, ends, simplex = np.zeros((pairs.shape[0], 3)), np.empty(6), np.empty((4, 7))
    for i in range(poses.shape[0]):
        for k in range(3):  # the flange's pose times the inverse of the one at q = 0
            moved[k, 3] = poses[i, k, 3]
            for m in range(3):
                moved[k, m] = 0.0
                for n in range(3):
                    moved[k, m] += poses[i, k, n] * tool[m, n]
            for m in range(3):
                moved[k, 3] -= moved[k, m] * tool[m, 3]
        for g in range(carried.shape[0]):
            if carried[g] == last:
                place_shape(moved, shapes.places[g], shapes.axes[g], places[g], axes[g])
        for pair in range(pairs.shape[0]):
            a, b = pairs[pair, 0], pairs[pair, 1]
            if carried[a] != 0 or carried[b] != last:
                continue
            x, y, z = places[b, 0] - places[a, 0], places[b, 1] - places[a, 1], places[b, 2] - places[a, 2]
            if math.sqrt(x * x + y * y + z * z) - radii[a] - radii[b] >= asked[pair]:
                continue
            _, most = widen(bodies, a, b, normals[pair], ends, simplex)
            if most < asked[pair] or most == math.inf:
                return True
    return False
