"""What the figures of space show, in plotted coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.spatial import ConvexHull
from scipy.spatial.transform import RigidTransform

from omniservo.geometry.arrays import FloatArray
from omniservo.planning.obstacles.core import unit_sphere
from omniservo.planning.obstacles.obstacle import Body
from omniservo.reporting.curves import Curve, executed_curve, planned_curve
from omniservo.reporting.upright_axes import UprightAxes
from omniservo.results.run_result import RunResult
from omniservo.tasks.obstacles import CloudSection, HalfSpaceSection

_SYMBOLS = 6
_ROOM = 0.2
"""around path and target, of the longest side of both"""
_LEAST_SYMBOL = 1e-3
_LEAST_REACH = 0.01
"""a point without any distance around it is drawn so large [mm]"""
_SHOWN_OF_CLOUDS = 2000
"""Points of clouds that are drawn at most: those near the way, thinned out."""


@dataclass(frozen=True)
class KeepOut:
    """A planning obstacle with the distance required around it."""

    outline: FloatArray
    """(k, 3) points whose convex hull it is [mm]"""
    mark: FloatArray
    """(3,) its middle [mm]"""
    has_own_clearance: bool
    """its task gives it a clearance of its own"""


@dataclass(frozen=True)
class Space:
    """Everything in plotted coordinates [mm]."""

    view: FloatArray
    """(2, 3) lowest and highest coordinates: of path and target, with room around"""
    planned: FloatArray | None
    """(k, 3)"""
    executed: FloatArray
    """(k, 3), possibly none"""
    points: FloatArray
    """(n, 3) estimated points"""
    bodies: tuple[tuple[FloatArray, ...], ...]
    """what is in view of each real block's faces (k, 3), convex polygons"""
    keep_out: tuple[KeepOut, ...]
    """half-spaces and clouds are not among them"""
    clouds: FloatArray
    """(k, 3) some points of all clouds"""
    symbols: tuple[FloatArray, ...]
    """lines (j, 3) of the camera's symbol at moments evenly spaced along the way"""


def space_of(result: RunResult, upright: UprightAxes) -> Space:
    """Return what a run's figures of space show: what is near path and target, the rest cut off."""
    planned, executed = planned_curve(result), executed_curve(result)
    points = upright.apply(result.points)
    shown = executed if len(executed) else planned
    planning = result.task.planning
    size = 0.06 * float(np.ptp(np.vstack([points, np.zeros((1, 3))]), axis=0).max()) / 1000.0
    known = dict.fromkeys((*planning.obstacles, *result.task.known_obstacles(np.inf)))
    symbols = () if shown is None else tuple(upright.apply(line) for line in _symbols(shown, size))
    ways = [upright.apply(curve.positions) for curve in (planned, executed) if curve is not None]
    view = _around(np.vstack([points, *ways, *symbols]))
    clouds = [upright.apply(o.obstacle.points) for o in known if isinstance(o, CloudSection)]
    regions = [
        _keep_out(o.obstacle, planning.clearance, upright)
        for o in known
        if not isinstance(o, CloudSection | HalfSpaceSection)
    ]
    return Space(
        view=view,
        planned=None if planned is None else ways[0],
        executed=ways[-1],
        points=points,
        bodies=tuple(
            faces
            for corners in (() if result.truth is None else result.truth.obstacle_corners)
            if (faces := cut_faces(box_faces(upright.apply(corners)), view))
        ),
        keep_out=tuple(
            replace(region, outline=cut) for region in regions if len(cut := cut_hull(region.outline, view))
        ),
        clouds=_thinned(np.concatenate([np.zeros((0, 3)), *clouds]), view),
        symbols=symbols,
    )


def _around(core: FloatArray) -> FloatArray:
    """Return the box (2, 3) around points (k, 3), with room for what stands near them."""
    low, high = core.min(axis=0), core.max(axis=0)
    room = _ROOM * float((high - low).max())
    return np.stack([low - room, high + room])


