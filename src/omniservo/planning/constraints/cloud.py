"""Point clouds: the camera centre stays outside balls about many points, ‖t − p‖² − R² ≥ 0, degree 2τ.

The points of a node of the cloud's tree lie in a ball (c, ρ): a piece of the path that stays R + ρ away from
c stays R away from all of them. So a node is decided like one sphere, and entered only where that fails.
"""

import math
from typing import NamedTuple

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel, late, leaf
from omniservo.geometry.polynomial import UNIT, magnitude
from omniservo.geometry.subdivision import (
    FAILS_AT_END,
    FAILS_AT_START,
    HOLDS,
    MAX_LEVEL,
    MAX_PIECES,
    OPEN,
    PROVEN,
    Bounds,
    Piece,
    first_piece,
    subdivide,
)
from omniservo.geometry.vectors import copy_into
from omniservo.planning.bernstein_path import squares
from omniservo.planning.constraints.constraints import (
    CLOUD_MOTION,
    CLOUD_REACH,
    END_NODE,
    END_POINT,
    FIRST_NODE,
    FIRST_POINT,
    Constraints,
)
from omniservo.planning.constraints.motion import displacement, less_motion
from omniservo.planning.constraints.path_forms import PathForms
from omniservo.planning.constraints.place import AT, TX, TY, TZ
from omniservo.planning.constraints.push import ASLEEP, Samples, push_centre
from omniservo.planning.obstacles.ball_tree import END, FIRST, NEXT, RADIUS, nearest_point


class _Balls(NamedTuple):
    """What a curve is to keep off."""

    points: FloatArray
    """Of the cloud (p, 3), in the order of its tree."""
    nodes: FloatArray
    """The tree (k, 7)."""
    reach: float
    """[m]"""


@kernel
def cloud_points(constraints: Constraints, index: int) -> FloatArray:
    """Return the points (p, 3) of cloud ``index``, in the order of its tree."""
    return constraints.cloud_points[
        int(constraints.clouds[index, FIRST_POINT]) : int(constraints.clouds[index, END_POINT])
    ]


@kernel
def cloud_nodes(constraints: Constraints, index: int) -> FloatArray:
    """Return the tree (k, 7) of cloud ``index``."""
    return constraints.cloud_nodes[
        int(constraints.clouds[index, FIRST_NODE]) : int(constraints.clouds[index, END_NODE])
    ]


@leaf
def squared_gap(piece: FloatArray, k: int, o: FloatArray, reach: float) -> float:
    """Return coefficient k of ‖t − o‖² − reach²; ``piece`` (4, 2τ+1): t raised, then ‖t‖²."""
    x, y, z = o[0], o[1], o[2]
    inner = x * piece[0, k] + y * piece[1, k] + z * piece[2, k]
    return float(piece[3, k] - 2.0 * inner + (x * x + y * y + z * z - reach * reach))


@leaf
def keeps_off(piece: FloatArray, o: FloatArray, reach: float, bound: float) -> bool:
    """Tell whether every coefficient of ‖t − o‖² − reach² is at least ``bound``."""
    k, count = 0, piece.shape[1]
    while k < count and squared_gap(piece, k, o, reach) >= bound:
        k += 1
    return bool(k == count)


@leaf
def first_near(piece: FloatArray, points: FloatArray, nodes: FloatArray, reach: float, bound: float) -> int:
    """Return the first point of a tree that a piece is not shown to keep off; −1: there is none."""
    i = 0
    while i < nodes.shape[0]:
        node = nodes[i]
        if keeps_off(piece, node, reach + node[RADIUS], bound):
            i = int(node[NEXT])
            continue
        i += 1
        if node[NEXT] == i:
            for k in range(int(node[FIRST]), int(node[END])):
                if not keeps_off(piece, points[k], reach, bound):
                    return k
    return -1


@leaf
def farthest(nodes: FloatArray) -> float:
    """Return what no coordinate of a tree's points and centres exceeds."""
    return float(max(abs(nodes[0, 0]), abs(nodes[0, 1]), abs(nodes[0, 2])) + nodes[0, RADIUS])


