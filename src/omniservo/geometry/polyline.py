"""How far a place is from a line of straight pieces."""

from __future__ import annotations

import numpy as np

from omniservo.geometry.arrays import FloatArray


def offsets_from_line(line: FloatArray, place: FloatArray) -> FloatArray:
    """Return, for each piece of a line, the vector from its point nearest to ``place`` to ``place``.

    Args:
        line: (k, n), straight between one and the next.
        place: (n,).

    Returns:
        (k − 1, n); the shortest is that of the line.
    """
    steps, before = np.diff(line, axis=0), place - line[:-1]
    length = np.maximum((steps**2).sum(axis=1), 1e-300)
    share = np.clip((before * steps).sum(axis=1) / length, 0.0, 1.0)
    return np.asarray(before - share[:, None] * steps)
