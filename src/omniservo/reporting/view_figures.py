"""Small figures of what has no report of its own: where views are, and what is left in images."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from scipy.spatial.transform import RigidTransform

from omniservo.geometry.arrays import FloatArray
from omniservo.reporting.style import EXECUTED, GOAL, QUIET, START, new_axes, new_figure, styled

_SIDES = (("From above", 0, 2), ("From the right", 2, 1))


def views_figure(points: FloatArray, poses: Sequence[RigidTransform]) -> Figure:
    """Return points (n, 3) and the cameras at the poses, the first red, from above and from the right."""
    reach = 0.2 * float(np.nanmedian(np.linalg.norm(points, axis=1)))
    with styled():
        figure = new_figure(8.0, 3.6)
        for axes, (title, across, up) in zip(figure.subplots(1, 2), _SIDES, strict=True):
            axes.plot(points[:, across], points[:, up], ".", color="black", ms=3)
            for number, pose in enumerate(poses):
                line = np.stack([pose.translation, pose.apply([0.0, 0.0, reach])])
                colour = GOAL if number else START
                axes.plot(line[:, across], line[:, up], "-", color=colour, lw=1.2)
                axes.plot(line[0, across], line[0, up], "s", color=colour, ms=5)
            axes.set_aspect("equal", adjustable="datalim")
            axes.set_title(title)
            axes.set_xlabel("xyz"[across])
            axes.set_ylabel("xyz"[up])
            if up == 1:
                axes.invert_yaxis()
    return figure


def residual_figure(residuals: FloatArray) -> Figure:
    """Return residuals (n, 2), projection minus pixel [px], as points round 0."""
    with styled():
        figure, axes = new_axes(4.2, 3.6)
        axes.axhline(0.0, color=QUIET, lw=0.8)
        axes.axvline(0.0, color=QUIET, lw=0.8)
        axes.plot(*residuals.T, ".", color=EXECUTED, ms=4)
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlabel("u, projection minus pixel [px]")
        axes.set_ylabel("v [px]")
    return figure
