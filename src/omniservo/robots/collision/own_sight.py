"""Whether the arm, what it carries or what stands around it hides points from its camera, for all w."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import RigidTransform

from omniservo.errors import InputError
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray, finite_array, finite_number
from omniservo.robots.arm import Arm
from omniservo.robots.collision.arm_bodies import MOUNTED, ArmBodies
from omniservo.robots.collision.gap_kernels import HALF_SPACE, TAPERED, middle_of_piece, slab
from omniservo.robots.collision.gap_search import widen
from omniservo.robots.collision.mounted_camera import MountedCamera
from omniservo.robots.collision.shapes import Bodies, PlacedShapes
from omniservo.robots.collision.sight_kernel import LEFT, POINT, SHAPE, Sights, nearest_to_sights
from omniservo.robots.collision.solid import Solid
from omniservo.robots.path_following.joint_path import JointPath

_LINE = "line of sight"

_SHORTEST = 2.0**-12
"""of the path: parts that are no longer are called hidden where they cannot be distinguished from it"""


@with_field_docs
@dataclass(frozen=True)
class OwnSight:
    """What lies between an arm's camera and its points along a joint path."""

    status: Literal["free", "hidden"]
    """free: no body comes nearer to a line of sight than it is to keep, for every w"""
    link: str
    """the link, or what is carried or stands around, that hides a point; "" where none does"""
    point: int
    w: float
    gap: float
    """of body and line there [m]; negative: depth, how far it would have to go across the line"""
    kept: float = 0.0
    """what that body was to keep from it, at the camera [m]"""

    @property
    def what(self) -> str:
        """What hides which point, by how much; "" where all are free."""
        if self.status == "free":
            return ""
        line = f"the line of sight to point {self.point}"
        if self.gap <= 0.0:
            return f"{self.link} stands {1e3 * abs(self.gap):.2f} mm into {line}"
        if self.gap <= self.kept:
            kept = f"{1e3 * self.kept:.2f} mm are kept from it for what a run strays"
            return f"{self.link} comes within {1e3 * self.gap:.2f} mm of {line} ({kept})"
        return f"{self.link} comes within {1e3 * self.gap:.3f} mm of {line}, not told from hidden,"

    @property
    def reason(self) -> str:
        """`what`, and at which w; "" where all are free."""
        return f"{self.what} at w = {self.w:.4f}" if self.what else ""


def own_sight(
    arm: Arm,
    path: JointPath,
    camera: MountedCamera,
    base_points: npt.ArrayLike,
    *,
    surroundings: tuple[Solid, ...] = (),
    kept: Mapping[str, float] | None = None,
    camera_strays: float = 0.0,
    span: tuple[float, float] = (0.0, 1.0),
) -> OwnSight:
    """Look whether the arm, what it carries or what stands around hides points from the camera on a path.

    A line of sight runs from the camera's centre to `SURFACE` before a point that stands still. The path is
    halved until, in the middle of each part, every body is farther from every line than the two can come
    nearer to each other before the part ends (`nearest_to_sights`). Distances are bounded from below by slabs
    between the two, as for `arm_clearance`. A mounted body that holds the camera's centre is what the camera
    looks out of, and hides nothing.

    Args:
        arm: whose links, the base among them, may hide points.
        path: of that arm.
        camera: where it sits, and what is mounted beside it.
        base_points: (m, 3) in the base frame [m].
        surroundings: what else may, in the base frame.
        kept: by link, what it keeps from every line [m]: how far it may be from where the path has it. None:
            nothing.
        camera_strays: how far the camera's centre may be from there [m]: everything keeps so much more from a
            line at its beginning, evenly less until its point. But for what the last joint carries, which
            goes with the camera: that keeps nothing.
        span: of w, the part of the path that is checked.

    Raises:
        InputError: wrong shape, NaN or infinity; a path of another number of joints, or a span that is not on
            it.
    """
    lines = _Lines(arm, camera, base_points, surroundings, kept or {}, camera_strays)
    still = np.zeros(arm.dof)
    knots, pieces = path.bernstein_pieces(*span)
    if pieces.shape[2] != arm.dof:
        raise InputError(f"path: of {pieces.shape[2]} joints; {arm.name} has {arm.dof}")
    work = [(float(knots[i]), float(knots[i + 1]), pieces[i]) for i in range(len(pieces))][::-1]
    while work:
        begin, end, piece = work.pop()
        first, second, turns = np.empty_like(piece), np.empty_like(piece), np.empty(arm.dof)
        middle_of_piece(piece, first, second, turns)
        middle = 0.5 * (begin + end)
        if lines.are_clear(first[-1], turns):
            continue
        if end - begin < _SHORTEST or not lines.are_clear(first[-1], still):
            return lines.hidden(middle)
        work += [(middle, end, second), (begin, middle, first)]
    return _FREE


def own_sight_in(
    arm: Arm,
    q: npt.ArrayLike,
    camera: MountedCamera,
    base_points: npt.ArrayLike,
    *,
    surroundings: tuple[Solid, ...] = (),
    kept: Mapping[str, float] | None = None,
    camera_strays: float = 0.0,
) -> OwnSight:
    """Look whether points are hidden in one configuration q (n,); its w is 0. See `own_sight`."""
    lines = _Lines(arm, camera, base_points, surroundings, kept or {}, camera_strays)
    is_clear = lines.are_clear(finite_array("q", q, (arm.dof,)), np.zeros(arm.dof))
    return _FREE if is_clear else lines.hidden(0.0)


