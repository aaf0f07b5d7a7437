"""What a configuration leaves of the arm's constraints, and how a motion of the camera changes it."""

from __future__ import annotations

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.robots import ArmBodies
from omniservo.robots.arm import LENGTH_SCALE
from omniservo.robots.collision.posture_gaps import PostureGaps
from omniservo.robots.kinematics.twist_matrix import twist_matrix
from omniservo.whole_arm.arm_setting import ArmSetting
from omniservo.whole_arm.pull_kernel import JointConstraints, Near, Pulls, measured_pulls, write_pulls

GROUPS = 3
"""joint limits, singularity, clearance"""

_NEAR = 0.1
"""Gaps beyond it, over ℓ, are plenty."""


class JointDemands:
    """Dimensionless constraints g ≥ 0 of a configuration.

    Joint-limit margin of each joint beyond the reserve [rad]; smallest singular value of the camera
    Jacobian beyond what is required; gap of each pair of bodies beyond its clearance over a length ℓ.
    """

    def __init__(self, setting: ArmSetting, bodies: ArmBodies, ell: float) -> None:
        """Prepare; ``ell`` [m] makes gaps comparable with angles."""
        self._bodies, arm, reserve = bodies, setting.arm, setting.limit_reserve
        self._asked = JointConstraints(
            twist_matrix(setting.flange_T_camera, LENGTH_SCALE),
            arm.joint_range + reserve * np.array([1.0, -1.0]),
            np.array([setting.singular_value]),
            bodies.asked(setting.clearance_around, setting.self_clearance),
            np.array([ell]),
        )

    @property
    def gaps(self) -> FloatArray:
        """What each pair of bodies has to keep (p,) [m]."""
        return self._asked.gaps

    def values(self, joints: FloatArray, near: float = _NEAR, seen: PostureGaps | None = None) -> FloatArray:
        """Return the smallest g of each group (GROUPS,) over joints (m, n); 1 for bodies not ``near``."""
        least: FloatArray = self.pulls(joints, np.array([0.0, 0.0, near]), seen).least.min(axis=0)
        return least

    def pulls(self, joints: FloatArray, targets: FloatArray, seen: PostureGaps | None = None) -> Pulls:
        """Return the rows of what is below its target (GROUPS,) at the joints (m, n).

        ``seen``: has measured configurations near these; None: nothing has.
        """
        bodies, m = self._bodies, len(joints)
        seen = PostureGaps(bodies, m) if seen is None else seen
        joints, chain, shapes = np.array(joints, order="C"), bodies.arm.chain, bodies.shapes
        found = Pulls(np.empty((m, 6, 7)), np.empty(m), np.empty((m, GROUPS)))
        posture, pair, gaps, touching = measured_pulls(
            chain, shapes, bodies.scene.frames, seen.postures, self._asked, joints, targets, found
        )
        if len(touching):
            seen.measure(posture, pair, touching, gaps)
            near = Near(posture, pair, gaps)
            write_pulls(chain, shapes, seen.postures, self._asked, joints, near, targets, found)
        return found

    def seen(self, count: int) -> PostureGaps:
        """Return what remembers measurements of ``count`` configurations that move."""
        return PostureGaps(self._bodies, count)
