"""Hybrid switched servoing: by the image until the pose's error grows, by the pose until the image's does."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray, finite_number
from omniservo.servoing.feedback import feedback
from omniservo.servoing.image_servo import ImageServo, ImageServoOptions
from omniservo.servoing.pose_servo import PoseServo, PoseServoOptions
from omniservo.servoing.servo_measurement import ServoMeasurement

Mode = Literal["image", "pose"]


@with_field_docs
@dataclass(frozen=True)
class SwitchedServoOptions:
    """How switched servoing is run."""

    image: ImageServoOptions = field(default_factory=ImageServoOptions)
    """of the image-based law, with which it begins"""
    pose: PoseServoOptions = field(default_factory=PoseServoOptions)
    """of the position-based law"""
    most_pose_error: float = 1.1
    """servoing by the image is left where ‖(t/d, θu)‖ exceeds so many times its value at the start, d the
    mean distance of the points from the goal,"""
    most_image_error: float = 1.1
    """and servoing by the pose where the rms of s − s* does."""

    def __post_init__(self) -> None:
        finite_number("most_pose_error", self.most_pose_error, above=1.0)
        finite_number("most_image_error", self.most_image_error, above=1.0)


class SwitchedServo:
    """Image-based until the pose's error grows, then position-based until the image's error grows.

    Gans and Hutchinson, *Stable visual servoing through hybrid switched-system control* (2007): switching by
    the state, here with bounds on both errors that are multiples of those at the start.

    Args:
        options: see SwitchedServoOptions.
    """

    def __init__(self, options: SwitchedServoOptions | None = None) -> None:
        self.options = options or SwitchedServoOptions()
        """as given"""
        self.mode: Mode = "image"
        """the law that gave the last twist"""
        self._image, self._pose = ImageServo(self.options.image), PoseServo(self.options.pose)
        self._bounds: dict[Mode, float] | None = None

    def step(self, seen: ServoMeasurement) -> FloatArray:
        """Return the camera twist (6,), (linear [m/s], angular [rad/s]) in the camera frame.

        Raises:
            FeatureLoss, SingularInteraction: as `ImageServo`.
        """
        by_image, by_pose = self._image.error(seen), self._pose.error(seen)
        away = np.linalg.norm(seen.pose_matrix[:3, 3]) / seen.goal_distances.mean()
        size: dict[Mode, float] = {
            "image": float(np.sqrt(np.mean(by_image[0] ** 2))),
            "pose": float(np.hypot(away, np.linalg.norm(seen.turn))),
        }
        if self._bounds is None:
            options = self.options
            self._bounds = {
                "image": options.most_image_error * size["image"],
                "pose": options.most_pose_error * size["pose"],
            }
        other: Mode = "pose" if self.mode == "image" else "image"
        if size[other] > self._bounds[other]:
            self.mode = other
        if self.mode == "image":
            return feedback(*by_image, self.options.image.gain)
        return feedback(*by_pose, self.options.pose.gain)
