"""How fast a planned camera path may be run through by this arm."""

from __future__ import annotations

import numpy as np

from omniservo.planning import CameraPath
from omniservo.runs.own_branch import own_branch
from omniservo.servoing import ExponentialLaw, RestToRestLaw
from omniservo.simulation.scene import Scene
from omniservo.tasks import Task

LEAST_DURATION = 4.0
"""[s]: slow enough for a person to watch, and for 30 frames a second."""

JOINT_SHARE = 0.5
"""share of the arm's joint speed and acceleration that the path may use; the rest is left to feedback"""

_SAMPLES = 201


def pace(task: Task, scene: Scene, path: CameraPath) -> RestToRestLaw | ExponentialLaw:
    """Return the task's time law; the rest-to-rest law gets the shortest legal duration unless one is stated.

    Raises:
        AnswerIsNo: the arm cannot follow the path from where it stands.
    """
    joints = own_branch(task, scene, path)
    if task.servo.time_law == "exponential":
        return ExponentialLaw(task.servo.rate)
    if task.servo.duration is not None:
        return RestToRestLaw(task.servo.duration)
    w = np.linspace(0.0, 1.0, _SAMPLES)
    return RestToRestLaw.for_limits(
        w,
        joints(w, 1),
        joints(w, 2),
        JOINT_SHARE * scene.arm.joint_speed,
        JOINT_SHARE * scene.arm.joint_acceleration,
        least_duration=LEAST_DURATION,
    )
