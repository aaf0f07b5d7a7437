"""Displacements of the camera between views that are known beside the pixels, as from a robot's arm."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.errors import InputError, spelled
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray, IntArray, finite_array, finite_number
from omniservo.geometry.covariances import is_covariance
from omniservo.short_repr import short_repr

STEP = 1e-6
"""of the differences that carry the errors of poses over to displacements [m], [rad]"""


@with_field_docs
@dataclass(frozen=True, eq=False)
class KnownDisplacements:
    """Displacements of the camera between some views, with the covariance of their errors.

    The k displacements are first_T_second, each with the error (dt, δ): true translation less the stated one
    in the first camera's frame [m], and the rotation vector on the right [rad].
    """

    pairs: npt.ArrayLike
    """(k, 2) views (first, second)"""
    first_T_second: Sequence[RigidTransform]
    """(k,) coordinates in the second view's camera to those in the first one's [m]"""
    covariance: npt.ArrayLike
    """(6k, 6k) of all errors together; or (6, 6): of each, all independent. Positive definite: what is not
    known, such as a direction, has a large variance, and nothing has none."""

    __repr__ = short_repr

    @classmethod
    def of_poses(
        cls,
        base_T_flange: Sequence[RigidTransform],
        flange_T_camera: RigidTransform,
        *,
        position_sigma: float,
        rotation_sigma: float,
        mount_covariance: npt.ArrayLike | None = None,
        views: Sequence[int] | None = None,
    ) -> KnownDisplacements:
        """Return the displacements between views at which an arm reported its poses, from the first to all.

        Errors of one reported pose stand in all displacements that begin or end there, and an error of the
        mount in all of them: the covariance of all together says so.

        Args:
            base_T_flange: (v,) poses as the arm reports them.
            flange_T_camera: the mount, as `calibrate_hand_eye` gives it.
            position_sigma: σ of a reported position per axis [m], > 0 (`HandEye.robot_position_m`).
            rotation_sigma: σ of a reported rotation per axis [rad], > 0.
            mount_covariance: (6, 6) of the mount, as `HandEye.covariance`. None: the mount is exact.
            views: (v,) the rows of the pixels that these are. None: 0 … v − 1.

        Raises:
            InputError: fewer than two poses, or illegal numbers.
        """
        rows = list(range(len(base_T_flange)) if views is None else views)
        if len(rows) != len(base_T_flange) or len(rows) < 2:
            words = f"{len(base_T_flange)} poses and {len(rows)} views given; as many, at least two"
            raise InputError(f"base_T_flange: {words}, are needed")
        sigmas = [finite_number("position_sigma", position_sigma, above=0.0)] * 3
        sigmas += [finite_number("rotation_sigma", rotation_sigma, above=0.0)] * 3
        mount = np.zeros((6, 6)) if mount_covariance is None else mount_covariance
        spread = finite_array("mount_covariance", mount, (6, 6))
        if not is_covariance(spread):
            raise InputError("mount_covariance: a symmetric matrix without negative eigenvalues is needed")
        flanges, k = list(base_T_flange), len(rows) - 1
        moves = _moves(flanges, flange_T_camera)
        covariance = np.zeros((6 * k, 6 * k))
        for view, sigma in ((view, sigma) for view in range(k + 1) for sigma in enumerate(sigmas)):
            other = list(flanges)
            other[view] = _nudged(flanges[view], sigma[0])
            row = sigma[1] * _differences(moves, _moves(other, flange_T_camera)) / STEP
            covariance += np.outer(row, row)
        by_mount = np.stack(
            [_differences(moves, _moves(flanges, _nudged(flange_T_camera, axis))) for axis in range(6)]
        )
        covariance += by_mount.T @ spread @ by_mount / STEP**2
        return cls(np.array([(rows[0], row) for row in rows[1:]]), tuple(moves), covariance)


def _moves(flanges: Sequence[RigidTransform], mount: RigidTransform) -> list[RigidTransform]:
    cameras = [flange * mount for flange in flanges]
    return [cameras[0].inv() * camera for camera in cameras[1:]]


def _nudged(pose: RigidTransform, axis: int) -> RigidTransform:
    """Return a pose with an error of one step in (translation, rotation on the right)."""
    step = np.zeros(6)
    step[axis] = STEP
    return RigidTransform.from_components(
        pose.translation + step[:3], pose.rotation * Rotation.from_rotvec(step[3:])
    )


def _differences(moves: Sequence[RigidTransform], others: Sequence[RigidTransform]) -> FloatArray:
    """Return (dt, δ) of each from one list to the other, side by side (6k,)."""
    steps = [
        np.concatenate((b.translation - a.translation, (a.rotation.inv() * b.rotation).as_rotvec()))
        for a, b in zip(moves, others, strict=True)
    ]
    return np.concatenate(steps)


@dataclass(frozen=True, eq=False)
class DisplacementPrior:
    """The same for the adjustment: whitened by the root of the covariance's inverse."""

    pairs: IntArray
    """(k, 2)"""
    moves: tuple[RigidTransform, ...]
    covariance: FloatArray
    """(6k, 6k)"""
    whitening: FloatArray
    """(6k, 6k) W, WᵀW the inverse of the covariance"""

    @classmethod
    def of(cls, given: KnownDisplacements, views: int) -> DisplacementPrior:
        """Return what displacements say of so many views.

        Raises:
            InputError: illegal views, poses or covariance.
        """
        pairs = np.asarray(given.pairs)
        if pairs.ndim != 2 or pairs.shape[1] != 2 or pairs.dtype.kind not in "iu" or not len(pairs):
            raise InputError(
                f"scale: pairs: {pairs.dtype} {pairs.shape} given; whole numbers (k, 2) are needed"
            )
        if not 0 <= pairs.min() <= pairs.max() < views:
            raise InputError(
                f"scale: pairs: {pairs.min()} to {pairs.max()} given; legal: views 0 to {views - 1}"
            )
        if (alike := pairs[:, 0] == pairs[:, 1]).any():
            raise InputError(f"scale: pairs: view {pairs[alike][0, 0]} given twice; two views are needed")
        moves = tuple(given.first_T_second)
        if len(moves) != len(pairs) or not all(_is_pose(move) for move in moves):
            raise InputError(
                f"scale: first_T_second: {len(pairs)} single poses are needed, one for each pair"
            )
        spread = finite_array("scale: covariance", given.covariance, (None, None))
        if spread.shape == (6, 6):
            spread = np.asarray(np.kron(np.eye(len(pairs)), spread), dtype=np.float64)
        if spread.shape != (6 * len(pairs), 6 * len(pairs)):
            legal = f"(6, 6) or ({6 * len(pairs)}, {6 * len(pairs)})"
            raise InputError(f"scale: covariance: shape {spread.shape} given; legal: {legal}")
        return cls._whitened(pairs.astype(np.int64), moves, spread)

    @classmethod
    def _whitened(
        cls, pairs: IntArray, moves: tuple[RigidTransform, ...], spread: FloatArray
    ) -> DisplacementPrior:
        unit = np.sqrt(np.maximum(np.diag(spread), 0.0))
        if not unit.min() > 0.0:
            raise InputError("scale: covariance: a variance of 0 given; every error has some")
        even = spread / np.outer(unit, unit)
        values = np.linalg.eigvalsh(0.5 * (even + even.T))
        if np.abs(even - even.T).max() > 1e-6 or values[0] < 1e-12:
            raise InputError("scale: covariance: a symmetric, positive definite matrix is needed")
        root = np.linalg.cholesky(0.5 * (even + even.T))
        return cls(pairs, moves, spread, np.linalg.solve(root, np.diag(1.0 / unit)))

    def among(self, views: IntArray) -> DisplacementPrior | None:
        """Return what is said of these views, sorted, in their own numbers; None: nothing."""
        kept = np.flatnonzero(np.isin(self.pairs, views).all(axis=1))
        if not len(kept):
            return None
        rows = (6 * kept[:, None] + np.arange(6)).ravel()
        moves = tuple(self.moves[k] for k in kept)
        pairs = np.searchsorted(views, self.pairs[kept])
        return self._whitened(pairs, moves, self.covariance[np.ix_(rows, rows)])

    def residuals(self, poses: FloatArray) -> FloatArray:
        """Return the whitened errors (6k,) that poses (v, 7) leave."""
        return np.asarray(self.whitening @ self._errors(poses).ravel())

    def slopes(self, poses: FloatArray) -> FloatArray:
        """Return their derivative (6k, 6(v − 1)) by the poses after the first."""
        rows = np.zeros((len(self.pairs), 6, len(poses), 6))
        errors = self._errors(poses)
        for k, (i, j) in enumerate(self.pairs):
            first = Rotation.from_quat(poses[i, :4]).as_matrix()
            second = Rotation.from_quat(poses[j, :4]).as_matrix()
            bent = np.eye(3) + 0.5 * _cross(errors[k, 3:])  # the rotation vector's derivative, to first order
            rows[k, :3, j, :3] += first.T
            rows[k, :3, i, :3] -= first.T
            rows[k, :3, i, 3:] += _cross(first.T @ (poses[j, 4:] - poses[i, 4:]))
            rows[k, 3:, j, 3:] += bent
            rows[k, 3:, i, 3:] -= bent @ second.T @ first
        return np.asarray(self.whitening @ rows.reshape(6 * len(self.pairs), -1)[:, 6:])

    def scale_of(self, poses: FloatArray) -> float:
        """Return by what poses have to be scaled for the best known displacement to be as long as stated."""
        stated, found, sure = [], [], []
        for k, (i, j) in enumerate(self.pairs):
            length = float(np.linalg.norm(self.moves[k].translation))
            spread = self.covariance[6 * k : 6 * k + 3, 6 * k : 6 * k + 3]
            stated.append(length)
            found.append(float(np.linalg.norm(poses[j, 4:] - poses[i, 4:])))
            sure.append(length**2 / max(float(np.trace(spread)), 1e-300))
        best = int(np.argmax(sure))
        return stated[best] / found[best] if found[best] > 0.0 and stated[best] > 0.0 else math.nan

    def pose_of(self, view: int, poses: FloatArray, placed: Any) -> FloatArray | None:
        """Return the pose (7,) that the displacements give a view, from one that is placed; None: none."""
        for k, (i, j) in enumerate(self.pairs):
            if view not in (i, j) or not placed[j if view == i else i]:
                continue
            known, move = (j, self.moves[k].inv()) if view == i else (i, self.moves[k])
            pose = (
                RigidTransform.from_components(poses[known, 4:], Rotation.from_quat(poses[known, :4])) * move
            )
            return np.concatenate((pose.rotation.as_quat(), pose.translation))
        return None

    def sigmas_of(self, view: int) -> tuple[float, float]:
        """Return the largest σ of the displacements of a view, per axis [m], [rad]."""
        rows = [k for k, pair in enumerate(self.pairs) if view in pair]
        sigmas = np.sqrt(np.diag(self.covariance)).reshape(-1, 2, 3)[rows]
        return float(sigmas[:, 0].max()), float(sigmas[:, 1].max())

    def _errors(self, poses: FloatArray) -> FloatArray:
        """Return (dt, δ) (k, 6) of the poses' displacements from the stated ones."""
        errors = np.empty((len(self.pairs), 6))
        for k, (i, j) in enumerate(self.pairs):
            first, second = (Rotation.from_quat(poses[at, :4]) for at in (i, j))
            errors[k, :3] = first.inv().apply(poses[j, 4:] - poses[i, 4:]) - self.moves[k].translation
            errors[k, 3:] = (self.moves[k].rotation.inv() * first.inv() * second).as_rotvec()
        return errors


def _cross(v: FloatArray) -> FloatArray:
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def _is_pose(value: Any) -> bool:
    if not isinstance(value, RigidTransform) or not value.single:
        raise InputError(f"scale: first_T_second: {spelled(value)} given; single poses are needed")
    return True
