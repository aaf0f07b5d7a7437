"""First-order uncertainty of several views and of the points they see, in the gauge that a length fixes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from omniservo.cameras import ModelError, UnifiedCamera
from omniservo.estimation.refinement.bundle_adjustment import empty_view_blocks, linearise
from omniservo.estimation.uncertainty.joint_uncertainty import JointUncertainty
from omniservo.estimation.view_scale import GaugeLength
from omniservo.geometry.arrays import BoolArray, FloatArray

FAR_POINT_DAMPING = 1e-10
"""Relative weight that keeps the block of a point without parallax regular; its variance stays huge."""

NEGLIGIBLE_VARIANCE = 1e-14
"""Directions with a smaller part of the largest variance are left out of a joint law."""


@dataclass(frozen=True, eq=False)
class ViewUncertainty:
    """The law of x = (poses of the views after the first; points) for pixel noise of 1 px.

    Points follow the poses and have errors of their own: dh = −K dc + e with cov(dc) = C, cov(e) = V⁻¹.
    No picture shows the scale: x moves along g = (t, 0; h) freely. A length ℓ that is known stops that: with
    a = ∂ log ℓ/∂x, dx becomes dx − g (a·dx), so that Σ becomes Σ − g(Σa)ᵀ − (Σa)gᵀ + (aᵀΣa) g gᵀ.
    """

    poses: FloatArray
    """(6k, 6k) C"""
    follow: FloatArray
    """(m, 3, 6k) K"""
    own: FloatArray
    """(m, 3, 3) V⁻¹"""
    gauge: tuple[FloatArray, FloatArray]
    """g of the poses (6k,) and of the points (m, 3)"""
    moved: tuple[FloatArray, FloatArray]
    """Σa likewise"""
    scale_variance: float
    """aᵀΣa"""
    of_camera: tuple[FloatArray, FloatArray]
    """what independent errors of the camera's model do to the poses (f, 6k) and the points (f, m, 3)"""

    @classmethod
    def of_views(
        cls,
        camera: UnifiedCamera,
        pixels: FloatArray,
        seen: BoolArray,
        poses: FloatArray,
        points: FloatArray,
        length: GaugeLength,
    ) -> ViewUncertainty | None:
        """Return the law at a minimum; None where the views do not determine it.

        ``pixels`` (v, m, 2), ``seen`` (v, m), ``poses`` (v, 7) with the first the identity,
        ``points`` (m, 3).
        """
        v, m = seen.shape
        size = 6 * (v - 1)
        blocks = empty_view_blocks(v, m)
        linearise(camera.parameters, pixels, seen, poses, points, blocks)
        normal, own, mixed = blocks.poses, blocks.points, blocks.mixed
        own += FAR_POINT_DAMPING * np.trace(own, axis1=1, axis2=2)[:, None, None] * np.eye(3)
        gauge_poses = np.zeros((v - 1, 6))
        gauge_poses[:, :3] = poses[1:, 4:]
        along = gauge_poses.ravel()
        try:
            inverse: FloatArray = np.linalg.inv(own).astype(np.float64)
            follow: FloatArray = inverse @ np.swapaxes(mixed, 1, 2)
            reduced = normal - np.einsum("mai,mib->ab", mixed, follow)
            # Any weight along the scale will do: what it adds is taken away again with the gauge.
            reduced += np.trace(normal) / float(along @ along) * np.outer(along, along)
            spread: FloatArray = np.linalg.inv(0.5 * (reduced + reduced.T)).astype(np.float64)
        except np.linalg.LinAlgError:
            return None
        if not np.isfinite(spread).all() or np.diag(spread).min() <= 0.0:
            return None
        by_centres, by_points = length.log_gradient(poses[:, 4:], points)
        by_poses = np.zeros((v - 1, 6))
        by_poses[:, :3] = by_centres[1:]
        moved = spread @ (by_poses.ravel() - np.einsum("mia,mi->a", follow, by_points))
        moved_points = np.einsum("mij,mj->mi", inverse, by_points) - follow @ moved
        variance = float(by_poses.ravel() @ moved + (by_points * moved_points).sum())
        shared = np.empty((0, size)), np.empty((0, m, 3))
        if camera.model_error is not None:
            slopes = _view_slopes(camera, pixels, seen, poses, points)
            shared = _answers(camera.model_error, pixels, slopes, (spread, follow, inverse))
            ratios = shared[0] @ by_poses.ravel() + np.einsum("fmi,mi->f", shared[1], by_points)
            shared = shared[0] - np.outer(ratios, along), shared[1] - ratios[:, None, None] * points
        return cls(spread, follow, inverse, (along, points), (moved, moved_points), variance, shared)

    def pose_covariance(self, view: int, variance: float = 1.0) -> FloatArray:
        """Return that of (t, δ) (6, 6) of a view, 1 … k, for pixel noise of this ``variance`` [px²]."""
        at = slice(6 * view - 6, 6 * view)
        moves = self.of_camera[0][:, at]
        own = self.poses[at, at] + self._fixed(self.gauge[0][at], self.moved[0][at])
        return np.asarray(variance * own + moves.T @ moves)

    def point_covariances(self, variance: float = 1.0) -> FloatArray:
        """Return that of each point (m, 3, 3), likewise."""
        spread = self.own + self.follow @ self.poses @ np.swapaxes(self.follow, 1, 2)
        g, y = self.gauge[1][:, :, None], self.moved[1][:, :, None]
        gt, yt = np.swapaxes(g, 1, 2), np.swapaxes(y, 1, 2)
        moves = self.of_camera[1]
        shared = np.einsum("fmi,fmj->mij", moves, moves)
        return np.asarray(variance * (spread - g * yt - y * gt + self.scale_variance * g * gt) + shared)

    def law(self, view: int, sigma: float, freedom: float) -> JointUncertainty:
        """Return the joint law of a view's pose and the points for pixel noise ``sigma`` [px]."""
        m = len(self.own)
        at = slice(6 * view - 6, 6 * view)
        stacked = np.concatenate((np.eye(len(self.poses))[at], -self.follow.reshape(3 * m, -1)))
        joint = stacked @ self.poses @ stacked.T
        for j in range(m):
            joint[6 + 3 * j : 9 + 3 * j, 6 + 3 * j : 9 + 3 * j] += self.own[j]
        g = np.concatenate((self.gauge[0][at], self.gauge[1].ravel()))
        joint += self._fixed(g, np.concatenate((self.moved[0][at], self.moved[1].ravel())))
        values, vectors = np.linalg.eigh(joint)
        kept = values > NEGLIGIBLE_VARIANCE * values[-1]
        return JointUncertainty(
            noise=(sigma * vectors[:, kept] * np.sqrt(values[kept])).T,
            own=np.zeros((m, 3, 3)),
            freedom=freedom,
            calibration=np.concatenate(
                (self.of_camera[0][:, at], self.of_camera[1].reshape(-1, 3 * m)), axis=1
            ),
            camera=np.empty((len(self.of_camera[0]), 0)),
        )

    def _fixed(self, g: FloatArray, y: FloatArray) -> FloatArray:
        return self.scale_variance * np.outer(g, g) - np.outer(g, y) - np.outer(y, g)


