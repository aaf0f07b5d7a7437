"""From a camera path that the arm cannot follow to one nearby that it can, at samples of w.

Levenberg–Marquardt on squared hinges as in `omniservo.planning.search.descent`, with the arm's beside
the camera's: at every sample the joints are known, and J⁻¹ turns their slopes into slopes of the camera's
pose. Joints follow the path by Newton's iteration from where they were before the step, so that they stay on
their branch.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.quick_poses import inverse
from omniservo.planning.constraints.constraints import Constraints
from omniservo.planning.search.descent import ENOUGH, Room, room_for, solve_damped
from omniservo.planning.search.path_family import PathFamily, set_samples, unknowns
from omniservo.planning.search.settle import PULL
from omniservo.robots.collision.posture_gaps import PostureGaps
from omniservo.whole_arm.arm_equations import add_arm, camera_equations, follow_poses
from omniservo.whole_arm.arm_setting import ArmSetting
from omniservo.whole_arm.joint_demands import JointDemands

TARGETS = np.array([0.03, 0.02, 0.03])
"""What the arm's constraints are pushed to: limits [rad], singular value, gaps over ℓ."""

STEPS = 30
"""of a descent at most"""

STALLED = 1e-3
"""A step that gains less than this part of the cost ends a descent."""

LEAP = 0.5
"""[rad] A step that moves a joint farther at some sample is too long to stay on the branch."""


@dataclass(frozen=True, eq=False)
class Look:
    """The path at the samples: what it costs, what is least of every constraint, and where to go."""

    cost: float
    normal: FloatArray
    joints: FloatArray
    """(m, n) at the samples that the arm reaches [rad]"""
    camera_least: FloatArray
    arm_least: FloatArray


class ArmDescent:
    """Moves the free control points of a path family."""

    def __init__(
        self,
        constraints: Constraints,
        family: PathFamily,
        setting: ArmSetting,
        joint_demands: JointDemands,
        seen: PostureGaps,
    ) -> None:
        """Join a problem's arrays and the arm's constraints; ``seen`` knows joints near the first ones."""
        self._constraints, self._family, self._setting, self._joint_demands = (
            constraints,
            family,
            setting,
            joint_demands,
        )
        self._ell = constraints.ell
        self._base_T_initial = setting.base_T_initial.as_matrix()
        self._camera_T_flange = inverse(setting.flange_T_camera)
        self._camera_ends = self._end_values()
        self._seen = seen

    def lower(
        self, x: FloatArray, places: FloatArray, joints: FloatArray, end_least: FloatArray, higher: float
    ) -> tuple[FloatArray, bool] | None:
        """Return the offsets where the descent ends, and whether half of every target is reached there.

        None: it cannot begin, because these joints do not lead onto the path.

        Args:
            x: offsets at first.
            places: (m,) w of the samples, ascending.
            joints: (k, n) near those at the first k ≤ m samples [rad]: as far as the arm can follow the path.
            end_least: (GROUPS,) smallest g of the arm at its end configurations, which no path can improve.
            higher: factor of the targets.
        """
        camera = np.maximum(0.0, np.minimum(higher * 0.03, 0.5 * self._camera_ends))
        arm = np.maximum(0.0, np.minimum(higher * TARGETS, 0.5 * end_least))
        set_samples(self._family, places)
        room = room_for(len(places), self._constraints.points.shape[0])
        if len(joints) != self._seen.count:
            self._seen = self._joint_demands.seen(len(joints))
        now = self._look(x, camera, arm, joints, room)
        damping, factor, step = 1e-6, np.empty((len(x), len(x))), np.empty(len(x))
        for _ in range(STEPS):
            if now is None:
                return None
            if self._reached(now, camera, arm):
                break
            if not solve_damped(now.normal, damping, factor, step):
                break
            tried = self._look(x + step, camera, arm, now.joints, room)
            if tried is None or tried.cost >= now.cost:
                damping = max(5.0 * damping, 1e-4)
                if damping > 1e4:
                    break
                continue
            stalled = now.cost - tried.cost < STALLED * now.cost
            x, now, damping = x + step, tried, max(0.2 * damping, 1e-9)
            if stalled:
                break
        return x, now is not None and len(joints) == len(places) and self._reached(now, camera, arm)

    def _reached(self, look: Look, camera: FloatArray, arm: FloatArray) -> bool:
        return bool((look.camera_least >= ENOUGH * camera).all() and (look.arm_least >= ENOUGH * arm).all())

    def _look(
        self,
        x: FloatArray,
        camera: FloatArray,
        arm: FloatArray,
        joints: FloatArray,
        room: Room,
    ) -> Look | None:
        """Return what there is at x; None where the arm cannot follow from the joints of before."""
        cost, least, normal = camera_equations(self._constraints, self._family, x, camera, PULL, room)
        followed = self._followed(room.poses[: len(joints)], joints)
        if followed is None:
            return None
        pulls = self._joint_demands.pulls(followed, arm, self._seen)
        add_arm(self._family, self._ell, room, pulls.costs, pulls.systems, normal)
        arm_least = pulls.least.min(axis=0, initial=1.0)
        return Look(cost + float(pulls.costs.sum()), normal, followed, least, arm_least)

    def _followed(self, poses: FloatArray, joints: FloatArray) -> FloatArray | None:
        """Return the joints (m, n) at the camera's poses (m, 14), each by Newton from where it was."""
        followed, chain = joints.copy(), self._setting.arm.chain
        frames = self._base_T_initial, poses, self._camera_T_flange
        return followed if follow_poses(chain, *frames, LEAP, followed) else None

    def _end_values(self) -> FloatArray:
        """Return the smallest g of every camera constraint at the two end poses."""
        set_samples(self._family, np.array([0.0, 1.0]))
        targets = np.full(self._constraints.slots.total, -np.inf)
        room = room_for(2, self._constraints.points.shape[0])
        offsets = np.zeros(unknowns(self._family))
        _, least, _ = camera_equations(self._constraints, self._family, offsets, targets, 0.0, room)
        return least
