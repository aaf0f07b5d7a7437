"""A core of a simple shape; a body is all that is at most ``radius`` away from its core."""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.planning.constraints.body_gap import CUBOID, CYLINDER, ELLIPSOID

_CORNERS = np.array(list(product((-1.0, 1.0), repeat=3)))
_AROUND = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)


class Core(NamedTuple):
    """A core and the radius about it, as a row of `body_gap` states them."""

    center: FloatArray
    """(3,) [m]"""
    axes: FloatArray
    """(3, 3) unit axes, row by row"""
    half_extents: FloatArray
    """(3,) along them [m]"""
    radius: float = 0.0
    """[m]"""
    shape: float = CUBOID
    """see `body_gap`"""
    vertices: FloatArray | None = None
    """of a hull (n, 3) [m]"""

    def outline(self) -> tuple[FloatArray, float]:
        """Return points (k, 3) whose hull, wider by a radius, is the body [m]: what drawings need.

        Of what is round the points lie on the surface, closer together than 8° seen from the axis.
        """
        if self.vertices is not None:
            return self.vertices, self.radius
        own = _CORNERS
        if self.shape == CYLINDER:
            ring = np.column_stack([np.cos(_AROUND), np.sin(_AROUND)])
            own = np.vstack([np.column_stack([np.full(len(ring), end), ring]) for end in (-1.0, 1.0)])
        elif self.shape == ELLIPSOID:
            own = unit_sphere()
        points = self.center + (own * self.half_extents) @ self.axes
        return np.unique(points, axis=0), self.radius


def unit_sphere() -> FloatArray:
    """Return points (k, 3) all over the unit sphere."""
    polar, around = np.meshgrid(np.linspace(0.0, np.pi, 25), _AROUND, indexing="ij")
    grid = np.stack([np.sin(polar) * np.cos(around), np.sin(polar) * np.sin(around), np.cos(polar)], axis=-1)
    return np.asarray(grid.reshape(-1, 3), dtype=np.float64)


def axes_of(quaternion: FloatArray) -> FloatArray:
    """Return a body's axes, row by row (3, 3): columns of Λ(q)/‖q‖² (20), within 10 roundings each."""
    x, y, z, w = quaternion
    rows = [
        [x * x - y * y - z * z + w * w, 2 * (x * y + z * w), 2 * (x * z - y * w)],
        [2 * (x * y - z * w), -x * x + y * y - z * z + w * w, 2 * (y * z + x * w)],
        [2 * (x * z + y * w), 2 * (y * z - x * w), -x * x - y * y + z * z + w * w],
    ]
    axes: FloatArray = np.array(rows) / (x * x + y * y + z * z + w * w)
    return axes


def along_segment(start: FloatArray, end: FloatArray) -> tuple[FloatArray, FloatArray, float]:
    """Return a segment's middle (3,), axes (3, 3) of which the first points along it, half its length."""
    half = 0.5 * (end - start)
    length = float(np.linalg.norm(half))
    first = half / length if length > 0.0 else np.array([1.0, 0.0, 0.0])
    across = np.cross(first, np.eye(3)[int(np.argmin(np.abs(first)))])
    second = across / np.linalg.norm(across)
    return start + half, np.array([first, second, np.cross(first, second)]), length
