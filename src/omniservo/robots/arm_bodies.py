"""The whole arm as bodies among others: which pairs may meet, and how near they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray, IntArray, finite_array
from omniservo.robots.arm import Arm
from omniservo.robots.gap_kernels import CAPSULE, CYLINDER, SPHERE, farthest_moves, lower_gaps
from omniservo.robots.solid import Solid

MOUNTED = "camera"
"""What the bodies that the tool carries are called together."""

_FAR = 100.0
"""[m] farther than any two bodies that are asked about"""

_SAME_AXIS = 1e-9
"""[m], [rad] between the axes of a shape and of a joint that count as one"""

_ON_TOP = 1e-9
"""[m] bodies that are no farther apart leave no direction between them"""


@dataclass(frozen=True, eq=False)
class Nearness:
    """Two bodies that are close."""

    pair: int
    gap: float
    """[m], negative: depth"""
    slope: FloatArray
    """∂gap/∂q (n,) [m/rad]"""
    place: FloatArray
    """(3,) the first body's point that is nearest, in the base frame [m]"""
    direction: FloatArray
    """(3,) unit, from the first body to the second, in the base frame"""


class ArmBodies:
    """An arm, what it carries and what stands around it, in any posture; not for two threads at once.

    Pairs are those that may meet: any part that moves with what stands around, and parts of the arm that
    neither share a joint nor are left out by the arm's file (see `omniservo.robots.Arm.notices`).
    """

    def __init__(
        self, arm: Arm, *, mounted: Sequence[Solid] = (), surroundings: Sequence[Solid] = ()
    ) -> None:
        """Put everything together.

        Args:
            arm: with the shapes of its file that can be touched; a mesh counts as its convex hull.
            mounted: what the tool carries, in the flange frame; one body called `MOUNTED`.
            surroundings: what stands around, in the base frame; names are unique.

        Raises:
            InputError: two surroundings of one name.
        """
        names = [solid.name for solid in surroundings]
        if len(set(names)) < len(names):
            raise InputError(f"surroundings: {max(names, key=names.count)!r} is given twice")
        self.arm = arm
        spec = arm.spec()
        if mounted:
            holder = spec.body(arm.tool_link).add_body(name=MOUNTED)
            for solid in mounted:
                solid.moved(arm.link_T_flange).add_to(spec, holder).mass = 1e-3
        self._around = [f"around {i}" for i in range(len(surroundings))]
        for name, solid in zip(self._around, surroundings, strict=True):
            solid.add_to(spec, spec.worldbody.add_body(name=name))
        self._model: Any = spec.compile()
        self._data: Any = mujoco.MjData(self._model)
        self._names = dict(zip(self._around, names, strict=True))
        self._shapes = _Shapes(self._model, self._data)
        self.pairs = _pairs(self._model, self._shapes.carried, set(self._around))
        """(p, 2) of shapes that may meet; the second is carried by more joints"""
        self._normals = np.zeros((len(self.pairs), 3))
        self._moves = np.zeros((self._model.ngeom, arm.dof + 1))
        fixed, moving = self._shapes.carried[self.pairs].T
        # A shape that the first joint between turns about its own axis sees the other one turned, no nearer.
        self._first_between = np.minimum(fixed + self._shapes.spun_by_next[self.pairs[:, 0]], moving)
        self._fromto = np.zeros(6)

    def names(self, pair: int) -> tuple[str, str]:
        """Return what a pair is called: the link, and the surroundings or the other link."""
        fixed, moving = (
            str(self._model.body(int(self._model.geom_bodyid[shape])).name) for shape in self.pairs[pair]
        )
        return moving, self._names.get(fixed, fixed)

    def is_around(self, pair: int) -> bool:
        """Return whether a pair is a part of the arm and something that stands around."""
        body = int(self._model.geom_bodyid[self.pairs[pair, 0]])
        return str(self._model.body(body).name) in self._names

    def asked(self, clearance: float, self_clearance: float) -> FloatArray:
        """Return what each pair has to keep (p,) [m]: ``clearance`` to what stands around, else the other."""
        around = [self.is_around(pair) for pair in range(len(self.pairs))]
        return np.where(around, clearance, self_clearance)

    def place(self, q: npt.ArrayLike) -> None:
        """Bring the joints to ``q`` (n,) [rad]: what is asked next is asked there.

        Raises:
            InputError: wrong shape, NaN or infinity.
        """
        self._data.qpos[:] = finite_array("q", q, (self.arm.dof,))
        mujoco.mj_kinematics(self._model, self._data)

    def lower_gaps(self, chosen: IntArray) -> FloatArray:
        """Return lower bounds of the distances (m,) [m] of chosen pairs (m,) from what is known."""
        gaps, shapes, data = np.empty(len(chosen)), self._shapes, self._data
        lower_gaps(
            self.pairs,
            chosen,
            shapes.kinds,
            shapes.sizes,
            shapes.radii,
            shapes.corners,
            shapes.firsts,
            data.geom_xpos,
            data.geom_xmat,
            self._normals,
            gaps,
        )
        return gaps

    def measure(self, pair: int) -> float:
        """Return the distance of a pair as MuJoCo's search finds it [m], negative: depth.

        The direction that it finds is kept for `lower_gaps`.
        """
        first, second = self.pairs[pair].tolist()
        gap = float(mujoco.mj_geomDistance(self._model, self._data, first, second, _FAR, self._fromto))
        way = self._fromto[3:] - self._fromto[:3]
        length = float(np.linalg.norm(way))
        if length > _ON_TOP:
            self._normals[pair] = np.copysign(1.0, gap) * way / length
        return gap

    def moves(self, turns: FloatArray) -> FloatArray:
        """Return how far the shapes of every pair can come closer [m] (p,) while joints turn by ``turns``.

        Args:
            turns: (n,) at most, from here [rad].
        """
        data, shapes = self._data, self._shapes
        farthest_moves(
            data.xanchor,
            data.xaxis,
            data.geom_xpos,
            shapes.radii,
            shapes.carried,
            shapes.spins,
            turns,
            self._moves,
        )
        moves: FloatArray = self._moves[self.pairs[:, 1], self._first_between]
        return moves

    def near(self, within: float) -> list[Nearness]:
        """Return the pairs that are closer than ``within`` [m], and how the joints change that."""
        chosen = np.arange(len(self.pairs))
        chosen = chosen[self.lower_gaps(chosen) < within]
        found = []
        for pair in chosen.tolist():
            gap = self.measure(pair)
            if gap < within:
                slope, place = self._slope(pair), self._fromto[:3].copy()
                found.append(Nearness(pair, gap, slope, place, self._normals[pair].copy()))
        return found

    def _slope(self, pair: int) -> FloatArray:
        """Return ∂gap/∂q: how the witnesses' distance changes, n·(ẋ₂ − ẋ₁)."""
        slope = np.zeros(self.arm.dof)
        for sign, shape, place in zip(
            (-1.0, 1.0), self.pairs[pair], (self._fromto[:3], self._fromto[3:]), strict=True
        ):
            joints = int(self._shapes.carried[shape])
            (a, b, c), (x, y, z) = self._data.xaxis[:joints].T, (place - self._data.xanchor[:joints]).T
            u, v, w = sign * self._normals[pair]
            slope[:joints] += u * (b * z - c * y) + v * (c * x - a * z) + w * (a * y - b * x)
        return slope


