"""What a posture leaves of the arm's demands, and how a motion of the camera changes it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.planning.with_arm.arm_setting import ArmSetting
from omniservo.planning.with_arm.pull_kernel import CLEARANCE, write_pulls
from omniservo.robots import ArmBodies
from omniservo.robots.arm import LENGTH_SCALE
from omniservo.robots.posture_gaps import PostureGaps
from omniservo.robots.twist_matrix import twist_matrix

GROUPS = 3
"""joint limits, singularity, clearance"""

_NEAR = 0.1
"""Gaps beyond it, over ℓ, are plenty."""


class Pulls(NamedTuple):
    """Rows of m postures as in `omniservo.planning.constraints.push`."""

    systems: FloatArray
    """(m, 6, 7) [Σ a aᵀ, Σ a r] for a camera motion ξ = (linear [m], angular) in the camera frame"""
    costs: FloatArray
    """(m,) Σ r²/2"""
    least: FloatArray
    """(m, GROUPS) smallest g"""


class JointDemands:
    """Dimensionless constraints g ≥ 0 of a posture.

    Room to the ends of each joint's range beyond the reserve [rad]; smallest singular value of the camera
    Jacobian beyond what is asked; gap of each pair of bodies beyond its clearance over a length ℓ.
    """

    def __init__(self, setting: ArmSetting, bodies: ArmBodies, ell: float) -> None:
        """Prepare; ``ell`` [m] makes gaps comparable with angles."""
        self._setting, self._bodies, self._ell = setting, bodies, ell
        self._to_camera = twist_matrix(setting.flange_T_camera, LENGTH_SCALE)
        self._rooms = setting.arm.joint_range + setting.limit_reserve * np.array([1.0, -1.0])
        self._asked = bodies.asked(setting.clearance_around, setting.self_clearance)

    def values(self, q: FloatArray) -> FloatArray:
        """Return the smallest g of each group (GROUPS,) at the joints q (n,); 1 where no bodies are near."""
        least: FloatArray = self.pulls(q[None], np.array([0.0, 0.0, _NEAR])).least[0]
        return least

    def pulls(self, joints: FloatArray, targets: FloatArray, seen: PostureGaps | None = None) -> Pulls:
        """Return the rows of what is below its target (GROUPS,) at the joints (m, n).

        ``seen``: has measured postures near these; None: nothing has.
        """
        seen = PostureGaps(self._bodies, len(joints)) if seen is None else seen
        joints, m = np.array(joints, order="C"), len(joints)
        near = seen.below(joints, self._asked + self._ell * max(float(targets[CLEARANCE]), 0.0))
        found = Pulls(np.empty((m, 6, 7)), np.empty(m), np.empty((m, GROUPS)))
        write_pulls(
            self._setting.arm.chain,
            self._to_camera,
            self._rooms,
            self._setting.singular_value,
            joints,
            near.posture,
            (near.gap - self._asked[near.pair]) / self._ell,
            near.slope / self._ell,
            targets,
            found.systems,
            found.least,
            found.costs,
        )
        return found

    def seen(self, count: int) -> PostureGaps:
        """Return what remembers measurements of ``count`` postures that move."""
        return PostureGaps(self._bodies, count)
