"""What the figures of space show, in plotted coordinates."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import combinations, product

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.geometry.arrays import FloatArray
from omniservo.reporting.curves import Curve, executed_curve, planned_curve
from omniservo.reporting.upright_axes import UprightAxes
from omniservo.simulation.run_result import RunResult
from omniservo.tasks.obstacles import BoxSection, CapsuleSection, CloudSection, SphereSection

_SYMBOLS = 6
_LEAST_SYMBOL = 1e-3
_LEAST_REACH = 0.01
"""a point without any distance around it is drawn so large [mm]"""
_SHOWN_OF_CLOUDS = 2000
"""Points of clouds that are drawn at most: those near the way, thinned out."""
_BITS = list(product((0, 1), repeat=3))
_EDGES = [
    (i, j)
    for i, j in combinations(range(8), 2)
    if sum(a != b for a, b in zip(_BITS[i], _BITS[j], strict=True)) == 1
]


@dataclass(frozen=True)
class KeepOut:
    """A planning obstacle with the distance asked around it."""

    outline: FloatArray
    """(k, 3) points whose convex hull it is [mm]"""
    mark: FloatArray
    """(3,) its middle [mm]"""
    has_own_clearance: bool
    """its task gives it a clearance of its own"""


@dataclass(frozen=True)
class Space:
    """Everything in plotted coordinates [mm]."""

    planned: FloatArray | None
    """(k, 3)"""
    executed: FloatArray
    """(k, 3), possibly none"""
    points: FloatArray
    """(n, 3) estimated points"""
    bodies: tuple[FloatArray, ...]
    """(8, 3) corners of each real block, counted up in (±, ±, ±)"""
    keep_out: tuple[KeepOut, ...]
    """half-spaces and clouds are not among them"""
    clouds: FloatArray
    """(k, 3) some points of all clouds"""
    symbols: tuple[FloatArray, ...]
    """lines (j, 3) of the camera's symbol at moments evenly spaced along the way"""

    @property
    def extent(self) -> FloatArray:
        """(2, 3) lowest and highest coordinates of everything shown."""
        parts = [self.points, self.executed, *self.bodies, *self.symbols]
        parts += [] if self.planned is None else [self.planned]
        parts += [self.clouds, *(region.outline for region in self.keep_out)]
        every = np.vstack(parts)
        return np.stack([every.min(axis=0), every.max(axis=0)])


def space_of(result: RunResult, upright: UprightAxes) -> Space:
    """Return what a run's figures of space show."""
    planned, executed = planned_curve(result), executed_curve(result)
    points = upright.apply(result.points)
    shown = executed if len(executed) else planned
    planning = result.task.planning
    size = 0.06 * float(np.ptp(np.vstack([points, np.zeros((1, 3))]), axis=0).max()) / 1000.0
    known = dict.fromkeys((*planning.obstacles, *result.task.known_obstacles(np.inf)))
    space = Space(
        planned=None if planned is None else upright.apply(planned.positions),
        executed=upright.apply(executed.positions),
        points=points,
        bodies=tuple(upright.apply(corners) for corners in result.truth.obstacle_corners),
        keep_out=tuple(
            _keep_out(o, planning.clearance, upright)
            for o in known
            if isinstance(o, SphereSection | BoxSection | CapsuleSection)
        ),
        clouds=np.zeros((0, 3)),
        symbols=() if shown is None else tuple(upright.apply(line) for line in _symbols(shown, size)),
    )
    clouds = [upright.apply(o.obstacle.points) for o in known if isinstance(o, CloudSection)]
    return replace(space, clouds=_thinned(np.concatenate(clouds), space.extent)) if clouds else space


def _thinned(points: FloatArray, extent: FloatArray) -> FloatArray:
    """Return some of the points (k, 3) that are no farther from what else is shown than that is large."""
    (low, high), room = extent, float(np.ptp(extent, axis=0).max())
    near = points[((points >= low - 0.5 * room) & (points <= high + 0.5 * room)).all(axis=1)]
    shown: FloatArray = near[:: 1 + len(near) // _SHOWN_OF_CLOUDS]
    return shown


def box_edges(corners: FloatArray) -> list[FloatArray]:
    """Return the 12 edges (2, 3) of a box from its corners (8, 3), counted up in (±, ±, ±)."""
    return [corners[[i, j]] for i, j in _EDGES]


def box_faces(corners: FloatArray) -> list[FloatArray]:
    """Return the 6 faces of a box, each as a grid (2, 2, 3) of its corners, as in `box_edges`."""
    cube = corners.reshape(2, 2, 2, 3)
    return [np.take(cube, side, axis=axis) for axis in range(3) for side in (0, 1)]


def _keep_out(
    section: SphereSection | BoxSection | CapsuleSection, clearance: float, upright: UprightAxes
) -> KeepOut:
    """Return the obstacle's corners, each with a sphere of the asked distance around it."""
    if isinstance(section, SphereSection):
        corners, radius = np.array([section.center]), section.radius
    elif isinstance(section, CapsuleSection):
        corners, radius = np.array([section.start, section.end]), section.radius
    else:
        half = np.array(section.half_extents) * (2.0 * np.array(_BITS) - 1.0)
        corners = section.center + Rotation.from_rotvec(section.rotation_vector).apply(half)
        radius = 0.0
    own = section.clearance is not None
    asked = clearance if section.clearance is None else section.clearance
    reach = max(_LEAST_REACH, 1000.0 * (radius + asked))
    shown = upright.apply(corners)
    return KeepOut((shown[:, None] + reach * _unit_sphere()).reshape(-1, 3), shown.mean(axis=0), own)


def _unit_sphere() -> FloatArray:
    """Return points (k, 3) all over the unit sphere."""
    polar, around = np.meshgrid(np.linspace(0, np.pi, 19), np.linspace(0, 2 * np.pi, 37)[:-1], indexing="ij")
    grid = np.stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)], axis=-1)
    return np.asarray(grid.reshape(-1, 3), dtype=np.float64)


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
