"""Classical image-based servoing: the goal image's features are the reference from the start."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from omniservo.errors import FeatureLoss, InputError
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray
from omniservo.servoing.adaptive_gain import Gain, refuse_wrong_gain
from omniservo.servoing.features import FeatureName, feature_named, features_of, interaction_of
from omniservo.servoing.feedback import feedback
from omniservo.servoing.servo_measurement import ServoMeasurement

MatrixName = Literal["current", "desired", "mean"]

LEAST_POINTS = 4
"""Three points leave several poses that look alike."""


@with_field_docs
@dataclass(frozen=True)
class ImageServoOptions:
    """How the classical law is run."""

    feature: FeatureName = "virtual-plane"
    """"virtual-plane": image points (X/Z, Y/Z), the classical law; "bearing" also sees points past 90°."""
    matrix: MatrixName = "current"
    """Which interaction matrix is inverted: L(s), L(s*), or their mean (Malis 2004). They take different
    paths, so a comparison must name it."""
    gain: Gain = 1.0
    """λ [1/s]"""

    def __post_init__(self) -> None:
        feature_named(self.feature)
        if self.matrix not in get_args(MatrixName):
            raise InputError(f"matrix: {self.matrix!r} given; legal: {', '.join(get_args(MatrixName))}")
        refuse_wrong_gain(self.gain)


class ImageServo:
    """v = −λ L⁺ (s − s*), s* the features of the goal image.

    Image points: Chaumette and Hutchinson, *Visual servo control, part I* (2006). Bearings: Hamel and Mahony,
    *Visual servoing of an under-actuated dynamic rigid-body system* (2002), their block of L. A point without
    the feature, now or in the goal image, is not used.

    Args:
        options: see ImageServoOptions.
    """

    def __init__(self, options: ImageServoOptions | None = None) -> None:
        self.options = options or ImageServoOptions()
        """as given"""
        self._feature = feature_named(self.options.feature)

    def error(self, seen: ServoMeasurement) -> tuple[FloatArray, FloatArray]:
        """Return e = s − s* (k,) and its interaction matrix L (k, 6) as the options choose it.

        Raises:
            FeatureLoss: fewer than four points have the feature, now and in the goal image.
        """
        now, exists = features_of(self._feature, seen.bearings)
        goal, there = features_of(self._feature, seen.goal_bearings)
        use = exists & there
        if np.count_nonzero(use) < LEAST_POINTS:
            where = "" if self.options.feature == "bearing" else " in front of the image plane"
            raise FeatureLoss(
                f"{int(use.sum())} of {len(use)} points are seen{where}, now and in the goal image; at least "
                f"{LEAST_POINTS} are needed"
            )
        blocks = [
            interaction_of(self._feature, points[use])[0]
            for points, names in ((seen.points, ("current", "mean")), (seen.goal_points, ("desired", "mean")))
            if self.options.matrix in names
        ]
        matrix = blocks[0] if len(blocks) == 1 else 0.5 * (blocks[0] + blocks[1])
        return (now - goal)[use].ravel(), matrix.reshape(-1, 6)

    def step(self, seen: ServoMeasurement) -> FloatArray:
        """Return the camera twist (6,), (linear [m/s], angular [rad/s]) in the camera frame.

        Raises:
            FeatureLoss: fewer than four points have the feature, now and in the goal image.
            SingularInteraction: they do not determine a twist.
        """
        return feedback(*self.error(seen), self.options.gain)
