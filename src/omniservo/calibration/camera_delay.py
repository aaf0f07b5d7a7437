"""The offset between a camera's stamps and the joints': from images of a static scene while joints move."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.sparse import lil_matrix
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras.models import CentralModel
from omniservo.errors import NoSolutionError
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.hardware import JointHistory
from omniservo.robots import Arm

LEAST_POINTS = 6
"""Fewer tracked points decide nothing."""

LEAST_FLOW = 20.0
"""Points must move as fast as this at their fastest [px/s]; slower ones hardly tell the time."""

MOST_RMS = 3.0
"""The images contradict the joints where what is left of the points' motion is more [px rms] …"""

LEAST_EXPLAINED = 0.8
"""… or less than this share of their motion (rms) is explained."""

OUTLIER, LEAST_RMS = 3.0, 0.2
"""Points of which so many times more is left than of the median point, and than this [px], are outliers."""

SEARCHED = 0.5
"""Offsets are searched up to this, either way [s]."""

_STEP = 0.02
"""Offsets that are tried first are as far apart [s]."""

_STARTS = 1.0
"""of 1/distance, before it is known [1/m]"""


@with_field_docs
@dataclass(frozen=True)
class CameraDelay:
    """How the camera's stamps lie to the joints'."""

    offset: float
    """an image's stamp plus this is the joints' time of its exposure [s]"""
    sigma: float
    """standard deviation of ``offset`` [s]: of the residuals, and of the stamps themselves"""
    rms_px: float
    """what is left of the points' motion, rms [px]"""
    flow: float
    """the points' motion at its fastest, median over the points [px/s]"""


@dataclass(frozen=True)
class DelayViews:
    """What was recorded: points of a static scene in k images, and the joints meanwhile."""

    times: FloatArray
    """(k,) stamps of the images [s]"""
    tracks: FloatArray
    """(k, n, 2) where the points are [px]; NaN where not tracked"""
    joints: JointHistory
    """readings on the same clock, but for the offset"""
    time_sigma: float = 0.0
    """standard deviation of what all stamps of one connection are off alike [s]; of another it differs"""


def camera_delay(
    camera: CentralModel, arm: Arm, flange_T_camera: RigidTransform, views: DelayViews
) -> CameraDelay:
    """Return the offset that explains the points' motion by the joints'.

    Minimises Σ ‖p_ij − π(T(q(t_i + τ))⁻¹ T(q(t_0 + τ)) b_j/ρ_j)‖² over τ and each point's bearing b_j and
    inverse distance ρ_j, T the camera's pose by the arm's kinematics and the mount, t_0 the first image; so
    neither the scene nor the arm's place need be known. σ is √(s² (JᵀJ)⁻¹ + σ_t²), s that of the residuals,
    σ_t the stamps' own, which images of one connection cannot show.

    Args:
        camera: takes the images.
        arm: its kinematics.
        flange_T_camera: the mount; a small error of it goes into the points.
        views: what was recorded.

    Raises:
        NoSolutionError: too few points, too little motion, or joints that do not explain the images: another
            arm, mount or camera, a joint's sign, or a scene that moves.
    """
    tracks = _usable(camera, views.tracks)
    speed = np.linalg.norm(np.diff(tracks, axis=0), axis=2) / np.diff(views.times)[:, None]
    flow = float(np.median(np.quantile(speed, 0.95, axis=0)))
    if flow < LEAST_FLOW:
        raise NoSolutionError(
            f"the points move by {flow:.0f} px/s; at least {LEAST_FLOW:g} are needed: a scene nearer to the "
            "camera or more of it, or a faster motion"
        )
    found, rest = _Problem(camera, arm, flange_T_camera, views, tracks).solve()
    agree: BoolArray = np.asarray(rest <= OUTLIER * max(float(np.median(rest)), LEAST_RMS))
    if LEAST_POINTS <= agree.sum() < len(agree):  # what the camera carries in its view, or what moves
        tracks = tracks[:, agree]
        found, _ = _Problem(camera, arm, flange_T_camera, views, tracks).solve()
    moved = float(np.sqrt(np.mean(np.sum((tracks - tracks.mean(axis=0)) ** 2, axis=2))))
    if found.rms_px > MOST_RMS or found.rms_px > (1.0 - LEAST_EXPLAINED) * moved:
        raise NoSolutionError(
            f"the joints do not explain the images: {found.rms_px:.2f} px (rms) are left of {moved:.2f} px "
            "of motion: another arm file, mount or camera, a joint that turns the other way, or a scene that "
            "moves"
        )
    return CameraDelay(found.offset, float(np.hypot(found.sigma, views.time_sigma)), found.rms_px, flow)


