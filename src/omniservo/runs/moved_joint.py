"""Whether somebody moved an arm since its joints were read."""

from __future__ import annotations

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.scenes import Scene

MOVED = 5e-3
"""A joint that is farther from where it was read first was moved [rad]."""


def moved_joint(scene: Scene, joints: FloatArray) -> str:
    """Return that a joint is not where the scene's start has it, the farthest one; "": none is."""
    off = np.abs(joints - scene.start_joints)
    worst = int(off.argmax())
    if off[worst] <= MOVED:
        return ""
    return f"{scene.arm.joint_names[worst]} was moved by {np.rad2deg(off[worst]):.2f} deg"
