"""Images of a run for the animation: what the camera saw, and a bystander's view."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from omniservo.results import Film, RunLog
from omniservo.robots import CameraImage
from omniservo.runs.ground_truth import GroundTruth

FRAMES = 40
"""enough for a fluent animation of a few seconds, small enough for a README"""


def film_of(log: RunLog, images: Sequence[CameraImage], truth: GroundTruth | None) -> Film:
    """Return evenly spaced moments of the run, seen by the camera and, where there is truth, from outside."""
    if not log.rows:
        return Film((), (), ())
    chosen = np.unique(np.linspace(0, len(log.rows) - 1, FRAMES).round().astype(int))
    outside = (
        ()
        if truth is None
        else (truth.outside_picture(log.rows[i].joints, images[i].time, quick=True) for i in chosen)
    )
    return Film(
        times=tuple(log.rows[i].time for i in chosen),
        camera=tuple(images[i].pixels for i in chosen),
        outside=tuple(outside),
    )
