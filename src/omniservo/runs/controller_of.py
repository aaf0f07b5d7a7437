"""What follows a plan, or leads to the goal image where nothing was planned."""

from __future__ import annotations

from omniservo.errors import NoSolutionError, ServoStop
from omniservo.estimation import TwoViewEstimate
from omniservo.geometry.arrays import IntArray
from omniservo.perception import MatchedPoints
from omniservo.planning import Plan
from omniservo.run_methods import RunMethod
from omniservo.safety import Controller
from omniservo.servoing import ServoMethod, servo_method
from omniservo.servoing.own_method import OwnMethod
from omniservo.tasks import Task
from omniservo.tracking import GoalServo, GoalServoOptions, PathTracker, TrackerOptions
from omniservo.tracking.planned_motion import PlannedMotion


def controller_of(
    task: Task,
    method: RunMethod,
    plan: Plan | None,
    motion: PlannedMotion | None,
    estimate: TwoViewEstimate,
    followed: IntArray,
    matched: MatchedPoints,
) -> Controller:
    """Return the controller of the ``followed`` rows (m,) of the estimated points, which were ``matched``.

    Raises:
        NoSolutionError: the method gives no twist at the goal image itself; nothing has moved yet.
    """
    if plan is None or motion is None:
        return _goal_servo(task, method, estimate, followed, matched)
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
        initial_pixels=None if task.scale.tags else matched.initial,  # a known target keeps its shape
        options=options,
        time_law=motion.law,
    )


def _goal_servo(
    task: Task, method: RunMethod, estimate: TwoViewEstimate, followed: IntArray, matched: MatchedPoints
) -> GoalServo:
    def new() -> ServoMethod:
        own, gain = method.source, task.servo.rate
        return servo_method(method.name, gain) if own is None else OwnMethod(own, gain)

    servo = GoalServo(
        task.camera,
        estimate.points[followed],
        matched.goal,
        method=new(),
        initial_T_goal=estimate.initial_T_goal,
        options=GoalServoOptions(tolerance_px=task.servo.tolerance_px),
    )
    try:
        new().step(servo.goal)
    except ServoStop as stop:
        raise NoSolutionError(
            f"{method.name}: no twist at the goal image: {stop.reason}: {stop}; nothing was commanded"
        ) from None
    return servo
