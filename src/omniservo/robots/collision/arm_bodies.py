"""The whole arm as bodies among others: which pairs may meet, and how near they are."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby, product
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt

from omniservo.errors import InputError, spelled
from omniservo.geometry.arrays import BoolArray, FloatArray, IntArray, finite_array, finite_number
from omniservo.robots.arm import Arm
from omniservo.robots.collision.gap_kernels import farthest_moves, lower_gaps, slab, write_gap_slope
from omniservo.robots.collision.gap_search import widen
from omniservo.robots.collision.mounted_pairs import mounted_pairs
from omniservo.robots.collision.read_shapes import first_joints_between, read_shapes
from omniservo.robots.collision.shapes import Bodies, PlacedShapes, Shapes
from omniservo.robots.collision.solid import Solid
from omniservo.robots.path_following.tracking_tube import Tube

MOUNTED = "camera"
"""What the bodies that the flange carries are called together."""

_FAR = 100.0
"""[m] farther than any two bodies whose distance is computed"""

_ON_TOP = 1e-9
"""[m] bodies that are no farther apart leave no direction between them"""

_PAIRED = "{} & {}"

_SIGNS = np.array(list(product((-1.0, 1.0), repeat=3)))


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
    """An arm, what it carries and what stands around it, in any configuration; not for two threads at once.

    Pairs are those that may meet: any part that moves with what stands around, and parts of the arm that do
    not carry each other; what the last joint carries is kept off the link before it, too, and what the first
    one carries off the base. What is left out of that stands in the arm's file, in
    `omniservo.robots.Arm.notices`, and in `notices`.
    """

    def __init__(
        self,
        arm: Arm,
        *,
        mounted: Sequence[Solid] = (),
        surroundings: Sequence[Solid] = (),
        tube: Tube | None = None,
    ) -> None:
        """Put everything together.

        Args:
            arm: with the shapes of its file that can be touched; a mesh counts as its convex hull.
            mounted: what the flange carries, in the flange frame; one body called `MOUNTED`.
            surroundings: what stands around, in the base frame. Bodies of one name are one thing: they stand
                side by side in the sequence.
            tube: how far a run deviates from its path: pairs are required to keep so much more. None: it does
                not.

        Raises:
            InputError: two things around of one name; a tube of other parts than `tube_parts`; a half-space
                that is carried; a shape of a kind that is not known.
        """
        things = [(name, list(parts)) for name, parts in groupby(surroundings, lambda solid: solid.name)]
        names = [name for name, _ in things]
        if len(set(names)) < len(names):
            raise InputError(f"surroundings: {max(names, key=names.count)!r} is given twice")
        self.arm = arm
        spec = arm.spec(seen=False)
        _mount(spec, arm, mounted)
        self._solids = tuple(surroundings)
        self._around = [f"around {i}" for i in range(len(things))]
        for name, (_, parts) in zip(self._around, things, strict=True):
            thing = spec.worldbody.add_body(name=name)
            for solid in parts:
                solid.add_to(spec, thing)
        self._model: Any = spec.compile()
        self._data: Any = mujoco.MjData(self._model)
        self._names = dict(zip(self._around, names, strict=True))
        self._is_around = np.isin(_body_names(self._model), self._around)[self._model.geom_bodyid]
        shapes = read_shapes(self._model, self._data, self._is_around)
        self._hinges = self._data.xanchor.copy(), self._data.xaxis.copy()  # it was left at q = 0
        self.shapes, self.notices = self._with_mounted(shapes)
        """What does not change of them, for compiled code; and what of that the arm carries is not judged."""
        self.pairs = self.shapes.pairs
        """(p, 2) of shapes that may meet; the second is carried by more joints"""
        shown = self._data
        self.scene = PlacedShapes(
            frames=np.zeros((arm.dof + 1, 3, 4)),
            anchors=shown.xanchor,
            directions=shown.xaxis,
            places=shown.geom_xpos,
            axes=shown.geom_xmat,
            moves=np.zeros((self._model.ngeom, arm.dof + 1)),
            normals=np.zeros((len(self.pairs), 3)),
        )
        """Where they are: MuJoCo's own arrays, so that it measures what compiled code has placed."""
        self._fromto, self._simplex = np.zeros(6), np.empty((4, 7))
        self._strays = self._stray_of_pairs(tube)

    @cached_property
    def links(self) -> tuple[str, ...]:
        """Names of the links that move and have a shape, from the base outwards; `MOUNTED` among them."""
        carried = [self._owners[i] for i in np.flatnonzero(self.shapes.carried > 0).tolist()]
        return tuple(dict.fromkeys(carried))

    @cached_property
    def tube_parts(self) -> tuple[str, ...]:
        """What deviates: the links, and of the pairs of links in `own_pairs`, as "camera & forearm"."""
        own = [self.names(i) for i in self.own_pairs.tolist()]
        return (*self.links, *(_PAIRED.format(*pair) for pair in dict.fromkeys(own)))

    @cached_property
    def own_pairs(self) -> IntArray:
        """Indices (k,) of the pairs of the arm's own parts with more than one joint between them."""
        between = np.diff(self.shapes.carried[self.pairs], axis=1)[:, 0]
        return np.flatnonzero(~self._has_surroundings & (between > 1))

    @cached_property
    def _owners(self) -> list[str]:
        """Whose every shape is."""
        names = _body_names(self._model)
        return [names[body] for body in self._model.geom_bodyid]

    def move_surroundings(self, surroundings: Sequence[Solid]) -> bool:
        """Put what stands around elsewhere, in other sizes, which takes a hundredth of building it anew.

        Args:
            surroundings: in the base frame, the same ones by name, kind and order.

        Returns:
            False: it is not the same ones, or a hull is another; nothing was changed.
        """
        known = self._solids
        if len(known) != len(surroundings) or not all(map(_can_become, known, surroundings)):
            return False
        model, shapes = self._model, self.shapes
        for shape, solid in zip(np.flatnonzero(self._is_around).tolist(), surroundings, strict=True):
            if solid.kind == "hull":
                continue
            if solid.kind != "half_space":
                model.geom_size[shape] = shapes.sizes[shape] = solid.mujoco_size
                model.geom_rbound[shape] = shapes.radii[shape] = solid.radius
                model.geom_aabb[shape] = 0.0, 0.0, 0.0, *solid.half_extents
            pose = solid.pose.as_matrix()
            model.geom_pos[shape] = shapes.places[shape] = pose[:3, 3]
            shapes.axes[shape] = pose[:3, :3].ravel()
            mujoco.mju_mat2Quat(model.geom_quat[shape], shapes.axes[shape])
            model.geom_sameframe[shape] = 0  # it stood where its body's middle was
        self.shapes = shapes._replace(first_between=first_joints_between(shapes, self._hinges))
        self._solids = tuple(surroundings)
        return True

    def _with_mounted(self, shapes: Shapes) -> tuple[Shapes, tuple[str, ...]]:
        """Return the shapes with the pairs of what the flange carries and the link before, and notices."""
        last = self.arm.dof - 1
        before = np.flatnonzero(shapes.carried == last)
        mounted = self.shapes_of(MOUNTED)
        hinge, ends = (self._hinges[0][last], self._hinges[1][last]), self.arm.joint_range[last]
        meet, overlap = mounted_pairs(shapes, before, mounted, hinge, ends)
        shapes = shapes._replace(pairs=np.concatenate([shapes.pairs, meet]))
        shapes = shapes._replace(first_between=first_joints_between(shapes, self._hinges))
        if not len(overlap):
            return shapes, ()
        link = self.owner(int(overlap[0, 0]))
        return shapes, (
            f"shapes that overlap in every posture, not kept off each other: {MOUNTED} and {link} "
            f"({len(overlap)} of {len(meet) + len(overlap)} pairs)",
        )

    def _stray_of_pairs(self, tube: Tube | None) -> FloatArray:
        """Return by how much each pair (p,) may come closer than on the path [m].

        With one joint between the two it is that joint's part alone, turned about its axis.
        """
        if tube is None:
            return np.zeros(len(self.pairs))
        if other := set(tube.links) ^ set(self.tube_parts):
            known = "missing" if min(other) in self.tube_parts else "no part of this arm"
            raise InputError(f"tube: links: {spelled(min(other))}: {known}; see `ArmBodies.tube_parts`")
        for name, most in tube.links.items():
            finite_number(f"tube: links: {name}", most, minimum=0.0)
        shapes, scene = self.shapes, self.scene
        places = scene.anchors, scene.directions, scene.places, shapes.radii
        farthest_moves(*places, shapes.carried, shapes.spins, np.asarray(tube.joints), scene.moves)
        found = scene.moves[self.pairs[:, 1], shapes.first_between]
        for pair in np.union1d(self.own_pairs, np.flatnonzero(self._has_surroundings)).tolist():
            found[pair] = tube.links[self.part_of(pair)]
        return found

    @property
    def _is_steady(self) -> BoolArray:
        """Which pairs (p,) no joint can bring nearer to each other: what turns about its own axis."""
        shapes, last = self.shapes, self.pairs[:, 1]
        steady: BoolArray = shapes.first_between >= shapes.carried[last] - shapes.spins[last]
        return steady

    def part_of(self, pair: int) -> str:
        """Return which of `tube_parts` says what a pair may lose."""
        names = self.names(pair)
        return names[0] if self.is_around(pair) else _PAIRED.format(*names)

    def shapes_of(self, link: str) -> IntArray:
        """Return the indices of a link's shapes."""
        return np.flatnonzero([name == link for name in self._owners])

    @property
    def model(self) -> Any:
        """MuJoCo's, not to be written to."""
        return self._model

    def corners(self, q: npt.ArrayLike) -> FloatArray:
        """Return the corners (g, 8, 3) of boxes that hold the shapes, in the base frame [m], at ``q`` (n,).

        Raises:
            InputError: wrong shape, NaN or infinity.
        """
        self.place(q)
        boxes, axes = self._model.geom_aabb, self._data.geom_xmat.reshape(-1, 3, 3)
        own = boxes[:, None, :3] + _SIGNS * boxes[:, None, 3:]
        found: FloatArray = self._data.geom_xpos[:, None] + own @ axes.transpose(0, 2, 1)
        return found

    def owner(self, shape: int) -> str:
        """Return whose a shape is: a link's, or something's that stands around."""
        name = self._owners[shape]
        thing: str = self._names.get(name, name)
        return thing

    def names(self, pair: int) -> tuple[str, str]:
        """Return what a pair is called: the link, and the surroundings or the other link."""
        fixed, moving = self.pairs[pair].tolist()
        return self.owner(moving), self.owner(fixed)

    def is_around(self, pair: int) -> bool:
        """Return whether a pair is a part of the arm and something that stands around."""
        return bool(self._has_surroundings[pair])

    @cached_property
    def _has_surroundings(self) -> BoolArray:
        """Which pairs (p,) are a part of the arm and something that stands around."""
        around: BoolArray = self._is_around[self.pairs[:, 0]]
        return around

    def asked(self, clearance: float, self_clearance: float) -> FloatArray:
        """Return what each pair has to keep (p,) [m]: ``clearance`` to what stands around, else the other.

        What its links may deviate comes on top, but for what no joint can bring nearer.
        """
        own = np.where(self._has_surroundings, clearance, self_clearance)
        return np.asarray(own + np.where(self._is_steady, 0.0, self._strays))

    def place(self, q: npt.ArrayLike) -> None:
        """Bring the joints to ``q`` (n,) [rad]: what is computed next is computed there.

        Raises:
            InputError: wrong shape, NaN or infinity.
        """
        self._data.qpos[:] = finite_array("q", q, (self.arm.dof,))
        mujoco.mj_kinematics(self._model, self._data)

    def lower_gaps(self, chosen: IntArray) -> FloatArray:
        """Return lower bounds of the distances (m,) [m] of chosen pairs (m,) from what is known."""
        gaps, enough = np.empty(len(chosen)), np.full(len(chosen), np.inf)
        lower_gaps(self._placed(), self.pairs, chosen, self.scene.normals, enough, gaps)
        return gaps

    def _placed(self) -> Bodies:
        """Return what gaps depend on, where it is now."""
        s, scene = self.shapes, self.scene
        return Bodies(s.kinds, s.sizes, s.radii, s.corners, s.firsts, scene.places, scene.axes)

    def show(self, places: FloatArray, axes: FloatArray) -> None:
        """Bring the shapes to places (g, 3) [m] with axes (g, 9): what is measured next is measured there."""
        self._data.geom_xpos[:], self._data.geom_xmat[:] = places, axes

    def measure(self, pair: int, fromto: FloatArray | None = None, normal: FloatArray | None = None) -> float:
        """Return the distance of a pair [m]; negative: depth, at least that much.

        It is that of two points which a search has found (`widen`). Where bodies may touch, which it cannot
        tell, MuJoCo proposes a direction, and it is the slab across that.

        Args:
            pair: which.
            fromto: (6,) out: the nearest points in the base frame [m]; None: kept for `near`.
            normal: (3,) where the search begins; out, unit: the direction between them, from the first to the
                second; None: kept for `lower_gaps`.
        """
        first, second = self.pairs[pair].tolist()
        bodies = self._placed()
        fromto = self._fromto if fromto is None else fromto
        normal = self.scene.normals[pair] if normal is None else normal
        least, most = widen(bodies, first, second, normal, fromto, self._simplex)
        if most < math.inf:
            return float(most)
        gap = mujoco.mj_geomDistance(self._model, self._data, first, second, _FAR, fromto)
        a, b, c, x, y, z = fromto.tolist()
        x, y, z = x - a, y - b, z - c
        length = math.sqrt(x * x + y * y + z * z)
        if length > _ON_TOP:
            length = math.copysign(length, gap)
            across = slab(bodies, first, second, x / length, y / length, z / length)
            if across > least:
                normal[:], least = (x / length, y / length, z / length), across
        return float(least)

    def near(self, within: float) -> list[Nearness]:
        """Return the pairs that are closer than ``within`` [m], and how the joints change that."""
        chosen = np.arange(len(self.pairs))
        chosen = chosen[self.lower_gaps(chosen) < within]
        found = []
        for pair in chosen.tolist():
            gap = self.measure(pair)
            if gap < within:
                slope, place = self._slope(pair), self._fromto[:3].copy()
                found.append(Nearness(pair, gap, slope, place, self.scene.normals[pair].copy()))
        return found

    def _slope(self, pair: int) -> FloatArray:
        """Return ∂gap/∂q (n,) of the pair that was measured last."""
        scene, slope = self.scene, np.empty(self.arm.dof)
        write_gap_slope(
            scene.anchors,
            scene.directions,
            self.shapes.carried,
            self.pairs[pair],
            self._fromto,
            scene.normals[pair],
            slope,
        )
        return slope


def _mount(spec: Any, arm: Arm, mounted: Sequence[Solid]) -> None:
    """Add what the flange carries to an arm's specification, as one body.

    Raises:
        InputError: a half-space.
    """
    if any(solid.kind == "half_space" for solid in mounted):
        raise InputError("mounted: a half-space given; legal: bodies that can be carried")
    if mounted:
        holder = spec.body(arm.flange_link).add_body(name=MOUNTED)
        for solid in mounted:
            solid.moved(arm.link_T_flange).add_to(spec, holder).mass = 1e-3


def _can_become(one: Solid, other: Solid) -> bool:
    """Return whether a body may be put where another is, with its size."""
    if one.name != other.name or one.kind != other.kind:
        return False
    if one.kind != "hull":
        return True
    return one.vertices is other.vertices and bool((one.pose.as_matrix() == other.pose.as_matrix()).all())


def _body_names(model: Any) -> list[str]:
    return [str(model.body(body).name) for body in range(model.nbody)]
