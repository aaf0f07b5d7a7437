"""How fast a planned camera path may be run through by this arm."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from omniservo.errors import NoSolutionError
from omniservo.geometry.arrays import FloatArray
from omniservo.planning import CameraPath, Plan
from omniservo.robots import Arm, JointPath
from omniservo.runs.borne_speed import borne_speed
from omniservo.runs.braked_speed import braked_speed
from omniservo.runs.own_branch import every_branch, own_branch
from omniservo.runs.safety_of_task import safety_of_task
from omniservo.scenes.scene import Scene
from omniservo.servoing import (
    ExponentialLaw,
    PathLimits,
    RestToRestLaw,
    TimeLaw,
    TimeOptimalLaw,
    image_speed,
)
from omniservo.servoing.time_law import EXPONENTIAL_END
from omniservo.tasks import Task
from omniservo.tracking.planned_motion import PlannedMotion

LEAST_DURATION = 4.0
"""[s] of the rest-to-rest law: slow enough for a person to watch, and for 30 frames a second."""

JOINT_SHARE = 0.5
"""share of the arm's joint speed and acceleration that the path may use; the rest is left to feedback"""

_LOOKS = 257
"""places of the exponential law"""

_PathSpeed: TypeAlias = Callable[[FloatArray], FloatArray]


def pace(task: Task, scene: Scene, plan: Plan) -> PlannedMotion | None:
    """Return the plan in joints and in time, with the task's law; None for a plan without a path.

    The rest-to-rest law gets the shortest legal duration, at least `LEAST_DURATION`, unless one is stated.

    Raises:
        NoSolutionError: the arm cannot follow the path from where it stands, or not in the duration stated.
    """
    if plan.path is None:
        return None
    joints = own_branch(task, scene, plan.path, plan.aim)
    points = plan.problem.points
    limits = limits_of(task, scene.arm, plan.path, joints, points)
    arms_own = limits_of(task, scene.arm, plan.path, joints, points, share=1.0)
    pixels = _image_speed_limit(task, plan.path, points)
    law = _law(task, limits, arms_own, pixels)
    free = replace(limits, path_speed=_braked(task, scene.arm, joints))
    return PlannedMotion(
        arm=scene.arm,
        joints=joints,
        law=law,
        limits=limits,
        time_optimal_seconds=TimeOptimalLaw(limits).duration,
        others=every_branch(task, scene, plan.path),
        notices=() if pixels is None else _slowed(task, law, free),
    )


def limits_of(
    task: Task,
    arm: Arm,
    path: CameraPath,
    joints: JointPath,
    points: FloatArray,
    *,
    share: float = JOINT_SHARE,
) -> PathLimits:
    """Return a share of the arm's limits, `braked_speed` and `borne_speed`, along joints that follow a path.

    Args:
        task: states the image speed, if one is, exposure and readout.
        arm: states the others.
        path: of the camera, in the frame of the points.
        joints: that follow it.
        points: (n, 3) [m].
        share: of joint speeds, accelerations and the ways to the ends of ranges.
    """
    pixels, braked = _image_speed_limit(task, path, points), _braked(task, arm, joints, share)

    def path_speed(w: FloatArray) -> FloatArray:
        return braked(w) if pixels is None else np.minimum(braked(w), pixels(w))

    return PathLimits(joints, share * arm.joint_speed, share * arm.joint_acceleration, path_speed)


def _braked(task: Task, arm: Arm, joints: JointPath, share: float = JOINT_SHARE) -> _PathSpeed:
    return braked_speed(arm, joints, safety_of_task(task), share)


def _image_speed_limit(task: Task, path: CameraPath, points: FloatArray) -> _PathSpeed | None:
    """Return what `borne_speed` lets ẇ be, a function of w; None where nothing bounds it."""
    top = borne_speed(task).speed
    if not np.isfinite(top):
        return None

    def path_speed(w: FloatArray) -> FloatArray:
        with np.errstate(divide="ignore"):
            found: FloatArray = np.float64(top) / image_speed(task.camera, path, points, w)
        return found

    return path_speed


def _law(task: Task, limits: PathLimits, arms_own: PathLimits, pixels: _PathSpeed | None) -> TimeLaw:
    servo = task.servo
    if servo.time_law == "exponential":
        law = ExponentialLaw(servo.rate)
        times = np.linspace(0.0, -np.log(EXPONENTIAL_END) / servo.rate, _LOOKS)
        w, speed, _ = law.motion(times)
        if pixels is not None and (excess := float((speed / pixels(w)).max())) > 1.0:
            raise NoSolutionError(
                f"servo.time_law: exponential is not stretched; points move {excess:.3g} times as fast as "
                f"{borne_speed(task).cause} lets them; legal: rest-to-rest, time-optimal, a lower servo.rate"
            )
        return law
    if servo.time_law == "time-optimal":
        return TimeOptimalLaw(limits)
    if servo.duration is None:
        return RestToRestLaw.for_limits(limits, least_duration=LEAST_DURATION)
    least = RestToRestLaw.for_limits(arms_own, least_duration=1e-3).duration
    if servo.duration < least:
        cause = borne_speed(task).cause
        bound = "the arm's limits" if cause == "the arm's limits" else f"the arm's limits and {cause}"
        raise NoSolutionError(
            f"servo.duration: {servo.duration:g} s given; {bound} need {least:.3g} s at least"
        )
    return RestToRestLaw(servo.duration)


def _slowed(task: Task, law: TimeLaw, free: PathLimits) -> tuple[str, ...]:
    """Return what is to be said of a motion that the camera's exposure or readout made longer.

    ``free``: the limits without these.
    """
    if borne_speed(task).cause == "servo.image_speed":
        return ()
    if isinstance(law, RestToRestLaw) and task.servo.duration is None:
        without = RestToRestLaw.for_limits(free, least_duration=LEAST_DURATION).duration
    elif isinstance(law, TimeOptimalLaw):
        without = TimeOptimalLaw(free).duration
    else:
        return ()
    if law.duration <= (1.0 + 1e-3) * without:
        return ()
    return (
        f"{borne_speed(task).cause} makes the motion last {law.duration:.3g} s instead of {without:.3g} s",
    )
