"""How fast the target may move through the image, so that the camera's exposure and read-out are borne."""

from __future__ import annotations

import math
from typing import NamedTuple

from omniservo.runs.feature_kind_of import feature_kind_of
from omniservo.tasks import Task

MOST_SKEW = 10.0
"""[px] that a point may move between the first row of a rolling shutter and the last"""


class BorneSpeed(NamedTuple):
    """The least of what bounds it."""

    speed: float
    """[px/s]; infinite where nothing does"""
    cause: str
    """in words"""


def borne_speed(task: Task) -> BorneSpeed:
    """Return the greatest speed of a point in the image, by the task's image speed and its sensor's times."""
    sensor, bounds = task.sensor, [BorneSpeed(math.inf, "the arm's limits")]
    if task.servo.image_speed is not None:
        bounds.append(BorneSpeed(task.servo.image_speed, "servo.image_speed"))
    if sensor.exposure > 0.0:
        kind = feature_kind_of(task)
        bounds.append(
            BorneSpeed(
                kind.most_blur / sensor.exposure,
                f"motion blur (an exposure of {1e3 * sensor.exposure:g} ms, in which {kind.name} may move "
                f"{kind.most_blur:g} px)",
            )
        )
    if sensor.readout > 0.0:
        bounds.append(
            BorneSpeed(
                MOST_SKEW / sensor.readout,
                f"a rolling shutter (a readout of {1e3 * sensor.readout:g} ms, in which points may move "
                f"{MOST_SKEW:g} px)",
            )
        )
    return min(bounds)
