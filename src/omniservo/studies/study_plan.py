"""The plan of a row, with the joints that follow it if there is an arm, and how fast it is followed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray
from omniservo.planning import Plan, PlanningProblem, plan_path
from omniservo.risk import plan_arm_with_risk, plan_with_risk
from omniservo.robots import Arm, JointPath, follow_path
from omniservo.run_methods import Planner
from omniservo.safety.closed_loop import Posture
from omniservo.servoing import EvenPaceLaw, PathLimits, TimeLaw
from omniservo.studies.scene_start import Estimated
from omniservo.studies.study import Study
from omniservo.studies.study_scene import LEAST_DISTANCE, StudyScene
from omniservo.whole_arm import ArmSetting, plan_with_arm

_SPEED_SHARE = 0.75
"""of the largest speeds of the camera, what a path is paced for; the rest is left to feedback"""
_JOINT_SHARE = 0.5
"""of the arm's joint speeds and accelerations, likewise"""
_LEAST_DURATION = 2.0
"""[s] of a path"""
_PLACES = 801
"""in time, at which the joints' limits are checked"""


@dataclass(frozen=True, eq=False)
class StudyPlan:
    """A plan, and what follows it."""

    plan: Plan
    required: PlanningProblem
    """what a way that is planned later has to keep; ``plan`` keeps a margin to image limits, too, and what
    its risk asks for"""
    setting: ArmSetting | None
    """of the arm as it is stated to the planner; None: there is none"""
    joints: JointPath | None
    """that follow the plan from where the arm stands; None: there is no arm, or it cannot follow all of it"""

    def time_law(self, study: Study) -> EvenPaceLaw:
        """Return the law by which the speeds of camera and joints leave room for feedback.

        Raises:
            InputError: the plan has no path.
        """
        path = self.plan.path
        if path is None:
            raise InputError(f"plan: status {self.plan.status!r} without a path; a plan with one is needed")

        def pace(w: FloatArray) -> FloatArray:
            twists = path(w, order=1)
            parts = [
                np.linalg.norm(twists[:, :3], axis=1) / study.servo.linear_speed,
                np.linalg.norm(twists[:, 3:], axis=1) / study.servo.angular_speed,
            ]
            if limits is not None:  # a place that asks much of the joints is slowed down, not all of the path
                parts.append(_SPEED_SHARE * (np.abs(limits.joints(w, 1)) / limits.speeds).max(axis=1))
            return np.asarray(np.max(parts, axis=0))

        limits = None
        if self.setting is not None and self.joints is not None:
            limits = joint_limits(self.setting.arm, self.joints)
        law = EvenPaceLaw(pace, _SPEED_SHARE, _LEAST_DURATION)
        if limits is None:
            return law
        excess = limits.excess(*law.motion(np.linspace(0.0, law.duration, _PLACES)))
        return law if excess <= 1.0 else EvenPaceLaw(pace, _SPEED_SHARE, excess * law.duration)

    def posture(self, law: TimeLaw) -> Posture | None:
        """Return where the joints are to be at a time; None where none are known to follow the plan."""
        joints = self.joints
        if joints is None:
            return None

        def at(time: float) -> tuple[FloatArray, FloatArray]:
            w, speed = law(time)
            return joints(w), speed * joints(w, 1)

        return at


def joint_limits(arm: Arm, joints: JointPath) -> PathLimits:
    """Return what a time law may use of the arm's speeds and accelerations along joints."""
    return PathLimits(joints, _JOINT_SHARE * arm.joint_speed, _JOINT_SHARE * arm.joint_acceleration)


@lru_cache(maxsize=1)
def planned(study: Study, scene: StudyScene, planner: Planner, known: Estimated) -> StudyPlan:
    """Return the plan for what is estimated, which may have no path: methods of a planner share it."""
    certified = planner == "certified"
    problem = PlanningProblem(
        scene.camera,  # type: ignore[arg-type]  # of any model: its unified form is taken
        known.points,
        known.goal,
        scene.obstacles,
        clearance=scene.clearance + study.servo.clearance_margin,
        least_distance=LEAST_DISTANCE,
        visibility_margin=study.servo.visibility_margin,
        occlusion=certified and bool(scene.obstacles),  # the paper's method knows none
    )
    setting = None if scene.arm is None else scene.arm.setting(study.servo.clearance_margin)
    if certified:
        plan = _certified(study, scene, problem, known, setting)
    else:
        plan = plan_path(problem, method="paper", seed=scene.number)
    required = replace(problem, visibility_margin=0.0)
    return StudyPlan(plan, required, setting, None if setting is None else _followed(setting, plan))


def _certified(
    study: Study, scene: StudyScene, problem: PlanningProblem, known: Estimated, setting: ArmSetting | None
) -> Plan:
    """Return a plan at the study's risk; where no path keeps that, one that takes the estimate as exact."""
    risk, seed = study.servo.risk, scene.number
    if risk is not None:
        if setting is None or scene.arm is None:
            found = plan_with_risk(problem, known.estimate, risk=risk, seed=seed)
        else:
            found = plan_arm_with_risk(
                problem, setting, known.estimate, risk=risk, seed=seed,
                mount_covariance=scene.arm.mount_covariance,
            )  # fmt: skip
        if found.ok:
            return found.plan
    if setting is None:
        return plan_path(problem, seed=seed)
    return plan_with_arm(problem, setting, seed=seed).plan


def _followed(setting: ArmSetting, plan: Plan) -> JointPath | None:
    if plan.path is None:
        return None
    frames = setting.base_T_initial, setting.flange_T_camera
    joints = follow_path(setting.arm, plan.path, *frames, start=setting.start, aim=plan.aim).best
    return joints if joints.w[-1] >= 1.0 else None
