"""Occlusion by clouds: no ball of a cloud between camera and target point.

As for a sphere (`occlusion`), one plane a piece of the path; a node of the cloud's tree is first tried as one
sphere of radius r + ρ about its centre.
"""

import math
from typing import NamedTuple

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel, late, leaf
from omniservo.geometry.polynomial import UNIT, bernstein_from_power, magnitude
from omniservo.geometry.subdivision import (
    FAILS_AT_END,
    FAILS_AT_START,
    HOLDS,
    MAX_LEVEL,
    MAX_PIECES,
    OPEN,
    PROVEN,
    UNDECIDED,
    Bounds,
    Piece,
    Pieces,
    first_piece,
    subdivide,
)
from omniservo.geometry.vectors import copy_into
from omniservo.planning.constraints.cloud import cloud_nodes, cloud_points, farthest
from omniservo.planning.constraints.constraints import CLOUD_MOTION, CLOUD_RADIUS, Constraints
from omniservo.planning.constraints.motion import displacement, less_motion
from omniservo.planning.constraints.occlusion import plane_past_ball, sight_offset
from omniservo.planning.constraints.path_forms import PathForms
from omniservo.planning.constraints.place import AT, TX, TY, TZ
from omniservo.planning.constraints.push import ASLEEP, Samples, push_centre
from omniservo.planning.obstacles.ball_tree import END, FIRST, NEXT, RADIUS, nearest_point

_TOGETHER = 4
"""So often a piece is halved in the attempt to keep all lines of sight beyond one plane a ball."""


class _Sights(NamedTuple):
    """Lines of sight and the cloud that is to leave them free."""

    targets: FloatArray
    """Their far ends (n, 3) [m]; of a cloud that moves, room for those of a piece."""
    points: FloatArray
    """Of the cloud (p, 3)."""
    nodes: FloatArray
    """Its tree (k, 7)."""
    radius: float
    """[m]"""


@leaf
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
    pieces = first_piece(centre, np.empty((3, 0)), 0)
    together = _Sights(targets, points, nodes, radius)
    status, w, j = _prove_sights(centre, size, together, _TOGETHER, pieces)
    if status == UNDECIDED:
        for j in range(targets.shape[0]):
            one = _Sights(targets[j : j + 1], points, nodes, radius)
            status, w, _ = _prove_sights(centre, size, one, MAX_LEVEL, pieces)
            if status != PROVEN:
                return status, w, j
    return status, w, j


@leaf
def _prove_sights(
    centre: FloatArray, size: float, sights: _Sights, levels: int, pieces: Pieces
) -> tuple[int, float, int]:
    """Decide with one plane a piece and ball for all targets and at most ``levels`` halvings."""
    n, far, targets = centre.shape[1] - 1, farthest(sights.nodes), sights.targets
    for j in range(targets.shape[0]):
        far = max(far, abs(targets[j, 0]), abs(targets[j, 1]), abs(targets[j, 2]))
    error = UNIT * (4.0 * (size + 2.0 * far) + abs(sights.radius) + sights.nodes[0, RADIUS])
    copy_into(centre, pieces.curve[0])
    return subdivide(_sees_past, sights, pieces, Bounds(n + 22.0, float(n), error, levels, MAX_PIECES))


@leaf
def _sees_past(piece: Piece, sights: _Sights) -> tuple[int, int]:
    """Show all lines of sight of a piece past all balls, or one from an end of it through a ball."""
    curve, targets, n = piece.curve, sights.targets, piece.curve.shape[1] - 1
    hiding = first_hiding(curve, targets, sights.points, sights.nodes, sights.radius, piece.bound)
    if hiding < 0:
        return HOLDS, 0
    o, least = sights.points[hiding], sights.radius - piece.bound
    for j in range(targets.shape[0]):
        if sight_offset(curve[0, 0], curve[1, 0], curve[2, 0], targets[j], o)[3] < least:
            return FAILS_AT_START, j
        if sight_offset(curve[0, n], curve[1, n], curve[2, n], targets[j], o)[3] < least:
            return FAILS_AT_END, j
    return OPEN, 0


@kernel
def _prove_moving_sight(
    translation: FloatArray,
    motion: FloatArray,
    h: FloatArray,
    points: FloatArray,
    nodes: FloatArray,
    radius: float,
) -> tuple[int, float]:
    """Decide the line of sight to h (3,) past a cloud that moves: it runs from t − m to h − m.

    One plane a piece and ball has the control points of both beyond it; rows 3 to 5 are those of h − m.
    """
    away = less_motion(translation, motion)
    n = away.shape[1] - 1
    both = np.zeros((6, n + 1))
    still = np.zeros((3, 1))
    for c in range(3):
        still[c, 0] = h[c]
    seen = less_motion(still, motion)
    for c in range(3):
        for k in range(n + 1):
            both[c, k] = away[c, k]
        for k in range(seen.shape[1]):
            both[3 + c, n - k] = seen[c, seen.shape[1] - 1 - k]
    size = magnitude(both)
    error = UNIT * (4.0 * (size + 2.0 * max(size, farthest(nodes))) + abs(radius) + nodes[0, RADIUS])
    sights = _Sights(np.empty((n + 1, 3)), points, nodes, radius)
    pieces = first_piece(bernstein_from_power(both), np.empty((3, 0)), 0)
    bounds = Bounds(n + 24.0, float(n), error, MAX_LEVEL, MAX_PIECES)
    status, w, _ = subdivide(_sees_past_moving, sights, pieces, bounds)
    return status, w


