"""Saying in words where a camera's formula stops being one-to-one inside its image."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from omniservo.geometry.arrays import FloatArray

if TYPE_CHECKING:
    from omniservo.cameras.models.central_model import CentralModel

_STEPS = 96
"""pixels sampled along each side of the image"""


def domain_warnings(camera: CentralModel) -> tuple[str, ...]:
    """Return a sentence where the model, not the lens, ends the camera's view inside the image; else nothing.

    The image is sampled on a grid that includes its border.
    """
    if camera.max_angle is not None and camera.usable_angle >= camera.max_angle:
        return ()
    pixels = image_grid(camera, _STEPS)
    lost = camera.in_image(pixels) & ~camera.unproject(pixels)[1]
    if not lost.any():
        return ()
    middle, seen = camera.project(np.array([0.0, 0.0, 1.0]))
    distance = np.hypot(*(pixels[lost] - middle).T).min() if seen else math.nan
    share = 100.0 * lost.sum() / camera.in_image(pixels).sum()
    return (
        f"the {camera.to_dict()['model']} formula is one-to-one only up to "
        f"{math.degrees(camera.usable_angle):.3f} deg from the axis, which is inside the image: "
        f"{share:.2g}% of it, from {distance:.0f} px off the principal point outwards, cannot be used",
    )


def image_grid(camera: CentralModel, steps: int) -> FloatArray:
    """Return steps² pixels (n, 2) that cover the image evenly, its border included [px]."""
    u = np.linspace(-0.5, camera.width - 0.5, steps)
    v = np.linspace(-0.5, camera.height - 0.5, steps)
    return np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
