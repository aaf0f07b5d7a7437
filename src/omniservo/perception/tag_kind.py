"""Corners of tags as a kind of feature: their numbers say which is which."""

from __future__ import annotations

import numpy as np

from omniservo.cameras.models import CentralModel
from omniservo.errors import InputError, NoSolutionError
from omniservo.geometry.arrays import BoolArray, ByteArray, FloatArray, IntArray
from omniservo.perception.feature_kind import LEAST_FEATURES, MatchedPoints, require_features
from omniservo.perception.find_tags import find_tags
from omniservo.perception.image_points import ImagePoints
from omniservo.perception.tag_tracker import TagTracker


class TagKind:
    """Tags of one dictionary.

    Args:
        dictionary: its name, as of `find_tags`.
        least: how many corners both images must show: eight where nothing is known of the target, four (one
            tag) where it is known.
    """

    name = "tag corners"
    most_blur = 5.0

    def __init__(self, dictionary: str, least: int = LEAST_FEATURES) -> None:
        self.dictionary = dictionary
        self.least = least

    def find(self, camera: CentralModel, image: ByteArray) -> FloatArray:
        """Return the corners (n, 2) [px] of all tags, by number."""
        return self._points(camera, image).pixels

    def match(self, camera: CentralModel, initial: ByteArray, goal: ByteArray) -> MatchedPoints:
        """Return the corners of the tags that both images show, by number.

        Raises:
            InputError: an image with fewer corners than ``least``.
            NoSolutionError: both images share fewer.
        """
        first, second = self._points(camera, initial), self._points(camera, goal)
        require_features(len(first), self.name, "the initial image", self.least)
        require_features(len(second), self.name, "the goal image", self.least)
        ids, rows, others = np.intersect1d(_ids(first), _ids(second), return_indices=True)
        if len(ids) < self.least:
            raise NoSolutionError(f"{len(ids)} tag corners in both images; at least {self.least} are needed")
        noise = np.column_stack((corner_sigmas(first)[rows], corner_sigmas(second)[others]))
        return MatchedPoints(first.pixels[rows], second.pixels[others], noise, ids)

    def tracker(
        self, camera: CentralModel, initial: ByteArray, goal: ByteArray, matched: MatchedPoints
    ) -> CornerTracker:
        """Return a tracker of these corners."""
        del initial, goal
        if matched.ids is None:
            raise AssertionError("tag corners have numbers")
        return CornerTracker(camera, self.dictionary, matched.ids)

    def _points(self, camera: CentralModel, image: ByteArray) -> ImagePoints:
        return find_tags(image, camera, self.dictionary).points


class CornerTracker:
    """Follows single corners by their tags.

    Args:
        camera: takes the images.
        dictionary: of the tags.
        ids: (n,) of the corners, 4·tag + corner.
    """

    def __init__(self, camera: CentralModel, dictionary: str, ids: IntArray) -> None:
        tags, self._places = np.unique(ids // 4, return_inverse=True)
        self._rows = 4 * self._places + ids % 4
        self._tracker = TagTracker(camera, dictionary, [int(tag) for tag in tags])

    def update(self, image: ByteArray, predicted_pixels: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return the corners near their predictions, as of `TagTracker.update`; rows are those of ``ids``.

        A tag with fewer than three predicted corners stays lost; a fourth is where it makes a parallelogram.

        Raises:
            InputError: as `TagTracker.update`; a row of predictions for each corner is needed.
        """
        predicted = np.asarray(predicted_pixels, dtype=np.float64)
        if predicted.shape != (len(self._rows), 2):
            given = f"predicted_pixels: shape {predicted.shape} given"
            raise InputError(f"{given}; ({len(self._rows)}, 2) is needed")
        corners = np.full((4 * len(self._tracker.ids), 2), np.nan)
        corners[self._rows] = predicted
        tags = corners.reshape(-1, 4, 2)
        fourth = np.roll(tags, 1, axis=1) + np.roll(tags, -1, axis=1) - np.roll(tags, 2, axis=1)
        completed = np.where(np.isnan(tags), fourth, tags).reshape(-1, 2)
        pixels, valid = self._tracker.update(image, completed)
        return pixels[self._rows], valid[self._rows]


def _ids(points: ImagePoints) -> IntArray:
    return np.empty(0, dtype=np.int64) if points.ids is None else points.ids


def corner_sigmas(points: ImagePoints) -> FloatArray:
    """σ of a coordinate (n,) [px], the mean over directions."""
    return np.asarray(np.sqrt(0.5 * np.trace(points.covariance, axis1=1, axis2=2)))
