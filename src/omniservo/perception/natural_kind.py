"""Natural features as a kind of feature."""

from __future__ import annotations

import numpy as np

from omniservo.cameras.models import CentralModel
from omniservo.errors import NoSolutionError
from omniservo.geometry.arrays import ByteArray, FloatArray
from omniservo.perception.feature_kind import LEAST_FEATURES, MatchedPoints, require_features
from omniservo.perception.find_features import find_features
from omniservo.perception.match_images import match_images
from omniservo.perception.patch_tracker import PatchTracker
from omniservo.perception.refine_matches import ImageMatch


def matched_points(match: ImageMatch) -> MatchedPoints:
    """Return matches that are "ok", each with its noise."""
    variances = [np.trace(p.covariance, axis1=1, axis2=2) / 2.0 for p in (match.initial, match.goal)]
    noise = np.sqrt(np.stack(variances, axis=1))
    return MatchedPoints(match.initial.pixels, match.goal.pixels, noise, window=match.window)


class NaturalKind:
    """What a surface itself shows: found, matched and followed by its texture."""

    name = "natural features"
    least = LEAST_FEATURES
    most_blur = 4.0

    def find(self, camera: CentralModel, image: ByteArray) -> FloatArray:
        """Return the features (n, 2) [px], strongest first."""
        return find_features(image, camera).points.pixels

    def match(self, camera: CentralModel, initial: ByteArray, goal: ByteArray) -> MatchedPoints:
        """Return the points that both images show, each with its noise.

        Raises:
            InputError: an image with fewer than eight features.
            NoSolutionError: the match is ambiguous, or fewer than eight features can be matched.
        """
        match = match_images(camera, initial, goal)
        if match.status != "ok":
            for image, where in ((initial, "the initial image"), (goal, "the goal image")):
                require_features(len(self.find(camera, image)), self.name, where)
            words = f"{match.status}: {match.reason}"
            raise NoSolutionError(f"the natural features of the two images cannot be matched: {words}")
        return matched_points(match)

    def tracker(
        self, camera: CentralModel, initial: ByteArray, goal: ByteArray, matched: MatchedPoints
    ) -> PatchTracker:
        """Return a tracker that looks for each point's patch of either image near its prediction."""
        return PatchTracker(camera, initial, matched.initial, goal_image=goal, pixels_goal=matched.goal)