def _view_slopes(
    camera: UnifiedCamera, pixels: FloatArray, seen: BoolArray, poses: FloatArray, points: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return ∂pixel/∂(pose of its view) (v, m, 2, 6) and ∂pixel/∂point (v, m, 2, 3); 0 where not seen."""
    v, m = seen.shape
    by_pose, by_point = np.zeros((v, m, 2, 6)), np.zeros((v, m, 2, 3))
    for view in range(v):
        rotation = Rotation.from_quat(poses[view, :4]).as_matrix()
        local = (points - poses[view, 4:]) @ rotation
        _, slopes, valid = camera.project_jacobian(local)
        used = (valid & seen[view])[:, None, None]
        by_point[view] = np.where(used, slopes @ rotation.T, 0.0)
        turned = np.cross(slopes, local[:, None, :])
        by_pose[view] = np.where(used, np.concatenate((-slopes @ rotation.T, turned), axis=2), 0.0)
    return by_pose, by_point


def _answers(
    error: ModelError,
    pixels: FloatArray,
    slopes: tuple[FloatArray, FloatArray],
    law: tuple[FloatArray, FloatArray, FloatArray],
) -> tuple[FloatArray, FloatArray]:
    """Return what independent errors of one camera do to the poses (f, 6k) and points (f, m, 3)."""
    (by_pose, by_point), (spread, follow, inverse) = slopes, law
    v, m = by_pose.shape[:2]
    moves = error.moves(np.nan_to_num(np.swapaxes(pixels, 0, 1)).reshape(m, 2 * v))
    moves = moves.reshape(len(moves), m, v, 2)
    pull_points = np.einsum("fmvc,vmci->fmi", moves, by_point)
    pull_poses = np.einsum("fmvc,vmci->fvi", moves, by_pose)[:, 1:].reshape(len(moves), -1)
    own = np.einsum("mij,fmj->fmi", inverse, pull_points)
    poses = (pull_poses - np.einsum("mia,fmi->fa", follow, pull_points)) @ spread
    return poses, own - np.einsum("mia,fa->fmi", follow, poses)
