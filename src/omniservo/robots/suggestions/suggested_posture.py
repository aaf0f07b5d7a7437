"""A suggested start configuration, for an arm of which only its file is known."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import product

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray
from omniservo.robots.arm import Arm
from omniservo.robots.collision.arm_bodies import MOUNTED, ArmBodies
from omniservo.robots.collision.arm_clearance import SELF_CLEARANCE
from omniservo.robots.collision.camera_housing import CAMERA_HOUSING
from omniservo.robots.collision.mounted_camera import MountedCamera
from omniservo.robots.collision.own_sight import own_sight_in
from omniservo.robots.collision.solid import Solid
from omniservo.robots.suggestions.first_target import FIRST_GOALS, FIRST_TARGET
from omniservo.robots.suggestions.suggested_mount import suggested_mount
from omniservo.robots.suggestions.suggested_table import suggested_table

_TILTS = tuple(math.radians(tilt) for tilt in (0.0, 20.0, 40.0, 60.0))
"""of the view from straight down, outwards and inwards: tried in this order"""
_ASIDE = (0.35, 0.45, 0.55, 0.65)
"""of the camera from the first axis, over the reach"""
_ABOVE = (0.31, 0.36, 0.42, 0.5, 0.6, 0.7)
"""[m] of the camera above the floor: a target of 0.27 m, and a table"""
_YAWS = np.radians(np.arange(0.0, 360.0, 45.0))
"""of the camera about its view"""
_TRIED = 40
"""of the best configurations at each tilt"""
_ROOM, _ROOM_THERE = math.radians(15.0), math.radians(5.0)
"""of every joint to the ends of its range, at first, and where the camera goes"""
_REGULAR = 0.1
"""smallest singular value there, as tracking tubes ask for"""
_APART, _APART_THERE = 0.03, 0.02
"""[m] between camera or floor and all else but the wrist, at first, and where the camera goes"""
_OFF_SIGHT = 0.01
"""[m] between links and lines of sight"""
_FARTHEST = 1.2
"""[rad] that a joint may turn to where the camera goes: no other branch"""
_POSTURES = 4000
"""drawn where none of all these will do"""


def suggested_posture(arm: Arm) -> FloatArray:
    """Return joints (n,) [rad], whole degrees, with which the first task of the documentation can be done.

    The arm stands on the floor; a camera with `suggested_mount` looks down at the target before it, if it
    can: nothing hides that or is near, and the camera can go to all sides of it without coming near to
    anything, the ends of ranges or singular configurations. Of those the elbow is high, the arm near one
    upright plane, and all of these far. Where there is none, the configuration of many that is farthest from
    singular ones.
    """
    first = _FirstTask(arm)
    for with_table, tilt in product((True, False), _TILTS):
        for q in first.ranked(tilt):
            if first.can_be_done(q, with_table):
                return q
    return first.regular()


class _FirstTask:
    """An arm on a floor, with a camera."""

    def __init__(self, arm: Arm) -> None:
        self._arm, self._mount = arm, suggested_mount(arm)
        self._to_flange, self._camera = self._mount.inv(), tuple(s.moved(self._mount) for s in CAMERA_HOUSING)
        self._seeing = MountedCamera(self._mount, CAMERA_HOUSING)
        self._floor = Solid.half_space("floor", [0.0, 0.0, 1.0], 0.0)
        self._bodies = ArmBodies(arm, mounted=self._camera, surroundings=(self._floor,))
        self._ranked: dict[float, list[FloatArray]] = {}

    def ranked(self, tilt: float) -> list[FloatArray]:
        """Return the configurations that hold the camera at that tilt, the best first."""
        if tilt not in self._ranked:
            found = {
                tuple(q): self._value(q) for pose in _views(self._arm, tilt) for q in self._reaching(pose)
            }
            best = sorted((q for q in found if found[q] > 0.0), key=lambda q: -found[q])
            self._ranked[tilt] = [np.array(q) for q in best[:_TRIED]]
        return self._ranked[tilt]

    def _reaching(self, base_T_camera: RigidTransform) -> Iterator[FloatArray]:
        """Yield joints near that pose, of whole degrees, turned about the first axis if that is upright."""
        arm = self._arm
        low, high = arm.joint_range.T
        try:
            postures = arm.branches(base_T_camera * self._to_flange)
        except InputError:
            return
        near = postures - 2.0 * np.pi * np.round(postures / (2.0 * np.pi))
        postures = np.where((near >= low) & (near <= high), near, postures)
        if abs(arm.chain.axes[0, 2]) > 1.0 - 1e-6:
            postures[:, 0] = np.clip(0.0, low[0] + _ROOM, high[0] - _ROOM)
        for q in np.radians(np.rint(np.degrees(postures))):
            if arm.limit_margins(q).min() >= _ROOM:
                yield q

    def _value(self, q: FloatArray) -> float:
        """Return how good a configuration looks; 0: no good."""
        arm = self._arm
        regular = float(np.linalg.svd(arm.scaled_flange_jacobian(q), compute_uv=False)[-1])
        if regular < _REGULAR:
            return 0.0
        self._bodies.place(q)
        joints = self._bodies.scene.anchors
        x, y, _ = arm.locate(q)[0][:, 3] - joints[0]
        off_plane = np.ptp(
            (joints[:, 1] - joints[0, 1]) * x - (joints[:, 0] - joints[0, 0]) * y
        ) / math.hypot(x, y)
        high = float(joints[1:, 2].mean()) - float(off_plane)
        room = min(float(arm.limit_margins(q).min()), math.radians(45.0))
        return 1.0 + 2.0 * high / arm.reach + min(regular, 0.5) + 0.5 * room

    def can_be_done(self, q: FloatArray, with_table: bool) -> bool:
        """Return whether the camera sees its target there, and on its way to all sides of it."""
        base_T_camera = self._arm.base_T_flange(q) * self._mount
        if not self._is_free(q, self._bodies, _APART):
            return False
        table = suggested_table(self._arm, self._mount, q)
        if with_table and table is None:
            return False
        around = (self._floor,) if table is None else (self._floor, table)
        bodies = ArmBodies(self._arm, mounted=self._camera, surroundings=around)
        target = base_T_camera.apply(FIRST_TARGET)
        if not self._sees(q, target, around):
            return False
        for goal in FIRST_GOALS:
            try:
                there = self._arm.inverse_near(base_T_camera * goal * self._to_flange, q)
            except InputError:
                return False
            if np.abs(there - q).max() > _FARTHEST or self._arm.limit_margins(there).min() < _ROOM_THERE:
                return False
            if np.linalg.svd(self._arm.scaled_flange_jacobian(there), compute_uv=False)[-1] < _REGULAR:
                return False
            if not (self._is_free(there, bodies, _APART_THERE) and self._sees(there, target, around)):
                return False
        return True

    def _is_free(self, q: FloatArray, bodies: ArmBodies, apart: float) -> bool:
        bodies.place(q)
        before = bodies.shapes.carried == self._arm.dof - 1
        for near in bodies.near(apart):
            is_cameras = bodies.names(near.pair)[0] == MOUNTED and not before[bodies.pairs[near.pair, 0]]
            if near.gap < SELF_CLEARANCE or is_cameras or bodies.is_around(near.pair):
                return False
        return True

    def _sees(self, q: FloatArray, target: FloatArray, around: tuple[Solid, ...]) -> bool:
        camera, kept = self._seeing, dict.fromkeys(self._bodies.links, _OFF_SIGHT)
        return own_sight_in(self._arm, q, camera, target, surroundings=around, kept=kept).status == "free"

    def regular(self) -> FloatArray:
        """Return the configuration of many, free if one is, that is farthest from singular ones.

        Free of the floor, too, unless the arm hangs or stands where the file has none.
        """
        arm = self._arm
        middle, half = arm.joint_range.mean(axis=1), 0.4 * np.ptp(arm.joint_range, axis=1)
        drawn = middle + half * np.random.default_rng(0).uniform(-1.0, 1.0, (_POSTURES, arm.dof))
        values = [np.linalg.svd(arm.scaled_flange_jacobian(q), compute_uv=False)[-1] for q in drawn]
        order = np.argsort(values)[::-1]
        alone = ArmBodies(arm, mounted=self._camera)
        free = (
            i
            for bodies in (self._bodies, alone)
            for i in order
            if self._is_free(drawn[i], bodies, SELF_CLEARANCE)
        )
        return np.asarray(drawn[next(free, order[0])])


def _views(arm: Arm, tilt: float) -> Iterator[RigidTransform]:
    """Yield poses of a camera that looks down, or tilted outwards or inwards, in the base frame."""
    x, y, _ = arm.chain.anchors[0]
    for aside, above, yaw in product(_ASIDE, _ABOVE, _YAWS):
        for way in (-tilt, tilt) if tilt else (0.0,):
            turned = Rotation.from_euler("yxz", [way, np.pi, yaw])
            yield RigidTransform.from_components([x + aside * arm.reach, y, above], turned)
