"""A suggested table under what the camera of an arm sees."""

from __future__ import annotations

import math

from scipy.spatial.transform import RigidTransform

from omniservo.geometry.arrays import FloatArray
from omniservo.robots.arm import Arm
from omniservo.robots.collision.arm_bodies import ArmBodies
from omniservo.robots.collision.camera_housing import CAMERA_HOUSING
from omniservo.robots.collision.solid import Solid

_AHEAD = 0.285
"""[m] from the camera to what lies farthest of the target of the documentation's first task"""
_ASIDE = 0.09
"""[m] that the target reaches aside of what the camera looks at"""
_HALF_WIDTHS = (0.15, 0.12, 0.09)
"""[m] tried in this order"""
_FOOT = 0.08
"""[m] from the table to the first axis"""
_LOWEST = 0.02
"""[m] least height of the table"""
_DOWN = 0.5
"""least cosine between view and straight down: what looks along a table does not see the target on it"""
_FREE = 0.03
"""[m] between the table and the arm, so that it can move"""


def suggested_table(arm: Arm, flange_T_camera: RigidTransform, q: FloatArray) -> Solid | None:
    """Return a block on the floor, its top under the target before the camera; None: there is no room for it.

    Args:
        arm: stands on a floor at z = 0 of its base frame.
        flange_T_camera: where its camera sits.
        q: (n,) its joints [rad].

    Returns:
        A box in the base frame, along its axes.
    """
    base_T_camera = arm.base_T_flange(q) * flange_T_camera
    x, y, height = base_T_camera.apply([0.0, 0.0, _AHEAD])
    foot_x, foot_y, _ = arm.chain.anchors[0]
    down = -float(base_T_camera.rotation.apply([0.0, 0.0, 1.0])[2])
    top = height - _ASIDE * math.sqrt(max(0.0, 1.0 - down * down))
    if down < _DOWN or top < _LOWEST:
        return None
    camera = tuple(solid.moved(flange_T_camera) for solid in CAMERA_HOUSING)
    for half in _HALF_WIDTHS:
        middle = RigidTransform.from_translation([x, y, 0.5 * top])
        table = Solid.box("table", middle, [half, half, 0.5 * top])
        bodies = ArmBodies(arm, mounted=camera, surroundings=(table,))
        bodies.place(q)
        is_free = not any(table.name in bodies.names(near.pair) for near in bodies.near(_FREE))
        if max(abs(x - foot_x), abs(y - foot_y)) - half >= _FOOT and is_free:
            return table
    return None