class _Shapes:
    """What kernels need to know of a model's shapes."""

    def __init__(self, model: Any, data: Any) -> None:
        self.kinds = model.geom_type.astype(np.int64)
        self.sizes = np.array(model.geom_size)
        self.radii = np.array(model.geom_rbound)
        corners, firsts = [np.zeros((0, 3))], [0]
        for mesh in model.geom_dataid.tolist():
            corners.append(_hull_corners(model, mesh) if mesh >= 0 else np.zeros((0, 3)))
            firsts.append(firsts[-1] + len(corners[-1]))
        self.corners = np.concatenate(corners)
        self.firsts = np.array(firsts)
        joints = np.zeros(model.nbody, dtype=np.int64)
        for body in range(1, model.nbody):
            joints[body] = joints[model.body_parentid[body]] + model.body_jntnum[body]
        self.carried = joints[model.geom_bodyid]
        mujoco.mj_kinematics(model, data)
        self.spins = self._turned_about_own_axis(data, self.carried - 1)
        """(g,) 1 where the last joint that carries a shape turns it about its own axis"""
        self.spun_by_next = self._turned_about_own_axis(data, self.carried)
        """(g,) 1 where the first joint that does not carry it would"""

    def _turned_about_own_axis(self, data: Any, joints: IntArray) -> IntArray:
        known = (joints >= 0) & (joints < len(data.xaxis))
        index = np.where(known, joints, 0)
        apart = data.geom_xpos - data.xanchor[index]
        off = np.linalg.norm(np.cross(apart, data.xaxis[index]), axis=1)
        skew = np.linalg.norm(np.cross(data.geom_xmat.reshape(-1, 3, 3)[:, :, 2], data.xaxis[index]), axis=1)
        along = np.isin(self.kinds, (CAPSULE, CYLINDER)) & (skew < _SAME_AXIS)
        turned: IntArray = known & (off < _SAME_AXIS) & (along | (self.kinds == SPHERE))
        return turned.astype(np.int64)


def _hull_corners(model: Any, mesh: int) -> FloatArray:
    """Return the corners of a mesh's hull: MuJoCo's graph of it lists them, where there is one."""
    first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    corners = np.array(model.mesh_vert[first : first + count], dtype=np.float64)
    start = int(model.mesh_graphadr[mesh])
    if start < 0:
        return corners
    on_hull = int(model.mesh_graph[start])
    chosen: FloatArray = corners[model.mesh_graph[start + 2 + on_hull : start + 2 + 2 * on_hull]]
    return chosen


def _pairs(model: Any, carried: IntArray, around: set[str]) -> IntArray:
    """Return the pairs of shapes that may meet: MuJoCo's own rules, without what cannot move."""
    left_out = {(int(code) >> 16, int(code) & 0xFFFF) for code in model.exclude_signature}
    weld, parent = model.body_weldid, model.body_parentid
    found = []
    for i in range(model.ngeom):
        for j in range(i):
            first, second = sorted((i, j), key=lambda shape: (int(carried[shape]), shape))
            a, b = int(model.geom_bodyid[first]), int(model.geom_bodyid[second])
            types = (model.geom_contype[[i, j]] & model.geom_conaffinity[[j, i]]).any()
            neighbours = weld[a] != 0 and weld[parent[weld[b]]] == weld[a]
            if carried[second] == 0 or weld[a] == weld[b] or neighbours or not types:
                continue
            if (a, b) in left_out or (b, a) in left_out:
                continue
            if str(model.body(a).name) not in around and carried[first] == carried[second]:
                continue
            found.append((first, second))
    return np.array(found, dtype=np.int64).reshape(-1, 2)
