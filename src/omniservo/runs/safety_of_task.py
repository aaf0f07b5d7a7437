"""What a task's robot may do."""

import numpy as np

from omniservo.runs.arm_setting_of import tracking_room_of
from omniservo.safety import SafetyOptions
from omniservo.tasks import Task

FRAMES_MISSED = 3
"""So many frames may be missed before the robot is stopped."""

STEP_SHARE = 0.5
"""Share of its way to an image limit that a point may go within a frame."""

WORKSPACE_ROOM = 0.03
"""The robot is stopped where the camera could not be held this near to the planned workspace [m]: the plan
keeps inside it, its execution and the distance in which the supervisor can brake reach a little farther."""

_WIDER = WORKSPACE_ROOM * np.array([[-1.0], [1.0]])


def safety_of_task(task: Task) -> SafetyOptions:
    """Return the defaults, but of a slow camera for its rate, and with what the task keeps free.

    What its plan keeps for tracking is what the camera may be off its path while it moves without images.
    """
    sensor, box, default = task.sensor, task.planning.workspace, SafetyOptions()
    return SafetyOptions(
        image_age=image_age_of(sensor.rate, sensor.latency),
        blind_room=tracking_room_of(task),
        path_room=path_room_of(task),
        visibility_rate=min(default.visibility_rate, STEP_SHARE * sensor.rate),
        exposure=sensor.exposure,
        readout=sensor.readout,
        workspace=None if box is None else np.array([box.min, box.max]) + _WIDER,
        found_T_workspace=None if box is None else box.transform,
    )


def image_age_of(rate: float, latency: float) -> float:
    """Return how old an image may be to be acted on [s].

    Args:
        rate: frames a second [Hz].
        latency: from the middle of an exposure until the image is there [s].
    """
    return max(SafetyOptions().image_age, latency + FRAMES_MISSED / rate)


def path_room_of(task: Task) -> float | None:
    """Return how far off its path the joints may have the camera [m]; None: they are not watched for it.

    Every plan, one that is made on the way too, keeps what is for tracking, and besides ``arm_clearance``
    between the arm's bodies and what stands around: so far off, the camera touches nothing. A link that moves
    more than the camera does is watched by `TaskGaps`. Where no bodies are planned for, ``clearance`` stands
    for the camera's own size and is no room. Where a task knows of nothing around that could be hit, the
    camera may follow a target that was moved.
    """
    planning = task.planning
    room = tracking_room_of(task) + (planning.arm_clearance or 0.0)
    return room if room > 0.0 and (planning.obstacles or task.surroundings) else None
