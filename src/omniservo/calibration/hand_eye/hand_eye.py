"""The camera on the flange: where it sits, how sure that is, and what it rests on."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.drawn import drawn
from omniservo.errors import InputError, spelled
from omniservo.field_docs import with_field_docs
from omniservo.files import read_document, write_whole
from omniservo.geometry.arrays import FloatArray, finite_array, finite_number
from omniservo.geometry.covariances import is_covariance
from omniservo.geometry.pose_fields import pose_fields
from omniservo.renamed import renamed_attribute

FORMAT = "omniservo.hand_eye/1"

HandEyeStatus = Literal[
    "ok",
    "too_few_views",
    "no_rotation",
    "one_axis",
    "poses_inverted",
    "views_disagree",
    "not_determined",
    "not_converged",
]

DISPUTED = 4.0
"""standard deviations by which the board is larger or smaller than stated"""

_NEAR_UNIT = 1e-6


@with_field_docs
@dataclass(frozen=True, eq=False)
class HandEyeView:
    """What one image says."""

    used: bool
    reason: str
    """why it is not used; empty where it is"""
    position_m: float
    """how far base_T_flange · flange_T_camera · camera_T_board of this view alone is from base_T_board [m]"""
    rotation_rad: float
    """the same for its rotation [rad]"""
    own_rms_px: float
    """corners from where the view's own camera_T_board puts them, root mean square [px]"""
    pixels: FloatArray
    """(k, 2) the corners that count [px]"""
    loop_px: FloatArray
    """(k, 2) where the robot's reported pose puts the corners, minus the corners [px]"""

    @property
    def corners(self) -> int:
        """Number of corners that count."""
        return len(self.pixels)

    @property
    def loop_rms_px(self) -> float:
        """Root mean square length of ``loop_px``; NaN where nothing is known."""
        return float(np.sqrt((self.loop_px**2).sum(axis=1).mean())) if len(self.loop_px) else math.nan


@with_field_docs
@dataclass(frozen=True, eq=False)
class HandEye:
    """flange_T_camera and base_T_board from n views, or the reason why there are none.

    Any status but "ok" is no pose: both are None, and numbers that belong to them are NaN.
    """

    status: HandEyeStatus
    """"ok"; "too_few_views": fewer than four can be used; "no_rotation", "one_axis": the flange did not turn,
    or about one axis only, along which the camera could sit anywhere; "poses_inverted": the views agree once
    every pose is inverted; "views_disagree": no two poses of camera and board that most views agree with;
    "not_determined": the camera's pose is left open by more than 50 mm or 5°; "not_converged": no minimum was
    found."""
    message: str
    """one sentence with the evidence; empty for "ok\""""
    flange_T_camera: RigidTransform | None
    base_T_board: RigidTransform | None
    covariance: FloatArray
    """(6, 6) of flange_T_camera: translation in the flange's frame [m], rotation vector on the right [rad].
    Where the board's size is disputed it reaches as far as the pose that the other size would give."""
    board_covariance: FloatArray
    """(6, 6) of base_T_board, likewise"""
    robot_position_m: float
    """σ of a reported position's error, per axis [m]: what the views disagree by beyond the corners' noise"""
    robot_rotation_rad: float
    """σ of a reported rotation's error, per axis [rad]"""
    noise_px: float
    """σ of a corner's coordinate [px]"""
    board_scale: float
    """how many times larger than stated the board is by the robot's lengths; the result does not use it"""
    board_scale_sigma: float
    """its standard deviation"""
    views: tuple[HandEyeView, ...]
    """in the order given"""
    seconds: float
    """wall time [s]"""

    tool_T_camera = renamed_attribute("tool_T_camera", "flange_T_camera")

    def _repr_html_(self) -> str:
        return str(drawn("value_html", self))

    def __repr__(self) -> str:
        words = [self.status, f"{len(self.views)} views"]
        if self.flange_T_camera is not None:
            away = 1e3 * float(np.linalg.norm(self.flange_T_camera.translation))
            words.append(f"camera {away:.1f} mm from the flange")
        return f"HandEye({', '.join(words)})"

    @property
    def board_size_disputed(self) -> bool:
        """Whether ``board_scale`` is off 1 by more than `DISPUTED` standard deviations."""
        return abs(math.log(self.board_scale)) > DISPUTED * self.board_scale_sigma / self.board_scale

    @property
    def scatter_rms(self) -> tuple[float, float]:
        """Root mean square [m], [rad] of how far the used views' boards are off base_T_board; NaN if none."""
        return _lengths(self, lambda off: np.sqrt((off**2).mean(axis=0)))

    @property
    def scatter_worst(self) -> tuple[float, float]:
        """The largest [m], [rad] of the same."""
        return _lengths(self, lambda off: off.max(axis=0))

    @property
    def used(self) -> tuple[int, ...]:
        """The views that the result rests on."""
        return tuple(i for i, view in enumerate(self.views) if view.used)

    def to_dict(self) -> dict[str, Any]:
        """Return plain lists and numbers: what `save` writes.

        Raises:
            InputError: there is no pose (``status`` is not "ok").
        """
        if self.flange_T_camera is None or self.base_T_board is None:
            raise InputError(f"hand-eye calibration: no pose to save: {self.status}: {self.message}")
        return {
            "format": FORMAT,
            "flange_T_camera": pose_fields(self.flange_T_camera),
            "tool_T_camera": pose_fields(self.flange_T_camera),  # its name of before, for one release
            "covariance": self.covariance.tolist(),
            "base_T_board": pose_fields(self.base_T_board),
            "board_covariance": self.board_covariance.tolist(),
            "robot_position_m": self.robot_position_m,
            "robot_rotation_rad": self.robot_rotation_rad,
            "noise_px": self.noise_px,
            "board_scale": self.board_scale,
            "board_scale_sigma": self.board_scale_sigma,
            "views_used": len(self.used),
        }

    def save(self, path: str | Path, *, force: bool = False) -> None:
        """Write :meth:`to_dict` as JSON, whole or not at all; `load_hand_eye` and task files read it.

        Raises:
            InputError: there is no pose, the file exists and ``force`` is False, or it cannot be written.
        """
        write_whole(path, json.dumps(self.to_dict(), indent=2) + "\n", force=force)