def _usable(camera: CentralModel, tracks: FloatArray) -> FloatArray:
    """Return the tracks (k, m, 2) [px] that are seen in every image, inside what the lens shows.

    Raises:
        NoSolutionError: too few.
    """
    seen: BoolArray = np.asarray(np.isfinite(tracks).all(axis=2))
    pixels = np.where(seen[..., None], tracks, 0.0)
    seen &= camera.in_image(pixels) & camera.unproject(pixels)[1]
    kept: FloatArray = tracks[:, seen.all(axis=0)]
    if kept.shape[1] < LEAST_POINTS:
        raise NoSolutionError(
            f"{kept.shape[1]} points could be tracked; at least {LEAST_POINTS} are needed: show the camera "
            "more of a scene with texture"
        )
    return kept


class _Problem:
    """The least-squares problem over (τ, and a bearing's two angles and ρ of each point)."""

    def __init__(
        self,
        camera: CentralModel,
        arm: Arm,
        flange_T_camera: RigidTransform,
        views: DelayViews,
        tracks: FloatArray,
    ) -> None:
        self._camera, self._arm, self._mount = camera, arm, flange_T_camera
        self._views, self._tracks = views, tracks
        bearings = camera.unproject(tracks[0])[0]
        self._count = len(bearings)
        turns = [Rotation.align_vectors([b], [[0.0, 0.0, 1.0]])[0].as_matrix() for b in bearings]
        self._frames = np.array(turns)  # (n, 3, 3): z along the first bearing

    def solve(self) -> tuple[CameraDelay, FloatArray]:
        """Return the best offset, and what is left of each point's motion, rms (n,) [px]."""
        coarse = np.arange(-SEARCHED, SEARCHED + _STEP, _STEP)
        begin = min(coarse, key=lambda tau: float(np.sum(self._reduced(tau) ** 2)))
        start = np.concatenate(([begin], np.tile([0.0, 0.0, _STARTS], self._count)))
        found = least_squares(
            self._residuals, start, jac_sparsity=self._pattern(), x_scale="jac", method="trf"
        )
        rest = found.fun
        jacobian = found.jac.toarray() if hasattr(found.jac, "toarray") else np.asarray(found.jac)
        variance = float(rest @ rest) / max(len(rest) - len(start), 1)
        offset_variance = variance * float(np.linalg.pinv(jacobian.T @ jacobian)[0, 0])
        rms = float(np.sqrt(2.0 * np.mean(rest**2)))
        of_points = np.sqrt(2.0 * np.mean(rest.reshape(-1, self._count, 2) ** 2, axis=(0, 2)))
        return CameraDelay(float(found.x[0]), float(np.sqrt(offset_variance)), rms, 0.0), of_points

    def _poses(self, tau: float) -> RigidTransform:
        """Return first_T_camera of every image."""
        joints = self._views.joints.at(self._views.times + tau)
        flanges = np.tile(np.eye(4), (len(joints), 1, 1))
        flanges[:, :3] = [self._arm.locate(q)[0] for q in joints]
        base_T_camera = RigidTransform(flanges, normalize=False) * self._mount
        return base_T_camera[0].inv() * base_T_camera

    def _reduced(self, tau: float) -> FloatArray:
        """Return residuals with points where the first image has them, at 1 m."""
        return self._residuals(np.concatenate(([tau], np.tile([0.0, 0.0, _STARTS], self._count))))

    def _residuals(self, x: FloatArray) -> FloatArray:
        tilted = x[1:].reshape(-1, 3)
        local = np.column_stack((tilted[:, :2], np.ones(self._count)))
        bearings = np.einsum("nij,nj->ni", self._frames, local / np.linalg.norm(local, axis=1)[:, None])
        poses, inverse = self._poses(float(x[0])), tilted[:, 2:]
        turns, places = poses.as_matrix()[..., :3, :3], poses.translation
        seen = np.einsum("kji,knj->kni", turns, bearings - inverse * places[:, None, :])
        pixels, valid = self._camera.project(seen)
        rest = np.where(valid[..., None], pixels - self._tracks, 1e3)
        return np.asarray(rest.ravel())

    def _pattern(self) -> lil_matrix:
        """Return which residual depends on what."""
        images, n = len(self._views.times), self._count
        pattern = lil_matrix((2 * images * n, 1 + 3 * n), dtype=np.int8)
        pattern[:, 0] = 1
        rows = np.arange(2 * images * n).reshape(images, n, 2)
        for j in range(n):
            pattern[rows[:, j].ravel(), 1 + 3 * j : 4 + 3 * j] = 1
        return pattern
