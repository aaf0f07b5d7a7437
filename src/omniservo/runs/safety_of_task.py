"""What a task's robot may do."""

import numpy as np

from omniservo.runs.arm_setting_of import tube_of
from omniservo.safety import SafetyOptions
from omniservo.tasks import Task

FRAMES_MISSED = 3
"""So many frames may be missed before the robot is stopped."""

STEP_SHARE = 0.5
"""Share of its way to an image limit that a point may go within a frame."""

WORKSPACE_ROOM = 0.03
"""The robot is stopped where the camera could not be held this near to the planned workspace [m]: the plan
keeps inside it, its execution and the distance in which the supervisor can brake reach a little farther."""


def safety_of_task(task: Task) -> SafetyOptions:
    """Return the defaults, but of a slow camera for its rate, and with what the task keeps free.

    What its plan keeps for tracking is what the camera may be off its path while it moves without images.
    """
    sensor, box = task.sensor, task.planning.workspace
    default, tube = SafetyOptions(), tube_of(task)
    return SafetyOptions(
        image_age=max(default.image_age, sensor.latency + FRAMES_MISSED / sensor.rate),
        blind_room=task.planning.tracking_margin if tube is None else tube.position,
        visibility_rate=min(default.visibility_rate, STEP_SHARE * sensor.rate),
        exposure=sensor.exposure,
        readout=sensor.readout,
        workspace=None if box is None else box.bounds + np.array([[-WORKSPACE_ROOM], [WORKSPACE_ROOM]]),
    )
