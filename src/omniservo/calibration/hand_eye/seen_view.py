"""What one image shows of the board: corners that agree with each other, and where the board may be."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import RigidTransform

from omniservo.calibration.hand_eye.loop import SeenViews
from omniservo.cameras.models import CentralModel
from omniservo.errors import InputError
from omniservo.estimation import estimate_pose
from omniservo.geometry.arrays import FloatArray, finite_array


@dataclass(frozen=True, eq=False)
class SeenView:
    """A view that can be used."""

    number: int
    """its place among all views"""
    base_T_flange: RigidTransform
    pixels: FloatArray
    """(k, 2) [px]"""
    points: FloatArray
    """(k, 3) on the board [m]"""
    poses: tuple[RigidTransform, ...]
    """camera_T_board: all that the corners leave open; with the board as it is, then with each turn"""
    own_rms_px: float
    """corners from where the first pose puts them [px]"""
    noise_px: float
    """σ of a coordinate [px]"""

    def with_pose(self, k: int, turns: Sequence[RigidTransform]) -> SeenView:
        """Return the view with its pose ``k`` alone, and the board turned as it belongs to that."""
        turned = k // (len(self.poses) // (1 + len(turns)))
        points = self.points if turned == 0 else turns[turned - 1].apply(self.points)
        return replace(self, poses=(self.poses[k],), points=points)

    def residuals(self, camera: CentralModel, camera_T_board: RigidTransform) -> FloatArray:
        """Return projection − corner (k, 2) [px]; NaN where the camera cannot project."""
        return np.asarray(camera.project(camera_T_board.apply(self.points))[0] - self.pixels)


def together(views: Sequence[SeenView]) -> SeenViews:
    """Return the corners of all views in flat arrays."""
    return SeenViews(
        base_T_flange=RigidTransform.concatenate([view.base_T_flange for view in views]),
        pixels=np.concatenate([view.pixels for view in views]),
        points=np.concatenate([view.points for view in views]),
        ends=np.cumsum([0, *(len(view.pixels) for view in views)]),
    )


def usable_views(
    camera: CentralModel,
    base_T_flange: RigidTransform,
    image_points: Sequence[npt.ArrayLike],
    object_points: Sequence[npt.ArrayLike],
    turns: Sequence[RigidTransform],
) -> tuple[list[SeenView], list[str]]:
    """Return the views whose corners give the board's pose, and for every view "" or why it cannot be used.

    Raises:
        InputError: see `calibrate_hand_eye`.
    """
    for name, value in (("image_points", image_points), ("object_points", object_points)):
        if len(value) != len(base_T_flange):
            raise InputError(
                f"{name}: {len(value)} views given for {len(base_T_flange)} poses; one each is needed"
            )
    views: list[SeenView] = []
    reasons: list[str] = []
    for i, (seen, known) in enumerate(zip(image_points, object_points, strict=True)):
        view = _seen(camera, i, base_T_flange[i], _rows(f"image_points[{i}]", seen, 2),
                     _rows(f"object_points[{i}]", known, 3), turns)  # fmt: skip
        reasons.append(view if isinstance(view, str) else "")
        if not isinstance(view, str):
            views.append(view)
    return views, reasons


def _rows(name: str, value: npt.ArrayLike, width: int) -> FloatArray:
    return finite_array(name, value, (None, width)) if np.size(value) else np.empty((0, width))


def _seen(
    camera: CentralModel,
    number: int,
    base_T_flange: RigidTransform,
    pixels: FloatArray,
    points: FloatArray,
    turns: Sequence[RigidTransform],
) -> SeenView | str:
    if len(pixels) != len(points):
        raise InputError(
            f"object_points[{number}]: {len(points)} rows given, image_points[{number}] has {len(pixels)}"
        )
    if not len(pixels):
        return "the board was not found"
    try:
        pose = estimate_pose(camera, points, pixels)
    except InputError as error:
        raise InputError(f"image_points[{number}]: {error}") from None
    if pose.status not in ("ok", "ambiguous") or len(pixels) < 4:
        return pose.message or f"{len(pixels)} corners; at least 4 are needed"
    poses = tuple(found.inv() for found in pose.poses)
    poses += tuple(found * turn.inv() for turn in turns for found in poses)
    members = pose.inliers if pose.status == "ok" else np.ones(len(pixels), dtype=np.bool_)
    seen = SeenView(number, base_T_flange, pixels[members], points[members], poses, 0.0, 0.0)
    errors = seen.residuals(camera, poses[0])
    square = float((errors**2).sum())
    dof = max(2 * len(errors) - 6, 1)
    return replace(seen, own_rms_px=math.sqrt(square / len(errors)), noise_px=math.sqrt(square / dof))