@kernel
def prove_off_cloud(
    square: FloatArray, raised: FloatArray, size: float, points: FloatArray, nodes: FloatArray, reach: float
) -> tuple[int, float]:
    """Decide ‖t(w) − p‖ ≥ reach on [0, 1] for all points, with `squares` of t and its magnitude ``size``.

    Counts and magnitude are those of one sphere, + 2 for reach + ρ, + 2 for a motion, and
    2τ for every halving.
    """
    m = square.shape[1]
    both = np.empty((4, m))
    copy_into(raised, both)
    copy_into(square, both[3:])
    total, largest = size + farthest(nodes), reach + nodes[0, RADIUS]
    error = UNIT * (3.0 * total * total + largest * largest)
    bounds = Bounds(3.0 * (m - 1) + 24.0, m - 1.0, error, MAX_LEVEL, MAX_PIECES)
    pieces = first_piece(both, np.empty((3, 0)), 0)
    status, w, _ = subdivide(_off_balls, _Balls(points, nodes, reach), pieces, bounds)
    return status, w


@leaf
def _off_balls(piece: Piece, balls: _Balls) -> tuple[int, int]:
    """Show a piece outside all balls of a cloud, or an end of it inside one."""
    curve, points, reach = piece.curve, balls.points, balls.reach
    near = first_near(curve, points, balls.nodes, reach, piece.bound)
    if near < 0:
        return HOLDS, 0
    if squared_gap(curve, 0, points[near], reach) < -piece.bound:
        return FAILS_AT_START, 0
    at_end = squared_gap(curve, curve.shape[1] - 1, points[near], reach)
    return (FAILS_AT_END if at_end < -piece.bound else OPEN), 0


@late
def cloud_margin(constraints: Constraints, index: int, pose: FloatArray) -> float:
    """Return what the clearance of cloud ``index`` leaves at a pose (14,)."""
    mx, my, mz = displacement(constraints.motions, constraints.clouds[index, CLOUD_MOTION], pose[AT])
    t = pose[TX] - mx, pose[TY] - my, pose[TZ] - mz
    points, nodes = cloud_points(constraints, index), cloud_nodes(constraints, index)
    return float(nearest_point(points, nodes, t, t, math.inf)[1] - constraints.clouds[index, CLOUD_REACH])


@late
def prove_cloud_clear(
    constraints: Constraints, index: int, margin: float, path: PathForms
) -> tuple[int, float, int]:
    """Decide the clearance of cloud ``index`` with ``margin`` to spare: status, w, 0.

    A reach of 0 asks for nothing. Where the cloud moves, of t − m: its powers round once more, and their
    squares twice.
    """
    reach, motion = (
        constraints.clouds[index, CLOUD_REACH] + margin,
        int(constraints.clouds[index, CLOUD_MOTION]),
    )
    if reach <= 0.0:
        return PROVEN, 0.0, 0
    points, nodes = cloud_points(constraints, index), cloud_nodes(constraints, index)
    square, raised, size = path.square, path.raised, path.size
    if motion >= 0:
        powers = less_motion(path.translation, constraints.motions[motion])
        square, raised = squares(powers)
        size = magnitude(powers)
    status, w = prove_off_cloud(square, raised, size, points, nodes, reach)
    return status, w, 0


@late
def prove_clouds_clear(constraints: Constraints, path: PathForms) -> tuple[int, float]:
    """Decide the clearance of every cloud."""
    for i in range(constraints.clouds.shape[0]):
        status, w, _ = prove_cloud_clear(constraints, i, 0.0, path)
        if status != PROVEN:
            return status, w
    return PROVEN, 0.0


@late
def push_off_clouds(constraints: Constraints, samples: Samples) -> None:
    """Push the centre off the nearest point: g = (‖t − p‖ − reach)/max(reach, ℓ/20) (see `push`)."""
    poses, targets, least = samples.poses, samples.targets, samples.least
    systems, costs = samples.systems, samples.costs
    for i in range(constraints.clouds.shape[0]):
        group, reach = constraints.slots.clouds + i, constraints.clouds[i, CLOUD_REACH]
        if reach <= 0.0 or targets[group] == ASLEEP:
            continue
        points, nodes = cloud_points(constraints, i), cloud_nodes(constraints, i)
        unit = max(reach, 0.05 * constraints.ell)
        for s in range(poses.shape[0]):
            mx, my, mz = displacement(constraints.motions, constraints.clouds[i, CLOUD_MOTION], poses[s, AT])
            t = poses[s, TX] - mx, poses[s, TY] - my, poses[s, TZ] - mz
            limit = reach + unit * max(targets[group], least[group])
            k, distance = nearest_point(points, nodes, t, t, limit)
            if k < 0:
                continue
            g = (distance - reach) / unit
            least[group] = min(least[group], g)
            if g < targets[group]:
                f = 1.0 / (unit * max(distance, 1e-9 * unit))
                x, y, z = t[0] - points[k, 0], t[1] - points[k, 1], t[2] - points[k, 2]
                push_centre(systems, costs, s, poses, f * x, f * y, f * z, targets[group] - g)
