"""Pictures of a run for the animation: what the camera saw, and a bystander's view."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from omniservo.geometry.arrays import ByteArray
from omniservo.simulation import World
from omniservo.simulation.outside_view import OutsideView
from omniservo.simulation.run_log import RunLog
from omniservo.simulation.run_result import Film

FRAMES = 40
"""enough for a fluent animation of a few seconds, small enough for a README"""

_WIDTH, _HEIGHT = 480, 360


def film_of(log: RunLog, images: Sequence[ByteArray], worlds: Sequence[World]) -> Film:
    """Return evenly spaced moments of the run, seen from the hand and from outside, each in its world."""
    if not log.rows:
        return Film((), (), ())
    chosen = np.unique(np.linspace(0, len(log.rows) - 1, FRAMES).round().astype(int))
    views = {
        id(world): OutsideView(world, width=_WIDTH, height=_HEIGHT, shadow_rays=1, films=True)
        for world in dict.fromkeys(worlds[i] for i in chosen)
    }
    return Film(
        times=tuple(log.rows[i].time for i in chosen),
        camera=tuple(images[i] for i in chosen),
        outside=tuple(views[id(worlds[i])].render(log.rows[i].joints) for i in chosen),
    )
