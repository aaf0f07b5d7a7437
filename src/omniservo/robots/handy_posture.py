"""A posture to begin with, of an arm that nobody has told anything about."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.geometry.arrays import FloatArray
from omniservo.robots.arm import Arm
from omniservo.robots.arm_bodies import ArmBodies
from omniservo.robots.arm_clearance import SELF_CLEARANCE
from omniservo.robots.solid import Solid

_POSTURES = 4000
_WIDEST = math.radians(100.0)
"""no joint is bent further from the middle of its range"""
_LEVELS = ((0.9, True), (0.6, True), (-1.0, True), (-1.0, False))
"""least cosine between hand and straight down, and whether the arm stands on a floor: tried in this order"""
_ABOVE = 0.02
"""[m] between the floor and what moves"""
_HIGH, _ASIDE = 0.4, 0.3
"""least height and distance of the flange from the first axis' foot, over the reach"""


def handy_posture(arm: Arm) -> FloatArray:
    """Return joints (n,) [rad]: flange aside of the foot and high above it, the hand down if it can be.

    The hand's way is that of the last joint's axis, away from the arm.

    Of 4000 random postures whose links keep `SELF_CLEARANCE` from each other, the one farthest from singular
    ones.
    """
    middle = arm.joint_range.mean(axis=1)
    half = np.minimum(0.4 * np.ptp(arm.joint_range, axis=1), _WIDEST)
    drawn = middle + half * np.random.default_rng(0).uniform(-1.0, 1.0, (_POSTURES, arm.dof))
    drawn[:, 0] = np.clip(0.0, *arm.joint_range[0])
    flanges, hand, reach = [arm.locate(q)[0] for q in drawn], _hand(arm), arm.reach
    values = [np.linalg.svd(arm.scaled_flange_jacobian(q), compute_uv=False)[-1] for q in drawn]
    order = np.argsort(values)[::-1]
    floor = Solid.box("floor", RigidTransform.identity(), [2.0 * reach + 1.0, 2.0 * reach + 1.0, _ABOVE])
    for level, stands in _LEVELS:
        bodies = ArmBodies(arm, surroundings=(floor,) if stands else ())
        for i in order:
            x, y, height = flanges[i][:, 3]
            aside, down = math.hypot(x, y), -float(flanges[i][2, :3] @ hand)
            if stands and (height < _HIGH * reach or aside < _ASIDE * reach or down < level):
                continue
            bodies.place(drawn[i])
            if not bodies.near(SELF_CLEARANCE):
                return np.asarray(drawn[i])
    return np.asarray(drawn[order[0]])


def _hand(arm: Arm) -> FloatArray:
    """Return the last joint's axis (3,) in the flange frame, away from the joint before."""
    axes, anchors, flange, _ = arm.chain
    outwards = float(axes[-1] @ (flange[:, 3] - anchors[-2])) >= 0.0
    along: FloatArray = flange[:, :3].T @ axes[-1]
    return along if outwards else -along
