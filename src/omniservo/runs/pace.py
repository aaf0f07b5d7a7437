"""How fast a planned camera path may be run through by this arm."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import CubicSpline

from omniservo.errors import AnswerIsNo, InputError
from omniservo.geometry.arrays import FloatArray
from omniservo.planning import CameraPath
from omniservo.servoing import ExponentialLaw, RestToRestLaw
from omniservo.simulation.scene import Scene
from omniservo.tasks import Task

LEAST_DURATION = 4.0
"""[s]: slow enough for a person to watch, and for 30 frames a second."""

JOINT_SHARE = 0.5
"""share of the arm's joint speed and acceleration that the path may use; the rest is left to feedback"""

_SAMPLES = 81


def pace(task: Task, scene: Scene, path: CameraPath) -> RestToRestLaw | ExponentialLaw:
    """Return the task's time law; the rest-to-rest law gets the shortest legal duration unless one is stated.

    Raises:
        AnswerIsNo: the arm cannot follow the path: it leaves its reach or its joint range.
    """
    w = np.linspace(0.0, 1.0, _SAMPLES)
    joints = joint_path(task, scene, path, w)
    if task.servo.time_law == "exponential":
        return ExponentialLaw(task.servo.rate)
    if task.servo.duration is not None:
        return RestToRestLaw(task.servo.duration)
    spline = CubicSpline(w, joints)
    return RestToRestLaw.for_limits(
        w,
        spline(w, 1),
        spline(w, 2),
        JOINT_SHARE * scene.arm.joint_speed,
        JOINT_SHARE * scene.arm.joint_acceleration,
        least_duration=LEAST_DURATION,
    )


def joint_path(task: Task, scene: Scene, path: CameraPath, w: FloatArray) -> FloatArray:
    """Return the joints (len(w), n) [rad] that carry the camera along the path, on the start's branch.

    Raises:
        AnswerIsNo: no joints within their range reach a pose on the path.
    """
    world_T_initial = task.start.world_T_camera.transform
    joints = scene.start_joints
    rows = []
    for value, initial_T_camera in zip(w, path(w), strict=True):
        try:
            joints = scene.joints_for(world_T_initial * initial_T_camera, joints)
        except InputError as error:
            raise AnswerIsNo(f"the arm cannot follow the planned path at w = {value:.2f}: {error}") from None
        rows.append(joints)
    return np.array(rows)
