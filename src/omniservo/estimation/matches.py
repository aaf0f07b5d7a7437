"""Matched pixels with their bearings, the input of every step of this room."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from omniservo.cameras import UnifiedCamera
from omniservo.errors import InputError
from omniservo.estimation.minimal_solvers.essential_matrix import bearings_of_pixels
from omniservo.geometry.arrays import BoolArray, FloatArray


class Matches(NamedTuple):
    """Pixels with their bearings, in the arrays that kernels read."""

    parameters: FloatArray
    """of the camera"""
    pixels: FloatArray
    """(n, 4) initial and goal [px]"""
    weights: FloatArray
    """(n, 2) of the residuals in either image: a pixel's σ is σ₀ over its weight"""
    bearings: FloatArray
    """(n, 6)"""
    jacobians: FloatArray
    """(n, 12) bearings by pixels, over the weight: by pixels of equal noise; see `bearings_of_pixels`"""
    noise_px: float
    """σ₀ of a pixel coordinate of weight 1 [px]; 0: not known"""

    @classmethod
    def of_pixels(cls, camera: UnifiedCamera, pixels: FloatArray, noise: FloatArray | None = None) -> Matches:
        """Unproject ``pixels`` (n, 4); ``noise`` (n, 2) is the σ of a coordinate in either image [px].

        Raises:
            InputError: a pixel lies outside the domain in which the camera can be unprojected.
        """
        n = len(pixels)
        bearings, jacobians = np.empty((n, 6)), np.empty((n, 12))
        bad = bearings_of_pixels(camera.parameters, pixels, bearings, jacobians)
        if bad >= 0:
            j, view = divmod(int(bad), 2)
            u, v = pixels[j, 2 * view : 2 * view + 2]
            raise InputError(
                f"pixels_{('initial', 'goal')[view]}: ({u:g}, {v:g}) at index {j} is outside the"
                f" camera's domain (at most {math.degrees(camera.usable_angle):.1f}° from the axis)"
            )
        if noise is None:
            return cls(camera.parameters, pixels, np.ones((n, 2)), bearings, jacobians, 0.0)
        usual = float(np.median(noise))
        weights = usual / noise
        jacobians /= np.repeat(weights, 6, axis=1)
        return cls(camera.parameters, pixels, weights, bearings, jacobians, usual)

    def noisier(self, factor: float) -> Matches:
        """Return the matches with all noise, which is known, so many times as large."""
        return self._replace(noise_px=factor * self.noise_px)

    @property
    def size(self) -> int:
        """How many matches."""
        return len(self.pixels)

    def where(self, members: BoolArray) -> Matches:
        """Return the chosen rows."""
        if members.all():
            return self
        return self._replace(
            pixels=self.pixels[members],
            weights=self.weights[members],
            bearings=self.bearings[members],
            jacobians=self.jacobians[members],
        )


def on_virtual_plane(camera: UnifiedCamera, matches: Matches) -> tuple[Matches, FloatArray]:
    """Return the matches as the perspective camera (K, ξ = 0) sees them, and the pixels' derivative (n, 8).

    The virtual plane (3)-(6) is that camera's image: p = K h / h_z.
    """
    behind = np.argwhere(matches.bearings[:, [2, 5]] <= 0.0)
    if len(behind):
        j, view = (int(x) for x in behind[0])
        raise InputError(
            f"pixels_{('initial', 'goal')[view]}: index {j} is 90° or more from the axis and has no"
            ' image on the virtual plane; method "pixel" works there'
        )
    plane = UnifiedCamera(
        camera.fx, camera.fy, camera.cx, camera.cy, 0.0, camera.width, camera.height, skew=camera.skew
    )
    n = len(matches.pixels)
    pixels, slopes, valid = plane.project_jacobian(matches.bearings.reshape(n, 2, 3))
    if not valid.all():
        raise InputError(f"pixels: index {int(np.argwhere(~valid)[0][0])} has no image on the virtual plane")
    noise = matches.weights[:, :, None, None] * (slopes @ matches.jacobians.reshape(n, 2, 3, 2))
    seen = matches._replace(parameters=plane.parameters, pixels=pixels.reshape(n, 4).copy())
    return seen, noise.reshape(n, 8)
