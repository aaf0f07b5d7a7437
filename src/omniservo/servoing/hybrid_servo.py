"""2½-D servoing: one point in the image with its depth, and the rotation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omniservo.errors import FeatureLoss
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray
from omniservo.servoing.adaptive_gain import Gain, refuse_wrong_gain
from omniservo.servoing.features import VirtualPlaneFeatures, features_of, interaction_of
from omniservo.servoing.feedback import feedback
from omniservo.servoing.rotation_vector import rotation_vector_interaction
from omniservo.servoing.servo_measurement import ServoMeasurement

_ALIKE = 9
"""Points count as equally near the middle to so many decimals [m]; the first of them is taken."""


@with_field_docs
@dataclass(frozen=True)
class HybridServoOptions:
    """How 2½-D servoing is run."""

    gain: Gain = 1.0
    """λ [1/s]"""

    def __post_init__(self) -> None:
        refuse_wrong_gain(self.gain)


class HybridServo:
    """v = −λ L⁻¹ e of e = (x − x*, y − y*, log(Z/Z*), θu): Malis, Chaumette and Boudet (1999), 2½-D.

    (x, y) = (X/Z, Y/Z) of the reference point: of those in front of the image plane, now and in the goal
    image, the one nearest the middle of the target. θu is the rotation vector of goal_R_camera.

    Args:
        options: see HybridServoOptions.
    """

    def __init__(self, options: HybridServoOptions | None = None) -> None:
        self.options = options or HybridServoOptions()
        """as given"""
        self._feature = VirtualPlaneFeatures()

    def error(self, seen: ServoMeasurement) -> tuple[FloatArray, FloatArray]:
        """Return e (6,), and its interaction matrix L (6, 6).

        Raises:
            FeatureLoss: no point lies in front of the image plane, now and in the goal image.
        """
        now, exists = features_of(self._feature, seen.bearings)
        goal, there = features_of(self._feature, seen.goal_bearings)
        use = np.flatnonzero(exists & there)
        if not len(use):
            raise FeatureLoss(
                f"none of {len(now)} points lies in front of the image plane, now and in the goal image; "
                "2½-D servoing needs one"
            )
        points, turn = seen.goal_points, seen.turn
        off = points[use] - points.sum(axis=0) / len(points)
        j = int(use[np.sqrt((off * off).sum(axis=1)).round(_ALIKE).argmin()])
        here = seen.bearings[j : j + 1] * seen.distances[j]
        (x, y), depth = now[j], here[0, 2]
        matrix = np.zeros((6, 6))
        matrix[:2] = interaction_of(self._feature, here)[0][0]
        matrix[2] = [0.0, 0.0, -1.0 / depth, -y, x, 0.0]
        matrix[3:, 3:] = rotation_vector_interaction(turn)
        return np.concatenate((now[j] - goal[j], [np.log(depth / points[j, 2])], turn)), matrix

    def step(self, seen: ServoMeasurement) -> FloatArray:
        """Return the camera twist (6,), (linear [m/s], angular [rad/s]) in the camera frame.

        Raises:
            FeatureLoss: no point lies in front of the image plane, now and in the goal image.
        """
        return feedback(*self.error(seen), self.options.gain)
