"""A posture to begin with, of an arm that nobody has told anything about."""

from __future__ import annotations

import math

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.robots.arm import Arm
from omniservo.robots.arm_bodies import MOUNTED, ArmBodies
from omniservo.robots.arm_clearance import SELF_CLEARANCE
from omniservo.robots.camera_housing import CAMERA_HOUSING
from omniservo.robots.handy_mount import handy_mount
from omniservo.robots.solid import Solid

_POSTURES = 4000
_WIDEST = math.radians(100.0)
"""no joint is bent further from the middle of its range"""
_LEVELS = ((0.9, True), (0.6, True), (-1.0, True), (-1.0, False))
"""least cosine between hand and straight down, and whether the arm stands on a floor: tried in this order"""
_APART = 0.03
"""[m] between the camera and all else, so that it can be moved"""
_ABOVE = 0.02
"""[m] between the floor and what moves"""
_HIGH, _ASIDE = 0.4, 0.3
"""least height and distance of the flange from the first axis' foot, over the reach"""
_ROOM = 0.42
"""[m] along the hand, from the flange to the floor: a camera of 0.1 m, and its target"""


def handy_posture(arm: Arm) -> FloatArray:
    """Return joints (n,) [rad]: flange aside of the foot and high above it, the hand down if it can be.

    A camera with `handy_mount` has room about it there, and its target before it.

    Of 4000 random postures whose links keep `SELF_CLEARANCE` from each other, the one farthest from singular
    ones.
    """
    middle = arm.joint_range.mean(axis=1)
    half = np.minimum(0.4 * np.ptp(arm.joint_range, axis=1), _WIDEST)
    drawn = middle + half * np.random.default_rng(0).uniform(-1.0, 1.0, (_POSTURES, arm.dof))
    drawn[:, 0] = np.clip(0.0, *arm.joint_range[0])
    flanges, reach, mount = [arm.locate(q)[0] for q in drawn], arm.reach, handy_mount(arm)
    hand = mount.rotation.apply([0.0, 0.0, 1.0])
    camera = tuple(solid.moved(mount) for solid in CAMERA_HOUSING)
    values = [np.linalg.svd(arm.scaled_flange_jacobian(q), compute_uv=False)[-1] for q in drawn]
    order = np.argsort(values)[::-1]
    floor = Solid.half_space("floor", [0.0, 0.0, 1.0], _ABOVE)
    for level, stands in _LEVELS:
        bodies = ArmBodies(arm, mounted=camera, surroundings=(floor,) if stands else ())
        for i in order:
            x, y, height = flanges[i][:, 3]
            aside, down = math.hypot(x, y), -float(flanges[i][2, :3] @ hand)
            high = max(_HIGH * reach, _ROOM * down)
            if stands and (height < high or aside < _ASIDE * reach or down < level):
                continue
            bodies.place(drawn[i])
            if _is_free(bodies):
                return np.asarray(drawn[i])
    return np.asarray(drawn[order[0]])


def _is_free(bodies: ArmBodies) -> bool:
    """Tell whether the links keep off each other, and the camera farther off all but the wrist it sits on."""
    wrist = bodies.arm.dof - 1
    return not any(
        one.gap < SELF_CLEARANCE
        or (MOUNTED in bodies.names(one.pair) and bodies.shapes.carried[bodies.pairs[one.pair, 0]] != wrist)
        for one in bodies.near(_APART)
    )