def _thinned(points: FloatArray, view: FloatArray) -> FloatArray:
    """Return some of the points (k, 3) in the view."""
    near = points[((points >= view[0]) & (points <= view[1])).all(axis=1)]
    shown: FloatArray = near[:: 1 + len(near) // _SHOWN_OF_CLOUDS]
    return shown


def box_faces(corners: FloatArray) -> list[FloatArray]:
    """Return the 6 faces (4, 3) of a box from its corners (8, 3), counted up in (±, ±, ±)."""
    cube = corners.reshape(2, 2, 2, 3)
    grids = [np.take(cube, side, axis=axis).reshape(4, 3) for axis in range(3) for side in (0, 1)]
    return [grid[[0, 1, 3, 2]] for grid in grids]


def cut_faces(faces: Sequence[FloatArray], view: FloatArray) -> tuple[FloatArray, ...]:
    """Return the parts of convex polygons (k, 3) in a box (2, 3); polygons outside it are left out."""
    kept = []
    for face in faces:
        for axis, side in product(range(3), (0, 1)):
            face = _cut(face, _beyond(face, view, axis, side))
        if len(face) > 2:
            kept.append(face)
    return tuple(kept)


def cut_hull(points: FloatArray, view: FloatArray) -> FloatArray:
    """Return points (m, 3) whose convex hull is that of points (k, 3) cut to a box (2, 3); maybe none."""
    for axis, side in product(range(3), (0, 1)):
        beyond = _beyond(points, view, axis, side)
        if (beyond >= 0.0).all():
            return np.zeros((0, 3))
        if (beyond > 0.0).any():
            hull = ConvexHull(points).simplices
            edges = np.unique(np.sort(np.vstack([hull[:, [0, 1]], hull[:, [1, 2]], hull[:, [0, 2]]])), axis=0)
            crossing = edges[beyond[edges].min(axis=1) * beyond[edges].max(axis=1) < 0.0]
            shares = (beyond[crossing[:, 0]] / (beyond[crossing[:, 0]] - beyond[crossing[:, 1]]))[:, None]
            ends = points[crossing]
            points = np.vstack([points[beyond <= 0.0], ends[:, 0] + shares * (ends[:, 1] - ends[:, 0])])
    return points


def _beyond(points: FloatArray, view: FloatArray, axis: int, side: int) -> FloatArray:
    """Return how far points (k, 3) lie beyond one side of the box (k,)."""
    return np.asarray((points[:, axis] - view[side, axis]) * (2 * side - 1))


def _cut(polygon: FloatArray, beyond: FloatArray) -> FloatArray:
    """Return the part of a convex polygon (k, 3) where ``beyond`` (k,), linear on it, is not positive."""
    corners: list[FloatArray] = []
    for i in range(len(polygon)):
        before, here = beyond[i - 1], beyond[i]
        if min(before, here) < 0.0 < max(before, here):
            corners.append(polygon[i - 1] + before / (before - here) * (polygon[i] - polygon[i - 1]))
        if here <= 0.0:
            corners.append(polygon[i])
    return np.array(corners).reshape(-1, 3)


def _keep_out(obstacle: Body, clearance: float, upright: UprightAxes) -> KeepOut:
    """Return points whose hull is the obstacle with the required distance around it."""
    corners, radius = obstacle.core.outline()
    own = obstacle.clearance is not None
    asked = clearance if obstacle.clearance is None else obstacle.clearance
    reach = max(_LEAST_REACH, 1000.0 * (radius + asked))
    shown, directions = upright.apply(corners), unit_sphere()
    farthest = shown[np.argmax(directions @ shown.T, axis=1)]
    return KeepOut(farthest + reach * directions, shown.mean(axis=0), own)


def _symbols(curve: Curve, size: float) -> list[FloatArray]:
    """Return a pyramid's lines (j, 3) [m] for each of a few poses; its depth is ``size`` [m]."""
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(curve.positions, axis=0), axis=1))])
    chosen = np.unique(np.searchsorted(way, np.linspace(0.0, way[-1], _SYMBOLS)).clip(0, len(way) - 1))
    poses, depth = curve.poses, max(size, _LEAST_SYMBOL)
    return [line for index in chosen for line in _pyramid(poses[int(index)], depth)]


def _pyramid(pose: RigidTransform, depth: float) -> list[FloatArray]:
    wide, high = 0.75 * depth, 0.5 * depth
    rim = np.array([[-wide, -high, depth], [wide, -high, depth], [wide, high, depth], [-wide, high, depth]])
    lines = [np.vstack([rim, rim[:1]])] + [np.vstack([np.zeros(3), corner]) for corner in rim]
    return [np.asarray(pose.apply(line), dtype=np.float64) for line in lines]
