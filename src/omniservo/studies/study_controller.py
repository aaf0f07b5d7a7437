"""From what is estimated of a scene to what leads the camera: only what is measured is used."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from omniservo.errors import NoSolutionError
from omniservo.geometry.arrays import BoolArray, FloatArray, IntArray
from omniservo.planning import Plan, Sphere
from omniservo.run_methods import RunMethod
from omniservo.safety.closed_loop import Posture
from omniservo.studies.program import Program
from omniservo.studies.replanned_tracker import ReplannedTracker
from omniservo.studies.scene_start import Estimated, SceneStart
from omniservo.studies.study import Study
from omniservo.studies.study_plan import StudyPlan, planned
from omniservo.tracking import GoalServo, GoalServoOptions, PathTracker, TrackerOptions

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
    posture: Posture | None = None
    """where the arm is to be; None: anywhere, or there is none"""
    given_obstacles: Callable[[tuple[Sphere, ...]], None] | None = None
    """takes in where obstacles are, from then on; None: the method does not plan again"""


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
    known, method = start.estimated, program.method(name)
    if isinstance(known, str):
        raise NotLed("not_estimated", known)
    speeds = study.servo.linear_speed, study.servo.angular_speed
    tolerance = study.servo.tolerance_px + _NOISE_SHARE * known.estimate.noise_px
    if method.plans is None:
        servo = GoalServo(
            start.scene.camera, known.points, known.goal_pixels,
            method=program.law(name, study.servo.gain), initial_T_goal=known.goal,
            options=GoalServoOptions(tolerance, *speeds),
        )  # fmt: skip
        return Led(servo, known.followed, None)
    found = planned(study, start.scene, method.plans, known)
    plan = found.plan
    if plan.path is None or (method.plans == "certified" and plan.status != "certified"):
        raise NotLed("not_planned", f"{plan.status}: {plan.reason}")
    options = TrackerOptions(tolerance_px=tolerance, max_linear_speed=speeds[0], max_angular_speed=speeds[1])
    return _following(study, start, method, known, found, options)


def _following(
    study: Study,
    start: SceneStart,
    method: RunMethod,
    known: Estimated,
    found: StudyPlan,
    options: TrackerOptions,
) -> Led:
    """Return what follows a plan, and plans it again where the method does."""
    law = found.time_law(study)
    tracker = PathTracker(
        found.plan, start.scene.camera, goal_pixels=known.goal_pixels, initial_pixels=known.initial_pixels,
        options=options, time_law=law,
    )  # fmt: skip
    if not method.replans:
        return Led(tracker, known.followed, found.plan, found.posture(law))
    replanned = ReplannedTracker(study, start.scene, tracker, found)
    return Led(replanned, known.followed, found.plan, replanned.posture, replanned.set_obstacles)
