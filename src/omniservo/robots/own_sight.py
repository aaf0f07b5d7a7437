"""Whether an arm's own links stand between its camera and what it looks at, between any samples too."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Literal

import mujoco
import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import RigidTransform

from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray, IntArray, finite_array
from omniservo.robots.arm import Arm
from omniservo.robots.gap_kernels import middle_of_piece
from omniservo.robots.joint_path import JointPath
from omniservo.robots.read_shapes import read_shapes
from omniservo.robots.shapes import Scene, Shapes
from omniservo.robots.sight_kernel import GAP, LEFT, POINT, SHAPE, Sights, lay, nearest_to_sights

_THIN = 1e-6
"""[m] radius of a line of sight"""

_SHORTEST = 2.0**-12
"""of the path: parts that are no longer are called hidden where they cannot be told from it"""


@with_field_docs
@dataclass(frozen=True)
class OwnSight:
    """What lies between an arm's camera and its points along a joint path."""

    status: Literal["free", "hidden"]
    """free: no link comes nearer to a line of sight than it is to keep, for every w"""
    link: str
    """the link that hides a point; "" where none does"""
    point: int
    w: float
    gap: float
    """of link and line there [m]; negative: depth"""
    kept: float = 0.0
    """what that link was to keep from it [m]"""

    @property
    def what(self) -> str:
        """Which link hides which point, by how much; "" where all are free."""
        if self.status == "free":
            return ""
        line = f"the line of sight to point {self.point}"
        if self.gap <= 0.0:
            return f"{self.link} stands {-1e3 * self.gap:.2f} mm into {line}"
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
    flange_T_camera: RigidTransform,
    base_points: npt.ArrayLike,
    *,
    kept: Mapping[str, float] | None = None,
) -> OwnSight:
    """Look whether links hide points from the camera on a path.

    A line of sight runs from the camera's centre to a point that stands still. The path is halved until, in
    the middle of each part, every link is farther from every line than the two can come nearer to each other
    before the part ends (`nearest_to_sights`). Distances are bounded from below by slabs between the two, as
    for `arm_clearance`. The camera's own housing is not looked at.

    Args:
        arm: whose links, those with shapes that move.
        path: of that arm.
        flange_T_camera: where the camera sits.
        base_points: (m, 3) in the base frame [m].
        kept: by link, what it keeps from every line [m]: how far line and link may be from where the path has
            them; but for what the last joint carries, which goes with the camera. None: nothing.

    Raises:
        InputError: wrong shape, NaN or infinity.
    """
    lines = _Lines(arm, flange_T_camera, finite_array("base_points", base_points, (None, 3)), kept or {})
    knots, pieces = path.bernstein_pieces()
    work = [(float(knots[i]), float(knots[i + 1]), pieces[i]) for i in range(len(pieces))][::-1]
    while work:
        begin, end, piece = work.pop()
        first, second, turns = np.empty_like(piece), np.empty_like(piece), np.empty(arm.dof)
        middle_of_piece(piece, first, second, turns)
        middle = 0.5 * (begin + end)
        if lines.all_clear(first[-1], turns):
            continue
        nearest = lines.nearest_pair(middle)
        if nearest.gap <= nearest.kept or end - begin < _SHORTEST:
            return nearest
        work += [(middle, end, second), (begin, middle, first)]
    return OwnSight("free", "", -1, 0.0, 0.0)


def own_sight_in(
    arm: Arm,
    q: npt.ArrayLike,
    flange_T_camera: RigidTransform,
    base_points: npt.ArrayLike,
    *,
    kept: Mapping[str, float] | None = None,
) -> OwnSight:
    """Look whether links hide points in one posture q (n,); its w is 0. See `own_sight`."""
    lines = _Lines(arm, flange_T_camera, finite_array("base_points", base_points, (None, 3)), kept or {})
    if lines.all_clear(finite_array("q", q, (arm.dof,)), np.zeros(arm.dof)):
        return OwnSight("free", "", -1, 0.0, 0.0)
    return lines.nearest_pair(0.0)


class _Lines:
    """The arm and one thin capsule that becomes every line of sight in turn."""

    def __init__(
        self, arm: Arm, flange_T_camera: RigidTransform, points: FloatArray, kept: Mapping[str, float]
    ) -> None:
        self._model, shapes, links, line = _arm_with_line(arm)
        self._chain, self._data, self._found = arm.chain, mujoco.MjData(self._model), np.zeros(4)
        self._shapes = shapes._replace(sizes=shapes.sizes.copy())
        centre = (arm.base_T_flange(np.zeros(arm.dof)) * flange_T_camera).translation
        kept_of = np.array([kept.get(self._link(g), 0.0) for g in range(self._model.ngeom)])
        kept_of[shapes.carried == arm.dof] = 0.0
        self._sights = Sights(points, np.array(centre), links, np.array([line]), kept_of)
        self._scene = Scene(
            frames=np.zeros((arm.dof + 1, 3, 4)),
            anchors=np.empty((arm.dof, 3)),
            directions=np.empty((arm.dof, 3)),
            places=self._data.geom_xpos,
            axes=self._data.geom_xmat,
            moves=np.zeros((0, 0)),
            normals=np.zeros((0, 3)),
        )

    def all_clear(self, q: FloatArray, turns: FloatArray) -> bool:
        """Tell whether ``turns`` leave something of every gap in a posture; see `nearest_to_sights`."""
        nearest_to_sights(
            self._chain, self._shapes, self._scene, self._sights, np.ascontiguousarray(q), turns, self._found
        )
        return bool(self._found[LEFT] >= 0.0)

    def nearest_pair(self, w: float) -> OwnSight:
        """Return the link that left least of a line in that posture, as if it hid its point at ``w``."""
        shape, point = int(self._found[SHAPE]), int(self._found[POINT])
        gap, kept = float(self._found[GAP]), float(self._sights.kept[shape])
        gap = self._measured() if gap == -np.inf else gap
        return OwnSight("hidden", self._link(shape), point, w, gap, kept)

    def _link(self, shape: int) -> str:
        return str(self._model.body(int(self._model.geom_bodyid[shape])).name)

    def _measured(self) -> float:
        """Return the distance of that link and line [m]: MuJoCo's, negative: depth."""
        model, line = copy.copy(self._model), int(self._sights.line[0])  # its sizes are not ours alone
        last = self._scene.frames[-1]
        centre = last[:, :3] @ self._sights.centre + last[:, 3]
        point = self._sights.points[int(self._found[POINT])]
        lay(centre, point, model.geom_size[line], self._data.geom_xpos[line], self._data.geom_xmat[line])
        model.geom_rbound[line] = model.geom_size[line, :2].sum()
        return float(mujoco.mj_geomDistance(model, self._data, int(self._found[SHAPE]), line, 10.0, None))


@lru_cache(maxsize=8)
def _arm_with_line(arm: Arm) -> tuple[Any, Shapes, IntArray, int]:
    """Return an arm's model with a line of sight, its shapes, which of them may hide, and the line."""
    spec = arm.spec()
    holder = spec.worldbody.add_body(name="line of sight", mocap=True)
    holder.add_geom(type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[_THIN, 0.1, 0.0])
    model = spec.compile()
    shapes = read_shapes(model, mujoco.MjData(model), np.zeros(model.ngeom, dtype=np.bool_))
    links = np.flatnonzero((model.geom_contype != 0) & (shapes.carried > 0))
    return model, shapes, links, int(model.body("line of sight").geomadr[0])
