"""Position-based servoing: the error is the camera's pose in the goal's camera frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from omniservo.errors import InputError
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray
from omniservo.servoing.adaptive_gain import Gain, refuse_wrong_gain
from omniservo.servoing.feedback import feedback
from omniservo.servoing.rotation_vector import cross_matrix, rotation_vector_interaction
from omniservo.servoing.servo_measurement import ServoMeasurement

TranslationName = Literal["camera", "target"]


@with_field_docs
@dataclass(frozen=True)
class PoseServoOptions:
    """How position-based servoing is run."""

    translation: TranslationName = "camera"
    """"camera": the camera's centre in the goal's camera frame, which goes straight to it. "target": the
    middle of the points in the camera frame, which goes straight in the image."""
    gain: Gain = 1.0
    """λ [1/s]"""

    def __post_init__(self) -> None:
        if self.translation not in get_args(TranslationName):
            raise InputError(
                f"translation: {self.translation!r} given; legal: {', '.join(get_args(TranslationName))}"
            )
        refuse_wrong_gain(self.gain)


class PoseServo:
    """v = −λ L⁻¹ e of a translation and θu, the rotation vector of goal_R_camera.

    Chaumette and Hutchinson, *Visual servo control, part I* (2006), position-based visual servo, both forms:

    - "camera": e = (t, θu) with goal_T_camera = (R, t); L = diag(R, J).
    - "target": e = (h − h*, θu), h the middle of the target in the camera frame; L = [[−I, [h]×], [0, J]].

    Args:
        options: see PoseServoOptions.
    """

    def __init__(self, options: PoseServoOptions | None = None) -> None:
        self.options = options or PoseServoOptions()
        """as given"""

    def error(self, seen: ServoMeasurement) -> tuple[FloatArray, FloatArray]:
        """Return e (6,) in m and rad, and its interaction matrix L (6, 6)."""
        pose, turn = seen.pose_matrix, seen.turn
        matrix = np.zeros((6, 6))
        matrix[3:, 3:] = rotation_vector_interaction(turn)
        if self.options.translation == "camera":
            matrix[:3, :3] = pose[:3, :3]
            return np.concatenate((pose[:3, 3], turn)), matrix
        goal = seen.goal_points.mean(axis=0)
        now = (goal - pose[:3, 3]) @ pose[:3, :3]
        matrix[:3, :3] = -np.eye(3)
        matrix[:3, 3:] = cross_matrix(now)
        return np.concatenate((now - goal, turn)), matrix

    def step(self, seen: ServoMeasurement) -> FloatArray:
        """Return the camera twist (6,), (linear [m/s], angular [rad/s]) in the camera frame."""
        return feedback(*self.error(seen), self.options.gain)
