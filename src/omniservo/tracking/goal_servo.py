"""Classical image-based servoing in a closed loop: straight to the goal image, distances from the image."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras.models import CentralModel
from omniservo.errors import Divergence, FeatureLoss
from omniservo.estimation import refine_pose
from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.servoing import ImageServo, ImageServoOptions, MeasuredPose

LEAST_POINTS = 4
"""The pose needs four."""

SETTLED_FRAMES = 5
"""The goal counts as reached after this many frames in a row within the tolerance."""


@dataclass(frozen=True, eq=False)
class GoalServoReport:
    """What the last step saw. There is no path, so the goal image is the reference."""

    reference_pixels: FloatArray
    """(n, 2) the goal image's points [px]"""
    goal_error_px: float
    """rms distance of the points to the goal image [px]"""
    initial_T_camera: RigidTransform
    """the camera's pose, from the image"""
    w: float = math.nan
    """no path"""

    @property
    def error_px(self) -> float:
        """The same as `goal_error_px`."""
        return self.goal_error_px


class GoalServo:
    """Drive the camera to the goal image without a plan: v = −λ L⁺ (s − s*).

    The points' distances come from the current image: the camera's pose is refined on the reconstructed
    points in every frame, as (44) does for the planned path.

    Args:
        camera: the camera.
        points: (n, 3) the target in the initial camera frame [m].
        goal_pixels: (n, 2) [px].
        tolerance_px: rms distance to the goal image at which the goal counts as reached.
        options: gain, feature and interaction matrix.
    """

    def __init__(
        self,
        camera: CentralModel,
        points: FloatArray,
        goal_pixels: FloatArray,
        *,
        tolerance_px: float,
        options: ImageServoOptions | None = None,
    ) -> None:
        self._camera = camera
        self._points = points
        self._goal_pixels = goal_pixels
        self._servo = ImageServo(camera, goal_pixels, options=options)
        self._tolerance = tolerance_px
        self._settled = 0
        self._time = 0.0
        self._twist = np.zeros(6)
        self._where: MeasuredPose | None = None
        self._initial_T_camera = RigidTransform.identity()
        self.report: GoalServoReport | None = None
        """of the last step"""

    @property
    def points(self) -> FloatArray:
        """(n, 3) the points in the initial camera frame that are servoed on [m]."""
        return self._points.copy()

    @property
    def done(self) -> bool:
        """True once the goal image was met in `SETTLED_FRAMES` frames in a row."""
        return self._settled >= SETTLED_FRAMES

    def carried_by(self, where: MeasuredPose) -> None:
        """Carry the pose along the camera's measured motion from now on, in place of the last twist.

        Args:
            where: the camera's poses by the joints at times as in `step`.
        """
        self._where = where

    def predict(self, time: float) -> tuple[FloatArray, BoolArray]:
        """Return where the points are expected: the last pose carried on by the motion since.

        As the joints were measured where `carried_by` says it, else by the last twist.
        """
        moved = self._initial_T_camera * self._moved(time)
        return self._camera.project(moved.inv().apply(self._points))

    def _moved(self, time: float) -> RigidTransform:
        """Return the camera's pose at ``time`` [s] in its frame at the last step."""
        if self._where is not None:
            before, after = (
                RigidTransform.from_components(pose[4:], Rotation.from_quat(pose[:4]))
                for pose in (self._where(self._time), self._where(time))
            )
            return before.inv() * after
        elapsed = time - self._time
        turn = Rotation.from_rotvec(self._twist[3:] * elapsed)
        return RigidTransform.from_components(self._twist[:3] * elapsed, turn)

    def step(
        self,
        time: float,
        pixels: FloatArray,
        valid: BoolArray,
        acts_at: float | None = None,
        time_sigma: float = 0.0,
    ) -> FloatArray:
        """Return the camera twist (6,) for the points seen at ``time`` [s].

        Args:
            time: of the exposure.
            pixels: (n, 2) [px].
            valid: (n,) the points seen.
            acts_at: not used; the reference does not move.
            time_sigma: not used; every image stands for itself.

        Raises:
            Divergence: no pose explains the image.
            FeatureLoss: too few points are left.
            SingularInteraction: the points do not determine a twist.
        """
        if valid.sum() < LEAST_POINTS:
            raise FeatureLoss(f"{int(valid.sum())} points are left; at least {LEAST_POINTS} are needed")
        refined = refine_pose(self._camera, self._points, pixels, self._initial_T_camera, valid)
        if refined.reference_T_camera is None:
            raise Divergence(f"no camera pose explains the {int(valid.sum())} points in the image")
        self._initial_T_camera = refined.reference_T_camera
        distances = np.linalg.norm(self._points - self._initial_T_camera.translation, axis=1)
        self._twist = self._servo.step(pixels, distances, valid)
        self._time = time
        error = self._servo.report.error_px if self._servo.report is not None else math.inf
        self._settled = self._settled + 1 if error <= self._tolerance else 0
        self.report = GoalServoReport(self._goal_pixels, error, self._initial_T_camera)
        return self._twist
