"""A suggested camera mount, for an arm of which only its file is known."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.geometry.arrays import FloatArray
from omniservo.robots.arm import Arm
from omniservo.robots.collision.arm_bodies import ArmBodies
from omniservo.robots.collision.camera_housing import CAMERA_HOUSING
from omniservo.robots.collision.solid import Solid
from omniservo.robots.suggestions.first_target import FIRST_TARGET

_AHEAD = (0.0905, 0.12, 0.15)
"""[m] between flange and camera: what its housing takes, and more, where a link reaches beyond its flange"""
_ASIDE = (0.06, 0.08, 0.1, 0.12, 0.14, 0.16)
"""[m] between the last joint's axis and a camera beside it, and"""
_ALONG = (0.09, 0.12, 0.15, 0.18, 0.06, 0.03)
"""[m] how far along that axis: the first at which the gripper is neither touched nor seen. No farther back
than needed: there is the wrist"""
_OVERLAP = 0.003
"""[m] by which a housing on the flange may overlap the hull of what has the flange"""
_UNSEEN = 0.008
"""[m] that the gripper keeps from lines of sight"""
_ALIGNED = 1e-6
"""sine of an angle that a file's rounding leaves"""


def suggested_mount(arm: Arm) -> RigidTransform:
    """Return flange_T_camera of a camera that looks ahead: before the flange, or beside a gripper.

    Ahead is the way of the last joint's axis, away from the joint before. Flange frames have no common
    custom: mostly z points there, but also −z (Kinova's Jaco) or x (Unitree's Z1). The camera sits on the
    flange unless what the last joint carries, fingers say, would be in it or between it and the target of the
    documentation's first task.
    """
    way = _way(arm)
    turn = _turn_from_z(way)
    q = arm.joint_range.mean(axis=1)
    base_T_flange = arm.base_T_flange(q)
    bodies = ArmBodies(arm, surroundings=_camera_and_lines(base_T_flange))
    for place in _places():
        mount = RigidTransform.from_components(turn.apply(place), turn)
        bodies.move_surroundings(_camera_and_lines(base_T_flange * mount))
        bodies.place(q)
        if _is_off_gripper(bodies):
            return mount
    return RigidTransform.from_components(_AHEAD[0] * way, turn)


def _places() -> Iterator[FloatArray]:
    """Yield places (3,) in a frame whose z is that way [m]: before the flange, then beside that."""
    for ahead in _AHEAD:
        yield np.array([0.0, 0.0, ahead])
    for aside in _ASIDE:
        for along in _ALONG:
            for x, y in ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)):
                yield np.array([aside * x, aside * y, along])


def _camera_and_lines(base_T_camera: RigidTransform) -> tuple[Solid, ...]:
    """Return a camera's housing and its lines of sight to the first target, as bodies of two things."""
    housing = [
        Solid("camera", solid.kind, solid.size, base_T_camera * solid.pose) for solid in CAMERA_HOUSING
    ]
    lines = [_line(base_T_camera, point) for point in FIRST_TARGET]
    return (*housing, *lines)


def _line(base_T_camera: RigidTransform, point: FloatArray) -> Solid:
    length = float(np.linalg.norm(point))
    middle = RigidTransform.from_components(0.5 * point, _turn_from_z(point / length))
    return Solid("lines of sight", "capsule", np.array([_UNSEEN, 0.5 * length]), base_T_camera * middle)


def _is_off_gripper(bodies: ArmBodies) -> bool:
    """Return whether what the last joint carries is off the camera, but for `_OVERLAP`, and off the lines."""
    for near in bodies.near(0.0):
        first, second = bodies.pairs[near.pair]
        if not bodies.is_around(near.pair) or bodies.shapes.carried[second] < bodies.arm.dof:
            continue
        allowed = _OVERLAP if bodies.owner(first) == "camera" else 0.0
        if near.gap < -allowed:
            return False
    return True


def _way(arm: Arm) -> FloatArray:
    """Return the unit vector (3,) in the flange frame."""
    axes, anchors, flange, _ = arm.chain
    outwards = float(axes[-1] @ (flange[:, 3] - anchors[-2])) >= 0.0
    along: FloatArray = flange[:, :3].T @ axes[-1]
    return along if outwards else -along


def _turn_from_z(way: FloatArray) -> Rotation:
    """Return the smallest turn that takes z there; about x where it is half of one."""
    x, y, z = way
    aside = np.array([-y, x, 0.0])  # z × way
    sine = np.linalg.norm(aside)
    if sine < _ALIGNED:
        return Rotation.from_rotvec([0.0 if z > 0.0 else np.pi, 0.0, 0.0])
    return Rotation.from_rotvec(np.arctan2(sine, z) / sine * aside)
