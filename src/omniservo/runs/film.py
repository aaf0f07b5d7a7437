"""Pictures of a run for the animation: what the camera saw, and a bystander's view."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from omniservo.geometry.arrays import ByteArray
from omniservo.simulation import OutsideView
from omniservo.simulation.run_log import RunLog
from omniservo.simulation.run_result import Film
from omniservo.simulation.scene import Scene

FRAMES = 40
"""enough for a fluent animation of a few seconds, small enough for a README"""

_SIZE = (360, 270)


def film_of(log: RunLog, images: Sequence[ByteArray], scene: Scene) -> Film:
    """Return evenly spaced moments of the run, seen from the hand and from outside."""
    if not log.rows:
        return Film((), (), ())
    chosen = np.unique(np.linspace(0, len(log.rows) - 1, FRAMES).round().astype(int))
    outside = OutsideView(scene, size=_SIZE)
    return Film(
        times=tuple(log.rows[i].time for i in chosen),
        camera=tuple(images[i] for i in chosen),
        outside=tuple(outside.render(log.rows[i].joints) for i in chosen),
    )
