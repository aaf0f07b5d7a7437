"""A camera whose stamps are corrected by what was measured of them."""

from __future__ import annotations

import math
from dataclasses import replace

from omniservo.hardware.clock_map import ClockMap
from omniservo.robots import CameraImage, CameraSource


class ShiftedCamera:
    """A `CameraSource` with an offset added to the stamps of another.

    Args:
        camera: the other.
        offset: added to the time of its images [s].
        sigma: standard deviation of that [s]; it makes the images' times as uncertain.
    """

    def __init__(self, camera: CameraSource, offset: float, sigma: float = 0.0) -> None:
        self._camera, self._offset, self._sigma = camera, offset, sigma

    def image(self) -> CameraImage | None:
        """Return the newest delivered frame; None before the first one arrives."""
        image = self._camera.image()
        if image is None:
            return None
        sigma = math.hypot(image.time_sigma, self._sigma)
        return replace(image, time=image.time + self._offset, time_sigma=sigma)

    @property
    def notice(self) -> str | None:
        """What the other assumes of its images' times, in words; None where nothing is."""
        found: str | None = getattr(self._camera, "notice", None)
        return found

    @property
    def clock(self) -> ClockMap | None:
        """The other's, from stamps to this machine's time, without the offset; None: it has none."""
        found: ClockMap | None = getattr(self._camera, "clock", None)
        return found

    def close(self) -> None:
        """End the connection to the camera; a second call does nothing."""
        self._camera.close()
