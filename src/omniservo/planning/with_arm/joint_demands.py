"""What a posture leaves of the arm's demands, and how a motion of the camera changes it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.planning.with_arm.arm_setting import ArmSetting
from omniservo.robots import ArmBodies
from omniservo.robots.arm import LENGTH_SCALE, SINGULAR_VALUE
from omniservo.robots.posture import sensitivities
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
        self._low = setting.arm.joint_range[:, 0] + setting.limit_reserve
        self._high = setting.arm.joint_range[:, 1] - setting.limit_reserve
        self._asked = bodies.asked(setting.clearance_around, setting.self_clearance)

    def values(self, q: FloatArray) -> FloatArray:
        """Return the smallest g of each group (GROUPS,) at the joints q (n,); 1 where no bodies are near."""
        return self.pull(q, np.array([0.0, 0.0, _NEAR])).least

    def pull(self, q: FloatArray, targets: FloatArray) -> Pull:
        """Return the rows of what is below its target (GROUPS,) at the joints q (n,)."""
        to_joints, slope = np.empty((len(q), 6)), np.empty(len(q))
        value = sensitivities(self._setting.arm.chain, self._to_camera, np.array(q), to_joints, slope)
        rows = [
            *self._limits(q, targets[0]),
            (1, value - SINGULAR_VALUE, slope),
            *self._gaps(q, targets[2]),
        ]
        groups, g, slopes = (np.array(column) for column in zip(*rows, strict=True))
        least = np.array([g[groups == k].min(initial=1.0) for k in range(GROUPS)])
        residuals = np.maximum(targets[groups] - g, 0.0)
        active = residuals > 0.0
        a = slopes[active] @ to_joints
        system = np.column_stack([a.T @ a, a.T @ residuals[active]])
        return Pull(system, float(0.5 * residuals @ residuals), least)

    def _limits(self, q: FloatArray, target: float) -> list[tuple[int, float, FloatArray]]:
        unit = np.eye(len(q))
        rooms = [(q - self._low, 1.0), (self._high - q, -1.0)]
        nearest = [(0, float(room.min()), sign * unit[room.argmin()]) for room, sign in rooms]
        return nearest + [
            (0, float(room[j]), sign * unit[j])
            for room, sign in rooms
            for j in np.flatnonzero(room < target)
            if j != room.argmin()
        ]

    def _gaps(self, q: FloatArray, target: float) -> list[tuple[int, float, FloatArray]]:
        self._bodies.place(q)
        most = float(self._asked.max(initial=0.0)) + self._ell * max(target, 0.0)
        return [
            (2, (near.gap - float(self._asked[near.pair])) / self._ell, near.slope / self._ell)
            for near in self._bodies.near(most)
        ]
