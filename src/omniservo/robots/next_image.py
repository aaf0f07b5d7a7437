"""The next image of a camera."""

from __future__ import annotations

from collections.abc import Callable

from omniservo.errors import StaleImage
from omniservo.robots.camera_source import CameraImage, CameraSource

_TICK = 1e-3
"""How often is looked [s]."""


def next_image(camera: CameraSource, wait: Callable[[float], None], *, patience: float = 60.0) -> CameraImage:
    """Let time pass until the next frame is delivered, and return it.

    Args:
        camera: its source.
        wait: lets the given time [s] pass.
        patience: so long is waited [s].

    Raises:
        StaleImage: none came.
    """
    before, waited = camera.image(), 0.0
    while waited < patience:
        wait(_TICK)
        waited += _TICK
        image = camera.image()
        if image is not None and (before is None or image.time > before.time):
            return image
    raise StaleImage(f"no new image for {patience:g} s")
