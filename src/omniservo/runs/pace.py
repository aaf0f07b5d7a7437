"""How fast a planned camera path may be run through by this arm."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import numpy as np

from omniservo.errors import NoSolutionError
from omniservo.geometry.arrays import FloatArray
from omniservo.planning import CameraPath, Plan
from omniservo.robots import Arm, JointPath
from omniservo.runs.own_branch import every_branch, own_branch
from omniservo.scenes.scene import Scene
from omniservo.servoing import (
    ExponentialLaw,
    PathLimits,
    RestToRestLaw,
    TimeLaw,
    TimeOptimalLaw,
    image_speed,
)
from omniservo.tasks import Task
from omniservo.tracking.planned_motion import PlannedMotion

LEAST_DURATION = 4.0
"""[s] of the rest-to-rest law: slow enough for a person to watch, and for 30 frames a second."""

JOINT_SHARE = 0.5
"""share of the arm's joint speed and acceleration that the path may use; the rest is left to feedback"""

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
    return PlannedMotion(
        arm=scene.arm,
        joints=joints,
        law=_law(task, limits, limits_of(task, scene.arm, plan.path, joints, points, share=1.0)),
        limits=limits,
        time_optimal_seconds=TimeOptimalLaw(limits).duration,
        others=every_branch(task, scene, plan.path),
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
    """Return a share of the arm's limits, and the task's image speed, along the joints that follow a path.

    Args:
        task: states the image speed, if one is.
        arm: states the others.
        path: of the camera, in the frame of the points.
        joints: that follow it.
        points: (n, 3) [m].
        share: of joint speeds and accelerations.
    """
    pixels = _image_speed_limit(task, path, points)
    return PathLimits(joints, share * arm.joint_speed, share * arm.joint_acceleration, pixels)


def _image_speed_limit(task: Task, path: CameraPath, points: FloatArray) -> _PathSpeed | None:
    """Return what the task's image speed lets ẇ be, a function of w; None where it states none."""
    top = task.servo.image_speed
    if top is None:
        return None

    def path_speed(w: FloatArray) -> FloatArray:
        with np.errstate(divide="ignore"):
            found: FloatArray = np.float64(top) / image_speed(task.camera, path, points, w)
        return found

    return path_speed


def _law(task: Task, limits: PathLimits, arms_own: PathLimits) -> TimeLaw:
    servo = task.servo
    if servo.time_law == "exponential":
        return ExponentialLaw(servo.rate)
    if servo.time_law == "time-optimal":
        return TimeOptimalLaw(limits)
    if servo.duration is None:
        return RestToRestLaw.for_limits(limits, least_duration=LEAST_DURATION)
    least = RestToRestLaw.for_limits(arms_own, least_duration=1e-3).duration
    if servo.duration < least:
        bound = "the arm's limits" if servo.image_speed is None else "the arm's limits and servo.image_speed"
        raise NoSolutionError(
            f"servo.duration: {servo.duration:g} s given; {bound} need {least:.3g} s at least"
        )
    return RestToRestLaw(servo.duration)
