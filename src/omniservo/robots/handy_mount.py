"""A camera mount to begin with, of an arm that nobody has told anything about."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.geometry.arrays import FloatArray
from omniservo.robots.arm import Arm

_AHEAD = 0.0905
"""[m] between flange and camera: what its housing takes"""
_ALIGNED = 1e-6
"""sine of an angle that a file's rounding leaves"""


def handy_mount(arm: Arm) -> RigidTransform:
    """Return flange_T_camera of a camera before the flange that looks along the hand.

    The hand's way is that of the last joint's axis, away from the joint before. Flange frames have no common
    custom: mostly z points there, but also −z (Kinova's Jaco) or x (Unitree's Z1).
    """
    hand = _hand(arm)
    return RigidTransform.from_components(_AHEAD * hand, _turn_from_z(hand))


def _hand(arm: Arm) -> FloatArray:
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
