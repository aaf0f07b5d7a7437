"""The camera of a study's scene: what each image shows of the points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.studies.study_scene import StudyScene


@dataclass(frozen=True, eq=False)
class StudyImage:
    """The points in one image."""

    pixels: FloatArray
    """(n, 2) as measured [px]"""
    found: BoolArray
    """(n,) the points that were measured, wherever"""
    in_view: BoolArray
    """(n,) truth: the points that are in the image's limits and behind no obstacle"""


class StudyCamera:
    """Takes images of a scene's points, with noise, points that are lost, and points taken for others.

    Every image takes as many random numbers, whatever it shows.

    Args:
        scene: what is true.
        random: of the images.
    """

    def __init__(self, scene: StudyScene, random: np.random.Generator) -> None:
        self._scene, self._random = scene, random

    def see(self, scene: StudyScene) -> None:
        """Let this be true from now on."""
        self._scene = scene

    def take(self, rotation: FloatArray, centre: FloatArray) -> StudyImage:
        """Return the image from a pose: axes (3, 3) and centre (3,) in the initial camera frame."""
        scene, conditions, n = self._scene, self._scene.conditions, len(self._scene.points)
        noise = conditions.noise * self._random.standard_normal((n, 2))
        chances, others = self._random.random((2, n)), self._random.integers(1, n, n)
        pixels, in_view = scene.shown((scene.points - centre) @ rotation)
        if scene.obstacles:
            in_view &= ~scene.hidden(scene.points, centre)
        found = in_view & (chances[0] >= conditions.lost)
        if conditions.wrong:
            shown_as = np.where(chances[1] < conditions.wrong, (np.arange(n) + others) % n, np.arange(n))
            pixels, found = pixels[shown_as], found & in_view[shown_as]
        pixels = pixels + noise
        pixels[~found] = 0.0
        found &= scene.camera.unproject(pixels)[1]
        return StudyImage(pixels, found, in_view)

    def arrival(self, exposed: float) -> float | None:
        """Return when an image of this time arrives [s]; None: never."""
        dropped, delayed, late = self._random.random(3).tolist()
        conditions = self._scene.conditions
        if dropped < conditions.dropped:
            return None
        extra = conditions.delay if delayed < conditions.delayed else 0.0
        return float(exposed + conditions.latency + late * conditions.jitter + extra)
