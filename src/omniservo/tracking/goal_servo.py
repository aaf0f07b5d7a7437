"""Servoing without a plan in a closed loop: a servo method, with the measurements it needs from the image."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras.models import CentralModel
from omniservo.errors import Divergence, FeatureLoss, InputError, NotFinite, spelled
from omniservo.estimation import refine_pose
from omniservo.estimation.refinement.refine_pose import refined_matrix
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import BoolArray, FloatArray, finite_array, finite_number
from omniservo.renamed import renamed_attribute
from omniservo.servoing import ImageServo, MeasuredPose, ServoMeasurement, ServoMethod
from omniservo.servoing.control_law import limit_twist

LEAST_POINTS = 4
"""The pose needs four."""

SETTLED_FRAMES = 5
"""The goal counts as reached after this many frames in a row, each a new one, within the tolerance."""


@with_field_docs
@dataclass(frozen=True)
class GoalServoOptions:
    """When the goal counts as reached, and how fast the camera may be led to it."""

    tolerance_px: float = 0.1
    """rms distance to the goal image at which the goal counts as reached [px]"""
    max_linear_speed: float = 1.0
    """The whole twist is scaled down to this [m/s]."""
    max_angular_speed: float = 3.0
    """The whole twist is scaled down to this [rad/s]."""

    def __post_init__(self) -> None:
        for name in ("tolerance_px", "max_linear_speed", "max_angular_speed"):
            finite_number(name, getattr(self, name), above=0.0)


@dataclass(frozen=True, eq=False)
class GoalServoReport:
    """What the last step saw. There is no path, so the goal image is the reference."""

    reference_pixels: FloatArray
    """(n, 2) the goal image's points [px]"""
    goal_error_px: float
    """rms distance of the points to the goal image [px]"""
    pose_matrix: FloatArray
    """(4, 4) of `initial_T_camera`"""
    limited: bool
    """the twist was scaled down to a speed limit"""
    w: float = math.nan
    """no path"""

    matrix = renamed_attribute("matrix", "pose_matrix")

    @property
    def initial_T_camera(self) -> RigidTransform:
        """The camera's pose, from the image."""
        return RigidTransform(self.pose_matrix, normalize=False)

    @property
    def error_px(self) -> float:
        """The same as `goal_error_px`."""
        return self.goal_error_px


class GoalServo:
    """Drive the camera to the goal image without a plan, by a `ServoMethod`.

    What the method is given comes from images: the camera's pose is refined on the reconstructed points in
    every frame, as (44) does for the planned path, and once for the goal image.

    Args:
        camera: the camera.
        points: (n, 3) the target in the initial camera frame, as estimated [m].
        goal_pixels: (n, 2) [px].
        method: measurement in, twist out; None: classical image-based servoing.
        initial_T_goal: the goal's pose as estimated, from which the one that explains the goal image is
            refined; None: near the initial one.
        options: see GoalServoOptions.

    Raises:
        InputError: wrong shapes, numbers that are not finite, a goal pixel that the camera cannot unproject.
    """

    def __init__(
        self,
        camera: CentralModel,
        points: npt.ArrayLike,
        goal_pixels: npt.ArrayLike,
        *,
        method: ServoMethod | None = None,
        initial_T_goal: RigidTransform | None = None,
        options: GoalServoOptions | None = None,
    ) -> None:
        self.method = method or ImageServo()
        """as given"""
        self.options = options or GoalServoOptions()
        """as given"""
        self.report: GoalServoReport | None = None
        """of the last step"""
        self._camera = camera
        self._points = finite_array("points", points, (None, 3))
        self._goal_pixels = finite_array("goal_pixels", goal_pixels, (len(self._points), 2))
        self._goal_bearings, seen = camera.unproject(self._goal_pixels)
        if not seen.all():
            j = int(np.argmin(seen))
            raise InputError(f"goal_pixels: row {j}, {self._goal_pixels[j]}, is outside the camera's domain")
        guess = RigidTransform.identity() if initial_T_goal is None else initial_T_goal
        refined = refine_pose(camera, self._points, self._goal_pixels, guess)
        goal = guess if refined.reference_T_camera is None else refined.reference_T_camera
        self._goal, self._goal_T_initial = goal.as_matrix(), goal.inv().as_matrix()
        self._goal_distances = np.linalg.norm(self._points - goal.translation, axis=1)
        self._settled = 0
        self._time = 0.0
        self._twist = np.zeros(6)
        self._where: MeasuredPose | None = None
        self._initial_T_camera = np.eye(4)

    @property
    def points(self) -> FloatArray:
        """(n, 3) the points in the initial camera frame that are servoed on [m]."""
        return self._points.copy()

    @property
    def done(self) -> bool:
        """True once the goal image was met in `SETTLED_FRAMES` frames in a row."""
        return self._settled >= SETTLED_FRAMES

    @property
    def goal(self) -> ServoMeasurement:
        """What the method would be given at the goal."""
        everything = np.ones(len(self._points), dtype=np.bool_)
        return self._measurement(0.0, self._goal_bearings, everything, self._goal)

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
        moved = RigidTransform(self._initial_T_camera, normalize=False) * self._moved(time)
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
            time: of the exposure; an image of the same time as the last is that one again.
            pixels: (n, 2) [px]; rows of points that are not ``valid`` may hold anything.
            valid: (n,) the points seen.
            acts_at: not used; the reference does not move.
            time_sigma: not used; every image stands for itself.

        Raises:
            Divergence: no pose explains the image.
            FeatureLoss: too few points are left.
            NotFinite: the method gives no six finite numbers.
            ServoStop: what else the method raises, such as `SingularInteraction`.
            InputError: the time is not finite.
        """
        time = finite_number("time", time)
        bearings, use = self._camera.unproject(pixels)
        use &= valid
        count = np.count_nonzero(use)
        if count < LEAST_POINTS:
            raise FeatureLoss(f"{count} points are left; at least {LEAST_POINTS} are needed")
        pose, _, _ = refined_matrix(self._camera, self._points, pixels, self._initial_T_camera, use)
        if pose is None:
            raise Divergence(f"no camera pose explains the {count} points in the image")
        self._initial_T_camera = pose
        given = self.method.step(self._measurement(time, bearings, use, pose))
        try:
            twist = finite_array("twist", given, (6,))
        except InputError:
            words = spelled(given.tolist() if isinstance(given, np.ndarray) else given)
            raise NotFinite(
                f"{type(self.method).__name__} gives the twist {words}; it was not sent"
            ) from None
        factor = limit_twist(twist, self.options.max_linear_speed, self.options.max_angular_speed)
        newer = self.report is None or time > self._time
        self._twist, self._time = twist.copy(), time
        off = (pixels - self._goal_pixels)[use]
        error = math.sqrt((off * off).sum() / count)
        self._settled = self._settled + newer if error <= self.options.tolerance_px else 0
        self.report = GoalServoReport(self._goal_pixels.copy(), error, pose.copy(), factor < 1.0)
        return twist

    def _measurement(
        self, time: float, bearings: FloatArray, use: BoolArray, initial_T_camera: FloatArray
    ) -> ServoMeasurement:
        """Return what is known of the points ``use`` (n,), seen along ``bearings`` (n, 3)."""
        rays = self._points - initial_T_camera[:3, 3]
        distances = np.sqrt((rays * rays).sum(axis=1))
        return ServoMeasurement(
            time,
            bearings[use],
            distances[use],
            self._goal_bearings[use],
            self._goal_distances[use],
            self._goal_T_initial @ initial_T_camera,
        )
