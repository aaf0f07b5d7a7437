"""Dark dots without names as a kind of feature."""

from __future__ import annotations

import numpy as np

from omniservo.cameras.models import CentralModel
from omniservo.errors import InputError, NoSolutionError
from omniservo.geometry.arrays import ByteArray, FloatArray
from omniservo.perception.dot_tracker import DotTracker
from omniservo.perception.feature_kind import LEAST_FEATURES, MatchedPoints, require_features
from omniservo.perception.find_dots import find_dots
from omniservo.perception.match_dots import match_dots


class DotKind:
    """Dots of one radius: which is which is unknown until two images are compared.

    Args:
        hint: ends the message on an image with too few of them.
    """

    name = "dots"
    least = LEAST_FEATURES
    most_blur = 2.0

    def __init__(self, hint: str = "") -> None:
        self._hint = hint

    def find(self, camera: CentralModel, image: ByteArray) -> FloatArray:
        """Return the dots (n, 2) [px], top to bottom, then left to right."""
        return find_dots(image, camera).pixels

    def match(self, camera: CentralModel, initial: ByteArray, goal: ByteArray) -> MatchedPoints:
        """Return the dots that both images show, in the order of the initial image.

        Raises:
            InputError: an image with fewer than eight dots.
            NoSolutionError: the match is ambiguous, or fewer than eight dots can be matched.
        """
        initial_dots, goal_dots = find_dots(initial, camera), find_dots(goal, camera)
        require_features(len(initial_dots), self.name, "the initial image", hint=self._hint)
        require_features(len(goal_dots), self.name, "the goal image", hint=self._hint)
        match = match_dots(camera, initial_dots, goal_dots)
        if match.status != "ok":
            raise NoSolutionError(
                f"the dots of the two images cannot be matched: {match.status}: {match.reason}"
            )
        if len(match.pairs) < LEAST_FEATURES:
            raise NoSolutionError(f"{len(match.pairs)} dots matched; at least {LEAST_FEATURES} are needed")
        pairs = match.pairs[np.argsort(match.pairs[:, 0])]
        return MatchedPoints(initial_dots.pixels[pairs[:, 0]], goal_dots.pixels[pairs[:, 1]])

    def row(
        self, field: str, number: int, image: ByteArray, camera: CentralModel, matched: FloatArray
    ) -> int:
        """Return which of ``matched`` (n, 2) [px], dots of this image, is that with this number in `find`.

        Raises:
            InputError: the image shows no such dot, or no other image does; ``field`` stands first.
        """
        dots = self.find(camera, image)
        if not 0 <= number < len(dots):
            raise InputError(
                f"{field}: dot {number} given; the first image shows {len(dots)}, numbered from 0, top to"
                " bottom, then left to right"
            )
        rows = np.flatnonzero((matched == dots[number]).all(axis=1))
        if not len(rows):
            raise InputError(f"{field}: dot {number} given; the first image shows it, and no other")
        return int(rows[0])

    def tracker(
        self, camera: CentralModel, initial: ByteArray, goal: ByteArray, matched: MatchedPoints
    ) -> DotTracker:
        """Return a tracker that looks for a dot near each prediction."""
        del initial, goal, matched  # every dot looks like every other
        return DotTracker(camera)
