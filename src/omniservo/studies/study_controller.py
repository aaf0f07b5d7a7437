"""From what is estimated of a scene to what leads the camera: only what is measured is used."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from omniservo.errors import NoSolutionError
from omniservo.geometry.arrays import BoolArray, FloatArray, IntArray
from omniservo.planning import CameraPath, Plan, PlanningProblem, plan_path
from omniservo.risk import plan_with_risk
from omniservo.run_methods import RunMethod
from omniservo.servoing import EvenPaceLaw
from omniservo.studies.program import Program
from omniservo.studies.scene_start import Estimated, SceneStart
from omniservo.studies.study import Study
from omniservo.tracking import GoalServo, GoalServoOptions, PathTracker, TrackerOptions

_SPEED_SHARE = 0.75
"""of the largest speeds, what a path is paced for; the rest is left to feedback"""
_LEAST_DURATION = 2.0
"""[s] of a path"""
_LEAST_DISTANCE = 0.03
"""[m] that plans keep to the points"""
_NOISE_SHARE = 2.5
"""The goal image and this one both have noise: √2 · √2 σ on average, and this many σ for certain."""


class StudyController(Protocol):
    """Images in, twists out; `PathTracker` and `GoalServo` are ones."""

    @property
    def done(self) -> bool:
        """Whether the goal is reached."""
        ...

    def step(
        self, time: float, pixels: FloatArray, valid: BoolArray, acts_at: float | None = None
    ) -> FloatArray:
        """Return the camera twist (6,) for the points seen at ``time`` [s]."""
        ...


@dataclass(frozen=True, eq=False)
class Led:
    """What leads the camera, and what it rests on."""

    controller: StudyController
    followed: IntArray
    """(m,) the scene's points that are servoed on"""
    plan: Plan | None
    """None: the method plans nothing"""


class NotLed(NoSolutionError):
    """There is nothing that leads the camera: no estimate, or no plan."""

    def __init__(self, status: str, reason: str) -> None:
        super().__init__(reason)
        self.status, self.reason = status, reason


def controller_of_scene(study: Study, start: SceneStart, program: Program, name: str) -> Led:
    """Return the method's controller for what is estimated of the scene.

    Raises:
        NotLed: the images give no estimate, or the planner finds no path to follow.
    """
    known, camera, method = start.estimated, start.scene.camera, program.method(name)
    if isinstance(known, str):
        raise NotLed("not_estimated", known)
    speeds = study.servo.linear_speed, study.servo.angular_speed
    tolerance = study.servo.tolerance_px + _NOISE_SHARE * known.estimate.noise_px
    if method.plans is None:
        servo = GoalServo(
            camera, known.points, known.goal_pixels,
            method=program.law(name, study.servo.gain), initial_T_goal=known.goal,
            options=GoalServoOptions(tolerance, *speeds),
        )  # fmt: skip
        return Led(servo, known.followed, None)
    plan = _plan(study, start, method, known)
    if plan.path is None or (method.plans == "certified" and plan.status != "certified"):
        raise NotLed("not_planned", f"{plan.status}: {plan.reason}")
    options = TrackerOptions(tolerance_px=tolerance, max_linear_speed=speeds[0], max_angular_speed=speeds[1])
    tracker = PathTracker(
        plan, camera, goal_pixels=known.goal_pixels, initial_pixels=known.initial_pixels,
        options=options, time_law=_time_law(study, plan.path),
    )  # fmt: skip
    return Led(tracker, known.followed, plan)


def _plan(study: Study, start: SceneStart, method: RunMethod, known: Estimated) -> Plan:
    scene, certified = start.scene, method.plans == "certified"
    problem = PlanningProblem(
        scene.camera,  # type: ignore[arg-type]  # of any model: its unified form is taken
        known.points,
        known.goal,
        scene.obstacles,
        clearance=scene.clearance + study.servo.clearance_margin,
        least_distance=_LEAST_DISTANCE,
        visibility_margin=study.servo.visibility_margin,
        occlusion=certified and bool(scene.obstacles),  # the paper's method knows none
    )
    if certified and study.servo.risk is not None:
        found = plan_with_risk(problem, known.estimate, risk=study.servo.risk, seed=scene.number)
        if found.ok:
            return found.plan
    return plan_path(problem, method="certified" if certified else "paper", seed=scene.number)


def _time_law(study: Study, path: CameraPath) -> EvenPaceLaw:
    """Return the law by which the path's own speeds leave room for feedback."""

    def pace(w: FloatArray) -> FloatArray:
        twists = path(w, order=1)
        linear = np.linalg.norm(twists[:, :3], axis=1) / study.servo.linear_speed
        return np.asarray(
            np.maximum(linear, np.linalg.norm(twists[:, 3:], axis=1) / study.servo.angular_speed)
        )

    return EvenPaceLaw(pace, _SPEED_SHARE, _LEAST_DURATION)
