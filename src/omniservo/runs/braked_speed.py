"""How fast a path may be gone so that no joint comes too fast towards the end of its range."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.robots import Arm, JointPath
from omniservo.safety import SafetyOptions

_LEAST_ROOM = math.radians(0.5)
"""What a joint counts as having that is nearer to an end than plans keep [rad]: it has to go on from there,
be it slowly."""


def braked_speed(
    arm: Arm, joints: JointPath, options: SafetyOptions, share: float
) -> Callable[[FloatArray], FloatArray]:
    """Return the greatest ẇ (m,) [1/s] at w (m,) that a share of the way to each end is enough to brake from.

    The supervisor stops an arm of which a joint that turns outwards needs more than its way d to the end of
    its range, less ``joint_reserve``: q̇ T + q̇²/(2a) ≤ share · d, T its reaction, a the joint's acceleration.

    Args:
        arm: states ranges and accelerations.
        joints: along the path.
        options: of the supervisor.
        share: in (0, 1].
    """
    low, high = arm.joint_range.T + options.joint_reserve * np.array([[1.0], [-1.0]])
    reaction, most = options.reaction, arm.joint_acceleration

    def path_speed(w: FloatArray) -> FloatArray:
        q, rate = joints(w), joints(w, 1)
        room = share * np.maximum(np.where(rate > 0.0, high - q, q - low), _LEAST_ROOM)
        top = most * (np.sqrt(reaction**2 + 2.0 * room / most) - reaction)
        with np.errstate(divide="ignore"):
            found: FloatArray = (top / np.abs(rate)).min(axis=1)
        return found

    return path_speed
