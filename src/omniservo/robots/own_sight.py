"""Whether an arm's own links stand between its camera and what it looks at, between any samples too."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import mujoco
import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.geometry.arrays import FloatArray, finite_array
from omniservo.robots.arm import Arm
from omniservo.robots.gap_kernels import farthest_moves, middle_of_piece
from omniservo.robots.joint_path import JointPath
from omniservo.robots.read_shapes import read_shapes

_THIN = 1e-6
"""[m] radius of a line of sight"""

_SHORTEST = 2.0**-12
"""of the path: parts that are no longer are called hidden where they cannot be told from it"""


@dataclass(frozen=True)
class OwnSight:
    """What lies between an arm's camera and its points along a joint path."""

    status: Literal["free", "hidden"]
    """free: no line of sight meets a link, for every w; MuJoCo's distance search is trusted for that"""
    link: str
    """the link that hides a point; "" where none does"""
    point: int
    w: float
    gap: float
    """of link and line there [m]; negative: depth"""

    @property
    def reason(self) -> str:
        """Which link hides which point, at which w, by how much; "" where all are free."""
        if self.status == "free":
            return ""
        where = f"the line of sight to point {self.point} at w = {self.w:.4f}"
        if self.gap <= 0.0:
            return f"{self.link} stands {-1e3 * self.gap:.2f} mm into {where}"
        return f"{self.link} comes within {1e3 * self.gap:.3f} mm of {where}: not told from hidden"


def own_sight(
    arm: Arm, path: JointPath, flange_T_camera: RigidTransform, base_points: npt.ArrayLike
) -> OwnSight:
    """Look whether links hide points from the camera on a path.

    A line of sight runs from the camera's centre c to a point that stands still. While joints turn by no more
    than a part of the path allows, a link comes nearer by its own move at most, and the line by that of c:
    both at most Σ r_j · turn_j (`gap_kernels.farthest_moves`). It is halved until, in the middle of each
    part, every link is farther from every line than that. The camera's own housing is not looked at.

    Args:
        arm: whose links, those with shapes that move.
        path: of that arm.
        flange_T_camera: where the camera sits.
        base_points: (m, 3) in the base frame [m].

    Raises:
        InputError: wrong shape, NaN or infinity.
    """
    lines = _Lines(arm, flange_T_camera, finite_array("base_points", base_points, (None, 3)))
    knots, pieces = path.bernstein_pieces()
    work = [(float(knots[i]), float(knots[i + 1]), pieces[i]) for i in range(len(pieces))][::-1]
    while work:
        begin, end, piece = work.pop()
        first, second, turns = np.empty_like(piece), np.empty_like(piece), np.empty(arm.dof)
        middle_of_piece(piece, first, second, turns)
        middle = 0.5 * (begin + end)
        link, point, gap, left = lines.nearest(first[-1], turns)
        if left < 0.0 and (gap <= 0.0 or end - begin < _SHORTEST):
            return OwnSight("hidden", link, point, middle, gap)
        if left < 0.0:
            work += [(middle, end, second), (begin, middle, first)]
    return OwnSight("free", "", -1, 0.0, 0.0)


class _Lines:
    """The arm and one thin capsule that becomes every line of sight in turn."""

    def __init__(self, arm: Arm, flange_T_camera: RigidTransform, points: FloatArray) -> None:
        self._arm, self._mount, self._points = arm, flange_T_camera, points
        spec = arm.spec()
        holder = spec.worldbody.add_body(name="line of sight", mocap=True)
        holder.add_geom(type=mujoco.mjtGeom.mjGEOM_CAPSULE, size=[_THIN, 0.1, 0.0])
        self._model: Any = spec.compile()
        self._data = mujoco.MjData(self._model)
        self._line = int(self._model.body("line of sight").geomadr[0])
        self._shapes = read_shapes(self._model, self._data, np.zeros(self._model.ngeom, dtype=np.bool_))
        touched = (self._model.geom_contype != 0) & (self._shapes.carried > 0)
        self._links = np.flatnonzero(touched).tolist()
        self._moves = np.zeros((self._model.ngeom, arm.dof + 1))

    def nearest(self, q: FloatArray, turns: FloatArray) -> tuple[str, int, float, float]:
        """Return link, point, gap [m], and what is left of it: of the pair with the least left."""
        data, shapes = self._data, self._shapes
        data.qpos[:] = q
        centre = (self._arm.base_T_flange(q) * self._mount).translation
        mujoco.mj_kinematics(self._model, data)
        farthest_moves(
            data.xanchor, data.xaxis, data.geom_xpos, shapes.radii, shapes.carried, shapes.spins, turns,
            self._moves,
        )  # fmt: skip
        radii = np.linalg.norm(np.cross(centre - data.xanchor, data.xaxis), axis=1)
        moved = self._moves[:, 0] + float(radii @ turns)
        least = ("", -1, np.inf, np.inf)
        for number, point in enumerate(self._points):
            self._lay(centre, point)
            for shape in self._links:
                needed = float(moved[shape])
                if self._ball_gap(shape, centre, point) > needed:
                    continue
                gap = mujoco.mj_geomDistance(self._model, data, shape, self._line, 10.0, None)
                if gap - needed < least[3]:
                    name = str(self._model.body(int(self._model.geom_bodyid[shape])).name)
                    least = (name, number, float(gap), float(gap) - needed)
        return least

    def _lay(self, centre: FloatArray, point: FloatArray) -> None:
        """Make the capsule the line from the camera's centre to a point."""
        way = point - centre
        length = float(np.linalg.norm(way))
        self._model.geom_size[self._line, 1] = 0.5 * length
        self._model.geom_rbound[self._line] = 0.5 * length + _THIN
        self._data.geom_xpos[self._line] = 0.5 * (point + centre)
        turn = Rotation.align_vectors([way / max(length, 1e-300)], [[0.0, 0.0, 1.0]])[0]
        self._data.geom_xmat[self._line] = turn.as_matrix().ravel()

    def _ball_gap(self, shape: int, centre: FloatArray, point: FloatArray) -> float:
        """Return the distance of the line to the ball about a shape."""
        way, to = point - centre, self._data.geom_xpos[shape] - centre
        along = np.clip(way @ to / max(float(way @ way), 1e-300), 0.0, 1.0)
        return float(np.linalg.norm(to - along * way) - self._shapes.radii[shape])
