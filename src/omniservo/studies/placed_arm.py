"""The arm of a scene: where it stands, such that it reaches start and goal and touches nothing there."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray
from omniservo.planning import PlanningProblem, Sphere
from omniservo.robots import CAMERA_HOUSING, Arm, Solid
from omniservo.robots.arm import SINGULAR_VALUE
from omniservo.robots.collision.posture_gaps import PostureGaps
from omniservo.studies.study_arms import StudyArm
from omniservo.whole_arm import ArmSetting
from omniservo.whole_arm.arm_ends import violation_at_goal, violation_at_start
from omniservo.whole_arm.arm_setting import SERVO_RESERVE

_TRIED = 40
"""joint configurations at the start, for one start and goal"""
_WITHIN = 2.2
"""[rad] At the start no joint is farther from 0, or from what of its range is nearest to 0,"""
_ROOM = 0.1
"""[rad] and none is nearer to an end of its range."""
_LEAST_HEIGHT = 0.1
"""[m] of the camera above the floor, which is where the arm's foot is, at both ends"""
_TOGETHER = 256
"""joint configurations that are measured at once"""
_FAR = 0.4
"""[m] The largest gap that is measured."""
_NEVER = 10.0
"""[m] No gap is so deep."""
_TRACKED = 1.25
"""times the singular value at which an arm is stopped: what plans keep"""
_REGULAR = 2.0
"""times the singular value at which an arm is stopped: what it has at both ends, where no job should begin"""


@dataclass(frozen=True, eq=False)
class MountError:
    """How far the camera truly is from where its mount is stated."""

    translation: float
    """[m], in any direction"""
    rotation: float
    """[rad], about any axis"""

    def drawn(self, random: np.random.Generator) -> RigidTransform:
        """Return stated_T_true."""
        ways = random.standard_normal((2, 3))
        ways /= np.linalg.norm(ways, axis=1)[:, None]
        return RigidTransform.from_exp_coords(
            np.concatenate((self.rotation * ways[0], self.translation * ways[1]))
        )


@dataclass(frozen=True, eq=False)
class PlacedArm:
    """An arm that carries a scene's camera."""

    name: str
    """as rows have it"""
    stated: StudyArm
    start: FloatArray
    """(n,) where it stands at first [rad]"""
    flange_T_camera: RigidTransform
    """truly; ``stated`` may be off"""

    @property
    def arm(self) -> Arm:
        """Its kinematics and limits."""
        return self.stated.load()

    @property
    def base_T_initial(self) -> RigidTransform:
        """The initial camera in the base frame, truly."""
        return self.arm.base_T_flange(self.start) * self.flange_T_camera

    @property
    def mount_covariance(self) -> FloatArray | None:
        """Of the stated mount; None: it is taken as exact."""
        stated = self.stated.mount_covariance
        return None if stated is None else np.array(stated)

    def setting(self, clearance: float) -> ArmSetting:
        """Return the arm as planners know it; links and the camera's housing keep ``clearance`` [m].

        Joints and singular value keep more than what the supervisor stops the arm at: it moves.
        """
        kept = self._setting(self.stated.flange_T_camera.transform, clearance)
        return replace(kept, limit_reserve=SERVO_RESERVE, singular_value=_TRACKED * SINGULAR_VALUE)

    def true_setting(self) -> ArmSetting:
        """Return the arm as it is; links and the camera's housing may come as near as they can."""
        return self._setting(self.flange_T_camera, 0.0)

    def nearness(self, joints: FloatArray, obstacles: tuple[Sphere, ...]) -> tuple[float, bool]:
        """Return how near the arm came in configurations (m, n) [rad], and whether anything touched.

        The first is the least distance of links and the camera's housing to obstacles and the floor [m], at
        most `_FAR`; negative: depth. Touching counts of the arm's own parts, too.
        """
        bodies = self.true_setting().bodies(obstacles)
        gaps = PostureGaps(bodies, _TOGETHER)
        own = np.array([not bodies.is_around(pair) for pair in range(len(bodies.pairs))])
        alike, around = np.zeros(len(own)), np.where(own, -_NEVER, 0.0)
        moved = np.concatenate(([True], np.abs(np.diff(joints, axis=0)).max(axis=1) > 0.0))
        postures = np.ascontiguousarray(joints[moved])
        least, touch = _FAR, False
        for begin in range(0, len(postures), _TOGETHER):
            some = postures[begin : begin + _TOGETHER]
            nearer = gaps.worst(some, around, least)
            least = least if nearer is None else nearer[2]
            touch = touch or gaps.worst(some, alike, 0.0) is not None
        return least, touch

    def _setting(self, flange_T_camera: RigidTransform, clearance: float) -> ArmSetting:
        return ArmSetting(
            arm=self.arm,
            base_T_initial=self.arm.base_T_flange(self.start) * flange_T_camera,
            flange_T_camera=flange_T_camera,
            start=self.start,
            mounted=CAMERA_HOUSING,
            surroundings=(Solid.half_space("floor", [0.0, 0.0, 1.0], 0.0),),
            clearance=clearance,
        )


def placed_arm(
    name: str,
    stated: StudyArm,
    error: MountError,
    problem: PlanningProblem,
    clearance: float,
    random: np.random.Generator,
) -> PlacedArm | None:
    """Return the arm in joints from which it reaches the goal; None where a few draws have none.

    It can stand at both ends: joints keep their reserve, bodies ``clearance`` [m], where the problem has
    occlusion no link hides a point, the camera is above the floor, and so are the points. Whether a way leads
    from one to the other is not known.
    """
    arm, off = stated.load(), error.drawn(random)
    low, high = arm.joint_range.T
    room = np.minimum(_ROOM, 0.25 * (high - low))
    middle = np.clip(0.0, low, high)
    low, high = np.maximum(low + room, middle - _WITHIN), np.minimum(high - room, middle + _WITHIN)
    for q in random.uniform(low, high, (_TRIED, arm.dof)):
        placed = PlacedArm(name, stated, q, stated.flange_T_camera.transform * off)
        base_T_initial = placed.base_T_initial
        ends = base_T_initial.translation[2], (base_T_initial * problem.initial_T_goal).translation[2]
        least = float(base_T_initial.apply(problem.points)[:, 2].min())
        if min(ends) < _LEAST_HEIGHT or least < 0.0:
            continue
        if _stands(placed, problem, clearance):
            return placed
    return None


def _stands(placed: PlacedArm, problem: PlanningProblem, clearance: float) -> bool:
    """Return whether the arm can stand at both ends."""
    arm = placed.arm
    setting = replace(placed.setting(clearance), singular_value=_REGULAR * SINGULAR_VALUE)
    flange = setting.base_T_flange(problem.initial_T_goal)
    if np.linalg.norm(np.cross(arm.chain.axes[0], flange.translation - arm.chain.anchors[0])) > arm.reach:
        return False
    try:
        arm.inverse(flange)
    except InputError:
        return False
    bodies, anywhere = setting.bodies(problem.obstacles), replace(setting, start=None)
    return not (violation_at_start(problem, setting, bodies) or violation_at_goal(problem, anywhere, bodies))
