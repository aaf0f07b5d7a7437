"""What gives the images of a camera, real or simulated: its newest frame and when that was exposed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import ByteArray


@with_field_docs
@dataclass(frozen=True)
class CameraImage:
    """One frame of the camera on the flange."""

    time: float
    """instant of exposure on the robot's clock [s]; the frame is delivered later"""
    pixels: ByteArray
    """(height, width) grey values"""
    time_sigma: float = 0.0
    """standard deviation of ``time`` [s]; 0 where camera and joints share a clock"""

    @property
    def earliest(self) -> float:
        """When it was exposed at the earliest: ``time`` less three standard deviations [s]."""
        return self.time - 3.0 * self.time_sigma


@runtime_checkable
class CameraSource(Protocol):
    """A camera that sits on an arm's flange."""

    def image(self) -> CameraImage | None:
        """Return the newest delivered frame, without waiting; None before the first one arrives."""
        ...

    def close(self) -> None:
        """End the connection to the camera; a second call does nothing."""
        ...