@leaf
def _sees_past_moving(piece: Piece, sights: _Sights) -> tuple[int, int]:
    """Show a piece's line of sight past all balls, or that of an end of it through one.

    The curve's rows are t − m and h − m; the latter's control points are the far ends of a piece.
    """
    curve, far, n = piece.curve, sights.targets, piece.curve.shape[1] - 1
    for k in range(n + 1):
        for c in range(3):
            far[k, c] = curve[3 + c, k]
    hiding = first_hiding(curve[:3], far, sights.points, sights.nodes, sights.radius, piece.bound)
    if hiding < 0:
        return HOLDS, 0
    o, least = sights.points[hiding], sights.radius - piece.bound
    if sight_offset(curve[0, 0], curve[1, 0], curve[2, 0], far[0], o)[3] < least:
        return FAILS_AT_START, 0
    at_end = sight_offset(curve[0, n], curve[1, n], curve[2, n], far[n], o)[3]
    return (FAILS_AT_END if at_end < least else OPEN), 0


@late
def cloud_sight_margin(
    constraints: Constraints, index: int, pose: FloatArray, targets: FloatArray
) -> tuple[float, int]:
    """Return what cloud ``index`` leaves to the lines of sight at a pose (14,), and to which target least."""
    mx, my, mz = displacement(constraints.motions, constraints.clouds[index, CLOUD_MOTION], pose[AT])
    points, nodes = cloud_points(constraints, index), cloud_nodes(constraints, index)
    t = pose[TX] - mx, pose[TY] - my, pose[TZ] - mz
    least, about = math.inf, 0
    for j in range(targets.shape[0]):
        h = targets[j, 0] - mx, targets[j, 1] - my, targets[j, 2] - mz
        k, distance = nearest_point(points, nodes, t, h, least)
        if k >= 0:
            least, about = distance, j
    return least - float(constraints.clouds[index, CLOUD_RADIUS]), about


@late
def prove_cloud_sights(
    constraints: Constraints, index: int, margin: float, path: PathForms
) -> tuple[int, float, int]:
    """Decide the lines of sight past cloud ``index`` with ``margin`` to spare: status, w, target point."""
    radius, motion = (
        constraints.clouds[index, CLOUD_RADIUS] + margin,
        int(constraints.clouds[index, CLOUD_MOTION]),
    )
    points, nodes = cloud_points(constraints, index), cloud_nodes(constraints, index)
    if motion < 0:
        return prove_sights_past_cloud(path.centre, path.size, constraints.points, points, nodes, radius)
    for j in range(constraints.points.shape[0]):
        h = constraints.points[j]
        status, w = _prove_moving_sight(
            path.translation, constraints.motions[motion], h, points, nodes, radius
        )
        if status != PROVEN:
            return status, w, j
    return PROVEN, 0.0, 0


@late
def prove_unclouded(constraints: Constraints, path: PathForms) -> tuple[int, float]:
    """Decide every line of sight past every cloud; a cloud of radius 0 hides nothing."""
    for i in range(constraints.clouds.shape[0]):
        if constraints.clouds[i, CLOUD_RADIUS] > 0.0:
            status, w, _ = prove_cloud_sights(constraints, i, 0.0, path)
            if status != PROVEN:
                return status, w
    return PROVEN, 0.0


@late
def push_sights_off_clouds(constraints: Constraints, samples: Samples) -> None:
    """Push every line of sight off the point nearest to it: g = (distance − r)/max(r, ℓ/20) (see `push`)."""
    poses, targets, least = samples.poses, samples.targets, samples.least
    systems, costs = samples.systems, samples.costs
    h = np.empty(3)
    for i in range(constraints.clouds.shape[0]):
        group, radius = constraints.slots.cloud_sights + i, constraints.clouds[i, CLOUD_RADIUS]
        if radius <= 0.0 or targets[group] == ASLEEP:
            continue
        points, nodes = cloud_points(constraints, i), cloud_nodes(constraints, i)
        unit = max(radius, 0.05 * constraints.ell)
        for s in range(poses.shape[0]):
            mx, my, mz = displacement(constraints.motions, constraints.clouds[i, CLOUD_MOTION], poses[s, AT])
            t = poses[s, TX] - mx, poses[s, TY] - my, poses[s, TZ] - mz
            for j in range(constraints.points.shape[0]):
                h[0], h[1], h[2] = (
                    constraints.points[j, 0] - mx,
                    constraints.points[j, 1] - my,
                    constraints.points[j, 2] - mz,
                )
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
