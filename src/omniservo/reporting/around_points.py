"""The part of an image in which its points lie."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle

from omniservo.geometry.arrays import FloatArray


def show_around(axes: Axes, points: FloatArray) -> tuple[FloatArray, FloatArray] | None:
    """Show of the whole image in ``axes`` the part with points (n, 2), with a margin, in its shape.

    Returns:
        Middle and half size of the part, (2,) each [px]; None without a finite point.
    """
    seen = points[np.isfinite(points).all(axis=1)]
    if not len(seen):
        return None
    whole = np.array([abs(a - b) for a, b in (axes.get_xlim(), axes.get_ylim())])
    share = min(1.0, 1.2 * float(np.max(np.ptp(seen, axis=0) / whole)) + 0.06)
    half = 0.5 * share * whole
    middle = np.clip(0.5 * (seen.min(axis=0) + seen.max(axis=0)), half - 0.5, whole - 0.5 - half)
    axes.set_xlim(middle[0] - half[0], middle[0] + half[0])
    axes.set_ylim(middle[1] + half[1], middle[1] - half[1])
    return middle, half


def frame_points(whole: Axes, near: Axes, points: FloatArray) -> None:
    """Enlarge the part with the points in ``near`` and frame it in ``whole``."""
    part = show_around(near, points)
    if part is None:
        return
    centre, half = part
    whole.add_patch(Rectangle(tuple(centre - half), *(2.0 * half), fill=False, edgecolor="white", lw=2.4))
    whole.add_patch(Rectangle(tuple(centre - half), *(2.0 * half), fill=False, edgecolor="black", lw=0.9))
