"""What compiled code needs to know of a MuJoCo model's shapes, and which of them may meet."""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np

from omniservo.errors import InputError, spelled
from omniservo.geometry.arrays import BoolArray, FloatArray, IntArray
from omniservo.geometry.kernel import kernel, leaf
from omniservo.geometry.rotation_row import XZ, YZ, ZZ
from omniservo.robots.collision.exact_vertices import corners_of
from omniservo.robots.collision.gap_kernels import CAPSULE, CYLINDER, HALF_SPACE, HULL, KINDS, SPHERE
from omniservo.robots.collision.shapes import Shapes

_SAME_AXIS = 1e-9
"""[m] between the axes of a shape and of a joint that count as one, from end to end"""

_SAME_NORMAL = 1e-12
"""[rad] the same between a half-space's normal and the axis of a joint"""


def read_shapes(model: Any, data: Any, around: BoolArray) -> Shapes:
    """Return the shapes of a model of a serial arm, and the pairs that may meet, see `ArmBodies`.

    Args:
        model: MuJoCo's, of shapes that can be touched; it is made to place every shape where it is stated.
        data: MuJoCo's, of that model; it is left at q = 0.
        around: (g,) which shapes stand around.

    Raises:
        InputError: a shape of a kind that is not known.
    """
    model.geom_sameframe[:] = mujoco.mjtSameFrame.mjSAMEFRAME_NONE  # else frames 10⁻⁶ apart are one to it
    data.qpos[:] = 0.0
    mujoco.mj_kinematics(model, data)
    kinds = model.geom_type.astype(np.int64)
    _check_kinds(model, kinds)
    meshes = np.where(kinds == HULL, model.geom_dataid, -1).tolist()
    corners = [np.zeros((0, 3)) if mesh < 0 else corners_of(model, mesh) for mesh in meshes]
    joints = np.zeros(model.nbody, dtype=np.int64)
    for body, parent, own in zip(
        range(1, model.nbody), model.body_parentid[1:].tolist(), model.body_jntnum[1:].tolist(), strict=True
    ):
        joints[body] = joints[parent] + own
    carried = joints[model.geom_bodyid]
    pairs = _pairs(model, carried, around)
    shapes = Shapes(
        kinds=kinds,
        sizes=np.array(model.geom_size),
        radii=_radii(model, kinds, corners),
        corners=np.concatenate([np.zeros((0, 3)), *corners]),
        firsts=np.cumsum([0, *map(len, corners)]),
        carried=carried,
        spins=np.zeros_like(carried),
        places=data.geom_xpos.copy(),
        axes=data.geom_xmat.copy(),
        pairs=pairs,
        first_between=carried[pairs[:, 1]],
    )
    hinges = data.xanchor.copy(), data.xaxis.copy()
    return shapes._replace(
        spins=_turned_about_own_axis(shapes, hinges, carried - 1),
        first_between=first_joints_between(shapes, hinges),
    )


def first_joints_between(shapes: Shapes, hinges: tuple[FloatArray, FloatArray]) -> IntArray:
    """Return the first joint (p,) whose turn can bring the two shapes of each pair nearer.

    A shape that the first joint between turns about its own axis sees the other one turned, no nearer.

    Args:
        shapes: at q = 0.
        hinges: points on the joints' axes (n, 3) [m], and the axes (n, 3), at q = 0.
    """
    fixed, moving = shapes.carried[shapes.pairs].T
    spun_by_next = _turned_about_own_axis(shapes, hinges, shapes.carried)
    first: IntArray = np.minimum(fixed + spun_by_next[shapes.pairs[:, 0]], moving)
    return first


def _turned_about_own_axis(
    shapes: Shapes, hinges: tuple[FloatArray, FloatArray], joints: IntArray
) -> IntArray:
    """Return 1 for each shape (g,) that its joint (g,), if there is one, turns about the shape's own axis."""
    turned: IntArray = _turned_in_place(
        shapes.kinds, shapes.sizes, shapes.places, shapes.axes, *hinges, joints
    )
    return turned


