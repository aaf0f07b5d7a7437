"""Occlusion by clouds: no ball of a cloud between camera and target point.

As for a sphere (`occlusion`), one plane a piece of the path; a node of the cloud's tree is first tried as one
sphere of radius r + ρ about its centre.
"""

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel
from omniservo.geometry.polynomial import (
    MAX_LEVEL,
    MAX_PIECES,
    PROVEN,
    REFUTED,
    TINY,
    UNDECIDED,
    UNIT,
    copy_into,
    halve,
)
from omniservo.planning.ball_tree import END, FIRST, NEXT, RADIUS, nearest_point
from omniservo.planning.constraints.cloud import cloud_nodes, cloud_points, farthest
from omniservo.planning.constraints.demands import Demands
from omniservo.planning.constraints.occlusion import plane_past_ball, sight_offset
from omniservo.planning.constraints.push import ASLEEP, push_centre

_TOGETHER = 4
"""So often a piece is halved in the attempt to keep all lines of sight beyond one plane a ball."""


@kernel
def first_hiding(
    piece: FloatArray, targets: FloatArray, points: FloatArray, nodes: FloatArray, radius: float, bound: float
) -> int:
    """Return the first point of a tree past which a piece is not shown to see all ``targets``; −1: none."""
    i = 0
    while i < nodes.shape[0]:
        node = nodes[i]
        if plane_past_ball(piece, targets, node, radius + node[RADIUS], bound)[0]:
            i = int(node[NEXT])
            continue
        i += 1
        if node[NEXT] == i:
            for k in range(int(node[FIRST]), int(node[END])):
                if not plane_past_ball(piece, targets, points[k], radius, bound)[0]:
                    return k
    return -1


@kernel
def prove_sights_past_cloud(
    centre: FloatArray, size: float, targets: FloatArray, points: FloatArray, nodes: FloatArray, radius: float
) -> tuple[int, float, int]:
    """Decide on [0, 1] whether a cloud leaves the lines of sight from t(w) to all ``targets`` (n, 3) free.

    First one plane a piece and ball for all targets, then, where that does not end, targets one by one.

    Args:
        centre: control points of t (3, τ+1) with count τ + 2 and magnitude ``size``.
        size: see above.
        targets: target points (n, 3) [m].
        points: of the cloud (p, 3).
        nodes: its tree.
        radius: [m].

    Returns:
        status; where it is not PROVEN also w and the target point.
    """
    stack, marks = np.empty((MAX_LEVEL + 2, 3, centre.shape[1])), np.empty((MAX_LEVEL + 2, 2))
    status, w, j = _prove_sights(centre, size, targets, points, nodes, radius, _TOGETHER, stack, marks)
    if status == UNDECIDED:
        for j in range(targets.shape[0]):
            one = targets[j : j + 1]
            status, w, _ = _prove_sights(centre, size, one, points, nodes, radius, MAX_LEVEL, stack, marks)
            if status != PROVEN:
                return status, w, j
    return status, w, j


@kernel
def _prove_sights(
    centre: FloatArray,
    size: float,
    targets: FloatArray,
    points: FloatArray,
    nodes: FloatArray,
    radius: float,
    levels: int,
    stack: FloatArray,
    marks: FloatArray,
) -> tuple[int, float, int]:
    """Decide with one plane a piece and ball for all ``targets`` and at most ``levels`` halvings.

    ``stack`` (MAX_LEVEL + 2, 3, τ+1) and ``marks`` (MAX_LEVEL + 2, 2), start and level, are room for pieces.
    """
    n, far = centre.shape[1] - 1, farthest(nodes)
    for j in range(targets.shape[0]):
        far = max(far, abs(targets[j, 0]), abs(targets[j, 1]), abs(targets[j, 2]))
    error = UNIT * (4.0 * (size + 2.0 * far) + abs(radius) + nodes[0, RADIUS])
    copy_into(centre, stack[0])
    marks[0, 0], marks[0, 1] = 0.0, 0.0
    top, pieces = 0, 0
    while top >= 0:
        piece, level = stack[top], marks[top, 1]
        bound = (n + 22.0 + level * n) * error + TINY
        hiding = first_hiding(piece, targets, points, nodes, radius, bound)
        if hiding < 0:
            top -= 1
            continue
        width, o = 0.5**level, points[hiding]
        for j in range(targets.shape[0]):
            for k in (0, n):
                if sight_offset(piece[0, k], piece[1, k], piece[2, k], targets[j], o)[3] < radius - bound:
                    return REFUTED, marks[top, 0] + (width if k > 0 else 0.0), j
        pieces += 1
        if level >= levels or pieces > MAX_PIECES:
            return UNDECIDED, marks[top, 0], 0
        halve(piece, stack[top + 1], piece)
        marks[top + 1, 0], marks[top + 1, 1] = marks[top, 0], level + 1.0
        marks[top, 0] += 0.5 * width
        marks[top, 1] = level + 1.0
        top += 1
    return PROVEN, 0.0, 0


@kernel
def prove_unclouded(demands: Demands, centre: FloatArray, size: float) -> tuple[int, float]:
    """Decide every line of sight past every cloud; a cloud of radius 0 hides nothing."""
    for i in range(demands.clouds.shape[0]):
        radius = demands.clouds[i, 4]
        if radius > 0.0:
            points, nodes = cloud_points(demands, i), cloud_nodes(demands, i)
            status, w, _ = prove_sights_past_cloud(centre, size, demands.points, points, nodes, radius)
            if status != PROVEN:
                return status, w
    return PROVEN, 0.0


@kernel
def push_sights_off_clouds(
    demands: Demands,
    poses: FloatArray,
    first: int,
    targets: FloatArray,
    least: FloatArray,
    systems: FloatArray,
    costs: FloatArray,
) -> None:
    """Push every line of sight off the point nearest to it: g = (distance − r)/max(r, ℓ/20) (see `push`)."""
    for i in range(demands.clouds.shape[0]):
        group, radius = first + i, demands.clouds[i, 4]
        if radius <= 0.0 or targets[group] == ASLEEP:
            continue
        points, nodes = cloud_points(demands, i), cloud_nodes(demands, i)
        unit = max(radius, 0.05 * demands.numbers[2])
        for s in range(poses.shape[0]):
            t = poses[s, 9], poses[s, 10], poses[s, 11]
            for j in range(demands.points.shape[0]):
                h = demands.points[j]
                limit = radius + unit * max(targets[group], least[group])
                k, distance = nearest_point(points, nodes, t, (h[0], h[1], h[2]), limit)
                if k < 0:
                    continue
                g = (distance - radius) / unit
                least[group] = min(least[group], g)
                if g < targets[group]:
                    x, y, z, _, part = sight_offset(t[0], t[1], t[2], h, points[k])
                    f = (1.0 - part) / (unit * max(distance, 1e-9 * unit))
                    push_centre(systems, costs, s, poses, f * x, f * y, f * z, targets[group] - g)
