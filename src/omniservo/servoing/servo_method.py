"""A servo method without a plan: measurement in, twist out."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from omniservo.geometry.arrays import FloatArray
from omniservo.servoing.servo_measurement import ServoMeasurement


@runtime_checkable
class ServoMethod(Protocol):
    """Leads the camera to the goal image by what each image shows."""

    def step(self, seen: ServoMeasurement) -> FloatArray:
        """Return the camera twist (6,): linear [m/s] and angular [rad/s], in the camera frame.

        Raises:
            ServoStop: there is no twist to stand for, such as `FeatureLoss`.
        """
        ...
