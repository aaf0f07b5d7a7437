"""The goal image as the tracker sees it: pixels, features beyond the plan's end, and the pose it implies."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import numpy.typing as npt

from omniservo.cameras.models import CentralModel
from omniservo.errors import InputError
from omniservo.estimation import refine_pose
from omniservo.geometry.arrays import BoolArray, FloatArray, finite_array, frozen
from omniservo.planning import CameraPath
from omniservo.servoing import Feature


@dataclass(frozen=True, eq=False)
class GoalImage:
    """Where the servo ends."""

    pixels: FloatArray
    """(n, 2) [px]"""
    features: FloatArray
    """(n, 2 or 3) that they show"""
    offsets: FloatArray
    """(n, 3) features of the goal image minus those of the plan's end; virtual-plane rows end with 0"""
    pose: FloatArray
    """(7,): quaternion (x, y, z, w) and translation [m] of initial_T_camera where the plan's points look
    most like the goal image"""

    @classmethod
    def of(
        cls,
        camera: CentralModel,
        feature: Feature,
        path: CameraPath,
        points: FloatArray,
        pixels: npt.ArrayLike | None,
    ) -> GoalImage:
        """Build it from goal pixels (n, 2) [px]; None: the projections of ``points`` at the path's end.

        Raises:
            InputError: a wrong shape, numbers that are not finite, a goal pixel that the camera cannot
                unproject or that has no such feature, or a point that the path's end does not see.
        """
        initial_T_end = path(1.0)
        projected, visible = camera.project(initial_T_end.inv().apply(points))
        if pixels is None and not visible.all():
            j = int(np.argmin(visible))
            raise InputError(f"goal_pixels: missing, and the plan's end does not see point {j}")
        wanted = finite_array("goal_pixels", projected if pixels is None else pixels, (len(points), 2))
        bearings, seen = camera.unproject(wanted)
        features, exist = feature.value(np.where(seen[:, None], bearings, 0.0))
        _refuse_missing(exist, wanted)
        offsets = _offsets(features, wanted, feature, path, points)
        if pixels is None:
            offsets[:] = 0.0
        # Where the goal image determines no pose (points on one line) the plan's end must do; the
        # interaction matrix will say at the first step that such points cannot be servoed on.
        refined = refine_pose(camera, points, wanted, initial_T_end)
        initial_T_goal = initial_T_end if refined.reference_T_camera is None else refined.reference_T_camera
        pose = np.concatenate((initial_T_goal.rotation.as_quat(), initial_T_goal.translation))
        return cls(frozen(wanted), frozen(features), frozen(offsets), frozen(pose))

    def beyond(self, feature: Feature, path: CameraPath, points: FloatArray) -> Self:
        """Return the same image as seen from the end of another path; points (n, 3) and pose are the same.

        Raises:
            InputError: the path's end does not see a point.
        """
        return replace(self, offsets=frozen(_offsets(self.features, self.pixels, feature, path, points)))


def _offsets(
    features: FloatArray, pixels: FloatArray, feature: Feature, path: CameraPath, points: FloatArray
) -> FloatArray:
    """Return features of the goal image (n, 2) [px] minus those that a path's end sees (n, 3)."""
    pose = path(1.0).as_matrix()
    planned, exist = feature.value((points - pose[:3, 3]) @ pose[:3, :3])
    _refuse_missing(exist, pixels)
    offsets = np.zeros((len(points), 3))
    offsets[:, : feature.width] = features - planned
    return offsets


def _refuse_missing(exist: BoolArray, pixels: FloatArray) -> None:
    if not exist.all():
        j = int(np.argmin(exist))
        raise InputError(
            f"goal_pixels: row {j}, {pixels[j]}: no such direction in the camera's domain, or none with "
            "Z > 0 as virtual-plane features need"
        )
