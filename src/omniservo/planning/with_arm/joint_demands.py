"""What a posture leaves of the arm's demands, and how a motion of the camera changes it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.planning.with_arm.arm_setting import ArmSetting
from omniservo.planning.with_arm.pull_kernel import CLEARANCE, write_pull
from omniservo.robots import ArmBodies
from omniservo.robots.arm import LENGTH_SCALE
from omniservo.robots.twist_matrix import twist_matrix

GROUPS = 3
"""joint limits, singularity, clearance"""

_NEAR = 0.1
"""Gaps beyond it, over ℓ, are plenty."""


@dataclass(frozen=True, eq=False)
class Pull:
    """Rows of one posture as in `omniservo.planning.constraints.push`."""

    system: FloatArray
    """(6, 7) [Σ a aᵀ, Σ a r] for a camera motion ξ = (linear [m], angular) in the camera frame"""
    cost: float
    """Σ r²/2"""
    least: FloatArray
    """(GROUPS,) smallest g"""


class JointDemands:
    """Dimensionless constraints g ≥ 0 of a posture.

    Room to the ends of each joint's range beyond the reserve [rad]; smallest singular value of the camera
    Jacobian beyond `SINGULAR_VALUE`; gap of each pair of bodies beyond its clearance over a length ℓ.
    """

    def __init__(self, setting: ArmSetting, bodies: ArmBodies, ell: float) -> None:
        """Prepare; ``ell`` [m] makes gaps comparable with angles."""
        self._setting, self._bodies, self._ell = setting, bodies, ell
        self._to_camera = twist_matrix(setting.flange_T_camera, LENGTH_SCALE)
        self._rooms = setting.arm.joint_range + setting.limit_reserve * np.array([1.0, -1.0])
        self._asked = bodies.asked(setting.clearance_around, setting.self_clearance)

    def values(self, q: FloatArray) -> FloatArray:
        """Return the smallest g of each group (GROUPS,) at the joints q (n,); 1 where no bodies are near."""
        return self.pull(q, np.array([0.0, 0.0, _NEAR])).least

    def pull(self, q: FloatArray, targets: FloatArray) -> Pull:
        """Return the rows of what is below its target (GROUPS,) at the joints q (n,)."""
        gaps, slopes = self._gaps(q, float(targets[CLEARANCE]))
        system, least = np.empty((6, 7)), np.empty(GROUPS)
        cost = write_pull(
            self._setting.arm.chain,
            self._to_camera,
            self._rooms,
            np.array(q),
            gaps,
            slopes,
            targets,
            system,
            least,
        )
        return Pull(system, cost, least)

    def _gaps(self, q: FloatArray, target: float) -> tuple[FloatArray, FloatArray]:
        """Return g (k,) of the pairs that may be below the target, and ∂g/∂q (k, n)."""
        self._bodies.place(q)
        most = float(self._asked.max(initial=0.0)) + self._ell * max(target, 0.0)
        near = self._bodies.near(most)
        gaps, slopes = np.empty(len(near)), np.empty((len(near), len(q)))
        for k, one in enumerate(near):
            gaps[k], slopes[k] = one.gap - self._asked[one.pair], one.slope
        return gaps / self._ell, slopes / self._ell
