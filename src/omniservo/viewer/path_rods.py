"""A path in the scene: short rods, end to end along it."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from omniservo.geometry.arrays import FloatArray
from omniservo.simulation.body_meshes import capsule
from omniservo.viewer.lit_triangles import lit_triangles

Colour = tuple[int, int, int]

_RODS = 16

_SIDES = (4, 6)
"""along and round a rod: they are a few pixels"""

_LONGER = 1.3
"""than the part of the path that it covers is a new rod: paths that are a little longer have no gaps"""

_SHORTER = 0.4
"""The same of a rod in whose place another is made."""


class PathRods:
    """Rods that are put along one path after the other, in one of a few colours.

    There are rods of each colour, of which one's are visible: the browser moves and shows nodes in the frame
    in which it takes the message; another line, or another colour, is there a frame later.

    Args:
        scene: viser's.
        name: of its nodes.
        radius: [m].
        colours: that it can have (sRGB).
    """

    def __init__(self, scene: Any, name: str, radius: float, colours: tuple[Colour, ...]) -> None:
        self._scene, self._radius, self._length = scene, radius, 0.0
        self._names = {colour: f"{name}/{number}" for number, colour in enumerate(colours)}
        self._groups: dict[Colour, Any] = {}
        self._rods: dict[Colour, list[Any]] = {}

    def show(self, places: FloatArray, colour: Colour) -> None:
        """Put it along places (m, 3) in the world [m], between which it is straight."""
        ends = _evenly(places)
        parts = np.diff(ends, axis=0)
        longest = max(float(np.linalg.norm(parts, axis=1).max()), self._radius / _LONGER)
        if not _SHORTER * self._length <= longest <= self._length:
            self._make(_LONGER * longest)
        for known, group in self._groups.items():
            group.visible = known == colour
        middles, turns = 0.5 * (ends[1:] + ends[:-1]), _turns_to(parts)
        for rod, middle, turn in zip(self._rods[colour], middles, turns, strict=True):
            rod.position, rod.wxyz = middle, turn

    def _make(self, length: float) -> None:
        """Have rods of another length [m]."""
        self._length = length
        shape = capsule(self._radius, length, _SIDES)
        for colour, name in self._names.items():
            self._groups[colour] = self._scene.add_frame(name, show_axes=False, visible=False)
            file = lit_triangles([(shape, colour)], Rotation.identity())
            self._rods[colour] = [self._scene.add_glb(f"{name}/{k}", file) for k in range(_RODS)]


def _turns_to(directions: FloatArray) -> FloatArray:
    """Return quaternions (n, 4), scalar first, that take z to directions (n, 3) of any length."""
    lengths = np.linalg.norm(directions, axis=1, keepdims=True)
    x, y, z = (directions / np.maximum(lengths, 1e-12)).T
    halfway = np.stack([1.0 + z, -y, x, np.zeros_like(x)], axis=-1)
    halfway[1.0 + z < 1e-9] = [0.0, 1.0, 0.0, 0.0]
    found: FloatArray = halfway / np.linalg.norm(halfway, axis=1, keepdims=True)
    return found


def _evenly(places: FloatArray) -> FloatArray:
    """Return as many places (n, 3) of a way as rods have ends, as far from each other along it."""
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1))])
    wanted = np.linspace(0.0, way[-1], _RODS + 1)
    return np.stack([np.interp(wanted, way, column) for column in places.T], axis=-1)