_FREE = OwnSight("free", "", -1, 0.0, 0.0)


class _Lines:
    """The arm, what it carries and stands around, and one body that becomes every line of sight in turn."""

    def __init__(
        self,
        arm: Arm,
        camera: MountedCamera,
        base_points: npt.ArrayLike,
        surroundings: tuple[Solid, ...],
        kept: Mapping[str, float],
        camera_strays: float,
    ) -> None:
        points = finite_array("base_points", base_points, (None, 3))
        finite_number("camera_strays", camera_strays, minimum=0.0)
        self._bodies = bodies = _arm_with_line(arm, camera, surroundings)
        shapes, self._found, self._q = bodies.shapes, np.zeros(3), np.zeros(arm.dof)
        carried = bodies.shapes_of(MOUNTED).tolist() if camera.mounted else []
        self._carried = dict(zip(carried, (solid.name for solid in camera.mounted), strict=True))
        line = len(shapes.kinds) - 1  # it was added last
        self._shapes = shapes._replace(kinds=shapes.kinds.copy(), sizes=shapes.sizes.copy())
        self._shapes.kinds[line] = TAPERED
        at_points = np.array([kept.get(bodies.owner(g), 0.0) for g in range(len(shapes.kinds))])
        at_camera = at_points + camera_strays
        at_points[shapes.carried == arm.dof] = at_camera[shapes.carried == arm.dof] = 0.0
        centre = (arm.base_T_flange(self._q) * camera.flange_T_camera).translation
        hiders = np.arange(line)
        self._sights = Sights(points, np.array(centre), hiders, line, at_camera, at_points)
        self._chain, self._scene = (
            arm.chain,
            PlacedShapes(
                frames=np.zeros((arm.dof + 1, 3, 4)),
                anchors=np.empty((arm.dof, 3)),
                directions=np.empty((arm.dof, 3)),
                places=np.empty((len(shapes.kinds), 3)),
                axes=np.empty((len(shapes.kinds), 9)),
                moves=np.zeros((0, 0)),
                normals=np.zeros((0, 3)),
            ),
        )
        around_camera = [g for g in carried if self._left_of(g, self._sights.centre) < 0.0]
        self._sights = self._sights._replace(hiders=np.setdiff1d(hiders, around_camera))

    def are_clear(self, q: FloatArray, turns: FloatArray) -> bool:
        """Tell whether ``turns`` leave something of every gap in a configuration; see `nearest_to_sights`."""
        self._q = np.ascontiguousarray(q)
        nearest_to_sights(self._chain, self._shapes, self._scene, self._sights, self._q, turns, self._found)
        return bool(self._found[LEFT] >= 0.0)

    def hidden(self, w: float) -> OwnSight:
        """Return that at ``w`` what left least of a line, when they were last checked, hides it."""
        shape, point = int(self._found[SHAPE]), int(self._found[POINT])
        kept = float(self._sights.at_camera[shape])
        link = self._carried.get(shape) or self._bodies.owner(shape)
        return OwnSight("hidden", link, point, w, self._gap(shape, point), kept)

    def _gap(self, shape: int, point: int) -> float:
        """Return the distance of a shape and a line [m]; negative: depth, the least across the line."""
        left, line = self._left_of(shape, self._sights.points[point]), self._sights.line
        shapes, places, axes = self._shapes, self._scene.places, self._scene.axes
        bodies = Bodies(shapes.kinds, shapes.sizes, shapes.radii, shapes.corners, shapes.firsts, places, axes)
        if left == math.inf:  # so far that the search was spared
            left, _ = widen(bodies, shape, line, np.zeros(3), np.empty(6), np.empty((4, 7)))
        if left >= 0.0 or shapes.kinds[shape] == HALF_SPACE:
            return float(left)
        line_axes, best, within = axes[line].reshape(3, 3), 0.0, math.pi
        for _ in range(3):
            turns = best + np.linspace(-within, within, 33)
            across = line_axes[:, :2] @ [np.cos(turns), np.sin(turns)]
            depths = [-slab(bodies, shape, line, *normal) for normal in across.T.tolist()]
            best, within = float(turns[np.argmin(depths)]), within / 16.0
        return -max(min(depths), 0.0)

    def _left_of(self, shape: int, point: FloatArray) -> float:
        """Return the slab between a shape and the thin line to a point (3,) [m]; see `nearest_to_sights`."""
        nothing = np.zeros_like(self._sights.at_camera)
        thin = self._sights._replace(
            points=point[None], hiders=np.array([shape]), at_camera=nothing, at_points=nothing
        )
        still, scene = np.zeros_like(self._q), self._scene
        nearest_to_sights(self._chain, self._shapes, scene, thin, self._q, still, self._found)
        return float(self._found[LEFT])


@lru_cache(maxsize=8)
def _arm_with_line(arm: Arm, camera: MountedCamera, surroundings: tuple[Solid, ...]) -> ArmBodies:
    """Return an arm, what it carries, what stands around, and beside it a thin capsule."""
    line = Solid(_LINE, "capsule", np.array([1e-6, 0.1]), RigidTransform.identity())
    mounted = [solid.moved(camera.flange_T_camera) for solid in camera.mounted]
    return ArmBodies(arm, mounted=mounted, surroundings=(*surroundings, line))
