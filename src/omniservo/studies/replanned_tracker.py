"""A plan that is made again on the way, where the estimate of points and goal, or an obstacle, has moved."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.planning import CameraPath, Sphere
from omniservo.robots import JointPath
from omniservo.safety.closed_loop import Posture
from omniservo.servoing import PathLimits
from omniservo.studies.study import Study
from omniservo.studies.study_plan import StudyPlan, joint_limits
from omniservo.studies.study_scene import StudyScene
from omniservo.tracking import FollowingArm, PathTracker, Replanner, ReplanOptions
from omniservo.tracking.replanning import Replanning

_LATER = 0.5
"""times the room that links keep by the first plan is what they keep later, where no way on leaves more: an
estimate that moves takes some of it, most of all where the arm ends"""


class ReplannedTracker:
    """Steps a `PathTracker`, and after each step lets a `Replanner` look at what it has learnt.

    Planning takes no time of the run; another way is entered when an image more can have acted.

    Args:
        study: says what a plan keeps.
        scene: says how late images arrive.
        tracker: follows the plan.
        found: the plan, and the joints that follow it.
    """

    def __init__(self, study: Study, scene: StudyScene, tracker: PathTracker, found: StudyPlan) -> None:
        late = scene.conditions.latency + scene.conditions.jitter
        options = ReplanOptions.of_loop(study.images.rate, late, study.servo.clearance_margin, scene.number)
        arm = _following_arm(found)
        self._tracker = tracker
        self._replanner = Replanner(tracker, found.plan, arm=arm, required=found.required, options=options)
        self.posture: Posture | None = None if arm is None else self._replanner.posture
        """where the arm is to be at a time; None: there is none"""
        self.set_obstacles: Callable[[tuple[Sphere, ...]], None] = self._replanner.set_obstacles
        """takes in where obstacles are"""

    @property
    def events(self) -> tuple[Replanning, ...]:
        """What came of every look at which something had changed."""
        return tuple(self._replanner.events)

    @property
    def done(self) -> bool:
        """Whether the goal is reached."""
        return self._tracker.done

    def step(
        self, time: float, pixels: FloatArray, valid: BoolArray, acts_at: float | None = None
    ) -> FloatArray:
        """Return the camera twist (6,) for the points seen at ``time`` [s].

        Raises:
            Blocked: what is seen leaves no proven way on.
            ServoStop: as `PathTracker.step`.
        """
        twist = self._tracker.step(time, pixels, valid, acts_at)
        self._replanner.look(time)
        return twist


def _following_arm(found: StudyPlan) -> FollowingArm | None:
    if found.setting is None or found.joints is None:
        return None
    setting, arm = found.setting, found.setting.arm
    clearance = None if setting.clearance is None else _LATER * setting.clearance

    def limits(path: CameraPath, joints: JointPath) -> PathLimits:
        del path
        return joint_limits(arm, joints)

    return FollowingArm(setting, found.joints, limits, required=replace(setting, clearance=clearance))