def load_hand_eye(path: str | Path) -> tuple[RigidTransform, FloatArray]:
    """Return flange_T_camera and its covariance (6, 6) from a file that `HandEye.save` wrote.

    Raises:
        InputError: not such a file; the message names file, field, what was given and what is legal.
    """
    fields = read_document(path)
    if not isinstance(fields, dict) or fields.get("format") != FORMAT:
        given = spelled(fields.get("format")) if isinstance(fields, dict) else spelled(fields)
        raise InputError(
            f"{path}: format: {given} given; legal: {FORMAT!r}; a task takes another program's result as"
            " numbers, flange_T_camera: {translation: [x, y, z], quaternion: [x, y, z, w]}, of the camera's"
            " optical frame (z ahead, x right, y down)"
        )
    mount = next((name for name in ("flange_T_camera", "tool_T_camera") if name in fields), "flange_T_camera")
    for name in (mount, "covariance"):
        if name not in fields:
            raise InputError(f"{path}: {name}: missing field")
    pose = fields[mount]
    if not isinstance(pose, dict) or set(pose) != {"translation", "quaternion"}:
        raise InputError(
            f"{path}: {mount}: {spelled(pose)} given; legal: a mapping with translation and quaternion"
        )
    translation = finite_array(f"{path}: {mount}: translation", pose["translation"], (3,))
    quaternion = finite_array(f"{path}: {mount}: quaternion", pose["quaternion"], (4,))
    if abs(math.hypot(*quaternion) - 1.0) > _NEAR_UNIT:
        raise InputError(f"{path}: {mount}: quaternion: norm {math.hypot(*quaternion):g} given; legal: 1")
    covariance = finite_array(f"{path}: covariance", fields["covariance"], (6, 6))
    if not is_covariance(covariance):
        raise InputError(
            f"{path}: covariance: not symmetric and positive; legal: what calibrate-hand-eye wrote"
        )
    return RigidTransform.from_components(translation, Rotation.from_quat(quaternion)), covariance


def load_robot_sigmas(path: str | Path) -> tuple[float, float]:
    """Return σ of a reported position [m] and rotation [rad] from a file that `HandEye.save` wrote.

    Raises:
        InputError: not such a file.
    """
    load_hand_eye(path)
    fields = read_document(path)
    names = ("robot_position_m", "robot_rotation_rad")
    position, rotation = (finite_number(f"{path}: {n}", fields.get(n), minimum=0.0) for n in names)
    return position, rotation


def _lengths(found: HandEye, measure: Callable[[FloatArray], FloatArray]) -> tuple[float, float]:
    used = [found.views[i] for i in found.used]
    if not used:
        return math.nan, math.nan
    metres, radians = measure(np.array([[view.position_m, view.rotation_rad] for view in used]))
    return float(metres), float(radians)
