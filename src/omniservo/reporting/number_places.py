"""Where the numbers of points stand in an image, so that they do not cover each other."""

from __future__ import annotations

import numpy as np

from omniservo.geometry.arrays import FloatArray

HEIGHT = 8.0
"""of a number [pt]"""
_WIDTH = 5.6
"""of a digit [pt]"""
_AWAY = (10.0, 15.0)
"""distances of a number's middle from its point that are tried [pt]"""
_RING = 4.0
"""radius of the ring around a point [pt]"""


def number_places(points: FloatArray) -> list[FloatArray | None]:
    """Return for points (n, 2) [pt] the middle (2,) of each one's number, its row; None: there is no room.

    A place is free if it covers no number set before and no ring. Points that are not finite get none.
    """
    angles = np.pi / 4.0 * np.array([1, 3, 7, 5, 0, 2, 4, 6])
    around = np.concatenate([r * np.column_stack([np.cos(angles), np.sin(angles)]) for r in _AWAY])
    seen = points[np.isfinite(points).all(axis=1)]
    placed, half_sizes = np.zeros((0, 2)), np.zeros((0, 2))
    found: list[FloatArray | None] = []
    for number, point in enumerate(points):
        half = np.array([0.5 * _WIDTH * len(str(number)), 0.5 * HEIGHT])
        places = point + around
        off_rings = np.abs(places[:, None] - seen) - half - _RING
        off_numbers = np.abs(places[:, None] - placed) - half - half_sizes
        room = np.minimum(
            off_rings.max(axis=2).min(axis=1, initial=np.inf),
            off_numbers.max(axis=2).min(axis=1, initial=np.inf),
        )
        free = np.flatnonzero(room >= 0.0)
        if not len(free):
            found.append(None)
            continue
        found.append(places[free[0]])
        placed, half_sizes = np.vstack([placed, places[free[0]]]), np.vstack([half_sizes, half])
    return found