@kernel
def _turned_in_place(
    kinds: IntArray,
    sizes: FloatArray,
    places: FloatArray,
    axes: FloatArray,
    anchors: FloatArray,
    directions: FloatArray,
    joints: IntArray,
) -> IntArray:
    """See `_turned_about_own_axis`; ``anchors`` and ``directions`` (n, 3) are the hinges."""
    turned = np.zeros(kinds.shape[0], dtype=np.int64)
    for g in range(kinds.shape[0]):
        j = joints[g]
        if not 0 <= j < anchors.shape[0] or kinds[g] not in (HALF_SPACE, SPHERE, CAPSULE, CYLINDER):
            continue
        a, b, c = directions[j, 0], directions[j, 1], directions[j, 2]
        x, y, z = axes[g, XZ], axes[g, YZ], axes[g, ZZ]
        tilt = math.sqrt(_square_across(x, y, z, a, b, c))
        if kinds[g] == HALF_SPACE:
            turned[g] = tilt < _SAME_NORMAL
            continue
        if kinds[g] != SPHERE and not tilt * max(sizes[g, 0], sizes[g, 1]) < _SAME_AXIS:
            continue
        x, y, z = places[g, 0] - anchors[j, 0], places[g, 1] - anchors[j, 1], places[g, 2] - anchors[j, 2]
        if _square_across(x, y, z, a, b, c) < _SAME_AXIS**2:
            turned[g] = 1
    return turned


@leaf
def _square_across(x: float, y: float, z: float, a: float, b: float, c: float) -> float:
    """Return ‖v × a‖² of v = (x, y, z) and (a, b, c)."""
    return float((y * c - z * b) ** 2 + (z * a - x * c) ** 2 + (x * b - y * a) ** 2)


def _check_kinds(model: Any, kinds: IntArray) -> None:
    """Refuse shapes (g,) of a kind whose distance is not known here.

    Raises:
        InputError: it names the link, the kind and those that are legal.
    """
    for shape in np.flatnonzero(~np.isin(kinds, list(KINDS))).tolist():
        kind = str(mujoco.mjtGeom(kinds[shape]).name).removeprefix("mjGEOM_").lower()
        link = spelled(str(model.body(int(model.geom_bodyid[shape])).name))
        raise InputError(f"link {link}: a shape of kind {kind} given; legal: {', '.join(KINDS.values())}")


def _radii(model: Any, kinds: IntArray, corners: list[FloatArray]) -> FloatArray:
    """Return the radii (g,) of balls about the shapes' origins that hold them [m]."""
    radii: FloatArray = np.where(kinds == HALF_SPACE, math.inf, model.geom_rbound)
    for shape in np.flatnonzero(kinds == HULL).tolist():
        radii[shape] = np.linalg.norm(corners[shape], axis=1).max(initial=0.0)
    return radii


def _pairs(model: Any, carried: IntArray, around: BoolArray) -> IntArray:
    """Return the pairs of shapes that may meet: MuJoCo's own rules, without what cannot move.

    Pairs that the model states are checked whatever else it says of them, as MuJoCo does.
    """
    i, j = np.nonzero(np.tril((carried > 0)[:, None] | (carried > 0), -1))
    first = np.where(carried[j] <= carried[i], j, i)
    second = i + j - first
    bodies, weld = model.geom_bodyid.astype(np.int64), model.body_weldid
    a, b = bodies[first], bodies[second]
    touch = (model.geom_contype[first] & model.geom_conaffinity[second]) | (
        model.geom_contype[second] & model.geom_conaffinity[first]
    )
    neighbours = (weld[a] != 0) & (weld[model.body_parentid[weld[b]]] == weld[a])
    left_out = np.isin((a << 16) + b, model.exclude_signature) | np.isin(
        (b << 16) + a, model.exclude_signature
    )
    apart = around[first] | (carried[first] != carried[second])
    stated = np.isin(
        np.minimum(i, j) * len(carried) + np.maximum(i, j),
        np.minimum(model.pair_geom1, model.pair_geom2) * len(carried)
        + np.maximum(model.pair_geom1, model.pair_geom2),
    )
    may_meet = (weld[a] != weld[b]) & (touch != 0) & ~neighbours & ~left_out
    kept = (carried[second] > 0) & apart & (may_meet | stated)
    pairs: IntArray = np.stack([first, second], axis=1)[kept]
    return pairs
