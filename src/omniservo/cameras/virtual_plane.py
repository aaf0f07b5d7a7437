"""The paper's virtual plane: the perspective image Z = 1 that a unified camera implies in front of it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from omniservo.geometry.arrays import BoolArray, FloatArray, finite_array

if TYPE_CHECKING:
    from omniservo.cameras.unified_camera import UnifiedCamera


def to_virtual_plane(camera: UnifiedCamera, pixels: npt.ArrayLike) -> tuple[FloatArray, BoolArray]:
    """Map pixels to the virtual plane, (3)–(6): m = γ m̄ = (X/Z, Y/Z).

    γ = (1 + ξδ)/(1 − ξ²r²), δ = √(1 + (1−ξ²)r²), r = ‖m̄‖. It exists where Z > 0 only, that is r < 1/ξ.
    Noise in pixels grows towards 90°: 3, 25 and 98 times at 60°, 80° and 85° from the axis for the
    paper's camera. Computed from the bearing, which stays exact where 1 − ξ²r² cancels.

    Args:
        camera: any camera.
        pixels: (…, 2) [px].

    Returns:
        points of the plane (…, 2) [1], NaN where not valid; valid (…): Z > 0 and in the domain.
    """
    bearings, seen = camera.unproject(pixels)
    z = bearings[..., 2]
    valid = np.asarray(seen & (z > 0.0))
    with np.errstate(over="ignore"):
        points = bearings[..., :2] / np.where(valid, z, np.nan)[..., None]
    valid &= np.isfinite(points).all(axis=-1)
    points[~valid] = np.nan
    return points, valid


def from_virtual_plane(camera: UnifiedCamera, points: npt.ArrayLike) -> tuple[FloatArray, BoolArray]:
    """Map points (…, 2) of the virtual plane to pixels: the projection of (x, y, 1).

    Returns:
        pixels (…, 2) [px], NaN where not valid; valid (…): in the camera's domain.

    Raises:
        InputError: a point is not finite.
    """
    plane = finite_array("points", points, (-1, 2))
    return camera.project(np.concatenate([plane, np.ones((*plane.shape[:-1], 1))], axis=-1))
