"""What follows a plan, or serves the goal image where nothing was planned."""

from __future__ import annotations

from omniservo.geometry.arrays import FloatArray
from omniservo.perception import MatchedPoints
from omniservo.planning import Plan
from omniservo.safety import Controller
from omniservo.servoing import ImageServoOptions
from omniservo.tasks import Task
from omniservo.tracking import GoalServo, PathTracker, TrackerOptions
from omniservo.tracking.planned_motion import PlannedMotion


def controller_of(
    task: Task, plan: Plan | None, motion: PlannedMotion | None, points: FloatArray, matched: MatchedPoints
) -> Controller:
    """Return the controller of points (n, 3) [m] that were ``matched``."""
    if plan is None or motion is None:
        return GoalServo(
            task.camera,
            points,
            matched.goal,
            tolerance_px=task.servo.tolerance_px,
            options=ImageServoOptions(gain=task.servo.rate),
        )
    options = TrackerOptions(
        feature=task.servo.feature,
        gain=task.servo.gain,
        delay=task.sensor.latency + 0.5 / task.sensor.rate,
        tolerance_px=task.servo.tolerance_px,
    )
    return PathTracker(
        plan,
        task.camera,
        goal_pixels=matched.goal,
        initial_pixels=matched.initial,
        options=options,
        time_law=motion.law,
    )
