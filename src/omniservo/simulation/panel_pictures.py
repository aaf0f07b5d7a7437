"""What a pixel sees of a printed image: the mean grey over its footprint, however small or large."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.geometry.arrays import BoolArray, FloatArray, IntArray
from omniservo.geometry.kernel import leaf
from omniservo.scenes.panel import Panel

_LEAST_SIDE = 0.01  # [picture elements] a smaller rectangle's sum would drown in rounding


class _Sums(NamedTuple):
    """Summed-area tables of k panels' images."""

    density: FloatArray
    """(k, 2) image elements per length along x and y [1/m]"""
    shapes: IntArray
    """(k, 2) rows and columns of the images"""
    starts: IntArray
    """(k + 1,) where each one's table starts"""
    table: FloatArray
    """all of them, one behind the other; linear grey"""


class Footprints(NamedTuple):
    """Pixels as rays: each one's direction and how it changes to the right and downwards."""

    directions: FloatArray
    """(n, 3) through the pixels' centres, of any length"""
    right: FloatArray
    """(n, 3) ∂direction/∂u [1/px]"""
    down: FloatArray
    """(n, 3) ∂direction/∂v [1/px]"""

    def at(self, chosen: BoolArray | IntArray) -> Footprints:
        """Return the chosen ones, by index or mask."""
        return Footprints(self.directions[chosen], self.right[chosen], self.down[chosen])


class PanelPictures:
    """The images of a world's panels, ready to be averaged.

    An image is piecewise constant, so its integral over any rectangle follows exactly from a table of its
    running sums (Crow 1984, summed-area tables). A pixel's square, cut into tiles, maps to the panel tile by
    tile; each tile's image is replaced by the rectangle with the same second moments along the image's
    axes. Sub-pixel positions are kept and minified detail cannot alias.
    """

    def __init__(self, panels: Sequence[Panel]) -> None:
        """Sum the images of ``panels``, which are distinguished by their index."""
        self._poses = [panel.world_T_panel for panel in panels]
        tables = [np.pad(p.picture, ((1, 0), (1, 0))).cumsum(0).cumsum(1).ravel() for p in panels]
        self._sums = _Sums(
            np.array([np.array(p.picture.shape[::-1]) / p.size for p in panels]),
            np.array([panel.picture.shape for panel in panels], dtype=np.int64),
            np.cumsum([0, *(table.size for table in tables)], dtype=np.int64),
            np.concatenate([*tables, np.zeros(1)]),
        )

    def greys(
        self, world_T_eye: RigidTransform, panels: IntArray, pixels: Footprints, per_side: int
    ) -> FloatArray:
        """Return the mean linear grey (n,) over each pixel's square.

        Args:
            world_T_eye: the frame of the footprints; its origin is where all rays start.
            panels: (n,) which panel each pixel looks at, from its front.
            pixels: the rays.
            per_side: tiles along a side of a pixel.
        """
        greys = np.empty(len(panels))
        poses = [pose.inv() * world_T_eye for pose in self._poses]
        _mean_greys(
            panels,
            pixels,
            np.array([pose.rotation.as_matrix() for pose in poses]),
            np.array([pose.translation for pose in poses]),
            self._sums,
            per_side,
            greys,
        )
        return greys


@leaf
def _mean_greys(
    panels: IntArray,
    pixels: Footprints,
    turns: FloatArray,
    eyes: FloatArray,
    sums: _Sums,
    per_side: int,
    greys: FloatArray,
) -> None:
    """Fill ``greys``: turns (k, 3, 3) and eyes (k, 3) are the panel_T_eye of each panel."""
    density = sums.density
    for i in range(len(panels)):
        k = panels[i]
        rows, columns = sums.shapes[k, 0], sums.shapes[k, 1]
        x, y, z = _turned(turns[k], pixels.directions[i])
        rx, ry, rz = _turned(turns[k], pixels.right[i])
        dx, dy, dz = _turned(turns[k], pixels.down[i])
        far = -eyes[k, 2] / z
        width = math.hypot(rx - x * rz / z, dx - x * dz / z) * far * density[k, 0] / per_side
        height = math.hypot(ry - y * rz / z, dy - y * dz / z) * far * density[k, 1] / per_side
        width, height = 0.5 * max(width, _LEAST_SIDE), 0.5 * max(height, _LEAST_SIDE)
        total, count = 0.0, 0
        for tile in range(per_side * per_side):
            u = (tile % per_side + 0.5) / per_side - 0.5
            v = (tile // per_side + 0.5) / per_side - 0.5
            depth = z + u * rz + v * dz
            if depth > 0.0:
                far = -eyes[k, 2] / depth
                column = (eyes[k, 0] + far * (x + u * rx + v * dx)) * density[k, 0] + 0.5 * columns
                row = (eyes[k, 1] + far * (y + u * ry + v * dy)) * density[k, 1] + 0.5 * rows
                total += _mean(sums.table, sums.starts[k], rows, columns, column, row, width, height)
                count += 1
        greys[i] = total / max(count, 1)


@leaf
def _turned(turn: FloatArray, v: FloatArray) -> tuple[float, float, float]:
    return (
        turn[0, 0] * v[0] + turn[0, 1] * v[1] + turn[0, 2] * v[2],
        turn[1, 0] * v[0] + turn[1, 1] * v[1] + turn[1, 2] * v[2],
        turn[2, 0] * v[0] + turn[2, 1] * v[1] + turn[2, 2] * v[2],
    )


@leaf
def _mean(
    table: FloatArray,
    start: int,
    rows: int,
    columns: int,
    column: float,
    row: float,
    half_width: float,
    half_height: float,
) -> float:
    """Mean over the part of a rectangle round (column, row) that lies on the image."""
    left, right = _within(column, half_width, columns)
    top, bottom = _within(row, half_height, rows)
    total = (
        _sum_before(table, start, rows, columns, right, bottom)
        - _sum_before(table, start, rows, columns, left, bottom)
        - _sum_before(table, start, rows, columns, right, top)
        + _sum_before(table, start, rows, columns, left, top)
    )
    return total / ((right - left) * (bottom - top))


@leaf
def _within(middle: float, half: float, length: int) -> tuple[float, float]:
    """The interval, cut off at 0 and length, but never shorter than the least side."""
    low = min(max(middle - half, 0.0), length - _LEAST_SIDE)
    return low, max(min(middle + half, float(length)), low + _LEAST_SIDE)


@leaf
def _sum_before(table: FloatArray, start: int, rows: int, columns: int, column: float, row: float) -> float:
    """Integral of the image over [0, column] × [0, row]: linear in each between the running sums."""
    i, j = min(int(row), rows - 1), min(int(column), columns - 1)
    a, b = row - i, column - j
    at = start + i * (columns + 1) + j
    above: float = (1.0 - b) * table[at] + b * table[at + 1]
    below: float = (1.0 - b) * table[at + columns + 1] + b * table[at + columns + 2]
    return (1.0 - a) * above + a * below
