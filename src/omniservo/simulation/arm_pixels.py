"""Which pixels of a bystander's image the arm may change: those that it may cover or shade."""

from __future__ import annotations

import math

import numpy as np

from omniservo.geometry.arrays import BoolArray, FloatArray, IntArray

_CELLS = 512
"""per side of the lamp's view, which is π wide"""
_ROOM = 2
"""pixels and cells round a ball: neighbours of what changes are drawn anew, too"""


class ArmPixels:
    """What stands still is drawn once; what the arm covers or shades lies in the balls round its shapes.

    A ball lies, as it is seen from a point, within an interval of angles to the right and of angles down.
    From the eye that is a rectangle of pixels. From the lamp it is one of cells of a grid; each pixel that
    meets something has its cell.
    """

    def __init__(
        self,
        eye: tuple[FloatArray, FloatArray],
        focal: float,
        lamp: tuple[FloatArray, FloatArray],
        lamp_radius: float,
        points: FloatArray,
    ) -> None:
        """Prepare.

        Args:
            eye: where it is (3,) [m], and its axes right, down, forward as columns (3, 3).
            focal: [px]
            lamp: as ``eye``.
            lamp_radius: of the disc that shines [m].
            points: (height, width, 3) what the pixels meet without the arm [m]; NaN: nothing.
        """
        self._eye, self._focal, self._lamp, self._lamp_radius = eye, focal, lamp, lamp_radius
        self._shape = points.shape[:2]
        right, down, ahead = np.moveaxis((points - lamp[0]) @ lamp[1], -1, 0)
        before = ahead > 0.0  # comparisons with NaN are False
        columns, rows = (_cells(np.arctan2(across[before], ahead[before])) for across in (right, down))
        self._cells: IntArray = np.full(self._shape, _CELLS**2)  # no cell
        self._cells[before] = rows * _CELLS + columns

    def of(self, centers: FloatArray, radii: FloatArray) -> BoolArray:
        """Return the pixels (height, width) that balls at centres (k, 3) of radii (k,) [m] may change."""
        height, width = self._shape
        middle = np.array([(width - 1) / 2.0, (height - 1) / 2.0])
        changed, shaded = np.zeros(self._shape, dtype=bool), np.zeros((_CELLS, _CELLS), dtype=bool)
        _mark(changed, self._focal * np.tan(_angles(*self._eye, centers, radii)) + middle)
        _mark(shaded, _cells(_angles(*self._lamp, centers, radii + self._lamp_radius)))
        changed |= np.append(shaded.ravel(), False)[self._cells]
        return changed


def _angles(origin: FloatArray, axes: FloatArray, centers: FloatArray, radii: FloatArray) -> FloatArray:
    """Return from where to where each ball is seen, (2, k, 2) in [−π/2, π/2]: to the right, and down."""
    right, down, ahead = ((centers - origin) @ axes).T
    across = np.stack([right, down], axis=-1)
    reach = np.hypot(across, ahead[:, None])
    half = np.where(reach > radii[:, None], np.arcsin(np.minimum(radii[:, None] / reach, 1.0)), math.pi)
    middle = np.arctan2(across, ahead[:, None])
    most = math.pi / 2.0 - 1e-6
    spans: FloatArray = np.clip(np.stack([middle - half, middle + half]), -most, most)
    return spans


def _cells(angles: FloatArray) -> IntArray:
    return ((angles / math.pi + 0.5) * _CELLS).astype(np.int64).clip(0, _CELLS - 1)


def _mark(image: BoolArray, spans: FloatArray | IntArray) -> None:
    """Set the rectangles from ``spans[0]`` to ``spans[1]``, (k, 2) columns and rows."""
    height, width = image.shape
    first = np.clip(np.floor(spans[0]) - _ROOM, 0, [width, height]).astype(int)
    last = np.clip(np.ceil(spans[1]) + _ROOM + 1, 0, [width, height]).astype(int)
    for (left, top), (right, bottom) in zip(first, last, strict=True):
        image[top:bottom, left:right] = True
