"""What is added to the planned features on the way, so that they end on the goal image's."""

from __future__ import annotations

import numpy as np

from omniservo.geometry.arrays import FloatArray

BLEND_START = 0.5
"""From this w on the reference turns from the planned points' features to those of the goal image."""


class GoalBlend:
    """o(w) = Σ β((w − w_k)/(1 − w_k)) Δ_k, β(x) = 10x³ − 15x⁴ + 6x⁵: at w = 1 all of what was required last.

    Every change Δ_k of what is required comes in smoothly from where it became known, or from w = 1/2 on,
    so that neither o nor its slope has a jump.

    Args:
        offsets: (n, 3) required at first.
    """

    def __init__(self, offsets: FloatArray) -> None:
        self._changes = [(BLEND_START, offsets.copy())]

    def change_to(self, offsets: FloatArray, w: float) -> None:
        """Ask for other offsets (n, 3) from ``w`` on."""
        change = offsets - np.sum([known for _, known in self._changes], axis=0)
        begin = max(w, BLEND_START)
        if begin == self._changes[-1][0]:
            begin, last = self._changes.pop()
            change = change + last
        self._changes.append((begin, change))

    def at(self, w: float) -> tuple[FloatArray, FloatArray]:
        """Return o(w) and do/dw, (n, 3) each."""
        shape = self._changes[0][1].shape
        value, slope = np.zeros(shape), np.zeros(shape)
        for begin, change in self._changes:
            if w <= begin < 1.0:
                continue
            rise, growth = _rise(w, begin)
            if rise != 0.0:
                value += rise * change
                slope += growth * change
        return value, slope


def _rise(w: float, begin: float) -> tuple[float, float]:
    """Return β and dβ/dw."""
    if w >= 1.0 or begin >= 1.0:
        return 1.0, 0.0
    x = max((w - begin) / (1.0 - begin), 0.0)
    rest = 1.0 - x
    return x * x * x * (10.0 + x * (6.0 * x - 15.0)), 30.0 * x * x * rest * rest / (1.0 - begin)
