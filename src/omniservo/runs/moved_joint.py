"""Whether somebody moved an arm since its joints were read."""

from __future__ import annotations

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.robots import Arm

MOVED = 5e-3
"""A joint that is farther from where it was read first was moved [rad]."""


def moved_joint(arm: Arm, before: FloatArray, now: FloatArray) -> str:
    """Return which joint was moved farthest from ``before`` (n,) to ``now`` (n,) [rad]; "": none was."""
    off = np.abs(now - before)
    worst = int(off.argmax())
    if off[worst] <= MOVED:
        return ""
    return f"{arm.joint_names[worst]} was moved by {np.rad2deg(off[worst]):.2f} deg"
