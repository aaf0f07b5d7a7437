"""Several views refined together with what is known beside the pixels: displacements, camera parameters.

Least squares on whitened residuals, of the pixels w_vj (π(R_vᵀ(h_j − t_v)) + S_vj z − p_vj) and of what was
measured otherwise, by Levenberg-Marquardt with the points eliminated (Schur complement). S = ∂π/∂θ stays:
parameters that compensate each other, as ξ and focal length do, may be far off while the pixels are not.
The unknowns that all points share, "common", are the poses of the views after the first, (t, δ) of each, δ on
the right, and the camera's parameters in independent directions of one σ each.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from omniservo.cameras import UnifiedCamera
from omniservo.estimation.known_displacements import DisplacementPrior
from omniservo.geometry.arrays import FloatArray

FIRST_DAMPING = 1e-6
MOST_DAMPING = 1e8

SETTLED = 1e-10
"""A step that promises less than this part of the cost is the last."""

NEARLY_SETTLED = 1e-6
"""of the cost; where rounding, or points almost at infinity, allow no more"""

FAR_POINT_DAMPING = 1e-10
"""Relative weight that keeps the block of a point without parallax regular; its variance stays huge."""

SCALE_WEIGHT = 1e6
"""of the length that is held where nothing else fixes the scale, relative to all translations"""


@dataclass(frozen=True, eq=False)
class ViewProblem:
    """What is measured."""

    camera: UnifiedCamera
    """as stated"""
    pixels: FloatArray
    """(v, m, 2) [px]"""
    weights: FloatArray
    """(v, m) 1/σ of a pixel's coordinates [1/px]; 0: not seen"""
    by_camera: FloatArray
    """(v, m, 2, q) what independent deviations of the camera's parameters, of one σ each, do to its pixels
    there [px]; q = 0: the parameters are taken as exact"""
    prior: DisplacementPrior | None = None
    """displacements of the camera; None: the images do not tell the scale"""

    def measured(self, deviation: FloatArray) -> FloatArray:
        """Return the pixels (v, m, 2) that the stated camera would have shown, were the true one so off."""
        return np.asarray(self.pixels - self.by_camera @ deviation)


class ViewState(NamedTuple):
    """A guess, or the answer."""

    poses: FloatArray
    """(v, 7) reference_T_camera: quaternion, translation; the first stays"""
    points: FloatArray
    """(m, 3)"""
    deviation: FloatArray
    """(q,) of the camera's parameters [σ]"""


class Slopes(NamedTuple):
    """Whitened residuals and their derivatives, 0 where a point is not seen."""

    residuals: FloatArray
    """(v, m, 2)"""
    by_pose: FloatArray
    """(v, m, 2, 6)"""
    by_point: FloatArray
    """(v, m, 2, 3)"""
    by_camera: FloatArray
    """(v, m, 2, q)"""


class AdjustmentBlocks(NamedTuple):
    """JᵀJ and Jᵀr of the pixels alone, c = 6(v − 1) + q common unknowns."""

    common: FloatArray
    """(c, c)"""
    gradient: FloatArray
    """(c,)"""
    own: FloatArray
    """(m, 3, 3) of each point"""
    pull: FloatArray
    """(m, 3)"""
    mixed: FloatArray
    """(m, c, 3)"""


def adjust(problem: ViewProblem, state: ViewState, most_steps: int) -> tuple[float, bool, ViewState]:
    """Return the whole cost, whether it is a minimum, and where.

    Without displacements the scale is that of the view farthest from the first: its distance stays.
    """
    held = None if problem.prior is not None else _farthest(state.poses)
    length = 1.0 if held is None else float(np.linalg.norm(state.poses[held, 4:]))
    damping, promised, cost = FIRST_DAMPING, math.inf, cost_of(problem, state)
    if not cost < math.inf:
        return cost, False, state
    blocks, extra, pull = _system(problem, state, held)
    for _ in range(most_steps):
        step, moves, promised = _step(blocks, extra, pull, damping)
        trial = _moved(state, step, moves, problem.by_camera.shape[3])
        if held is not None:
            trial = _rescaled(trial, length / float(np.linalg.norm(trial.poses[held, 4:])))
        reached = cost_of(problem, trial) if math.isfinite(promised) else math.inf
        small = promised <= SETTLED * cost + 1e-20
        if reached <= cost:
            state, cost = trial, reached
            if small:
                return cost, True, state
            blocks, extra, pull = _system(problem, state, held)
            damping = max(0.1 * damping, 1e-12)
            continue
        if small:
            return cost, True, state
        damping *= 10.0
        if damping > MOST_DAMPING:
            break
    return cost, bool(promised <= NEARLY_SETTLED * cost), state


def cost_of(problem: ViewProblem, state: ViewState) -> float:
    """Return Σ of all whitened squares; infinity where a point that is seen leaves the camera's domain."""
    used = problem.weights > 0.0
    local = np.stack([_seen_from(pose, state.points) for pose in state.poses])
    pixels, valid = problem.camera.project(local[used])
    if not valid.all():
        return math.inf
    gaps = (pixels - problem.measured(state.deviation)[used]) * problem.weights[used][:, None]
    total = float(np.square(gaps).sum() + np.square(state.deviation).sum())
    if problem.prior is not None:
        total += float(np.square(problem.prior.residuals(state.poses)).sum())
    return total


def slopes_of(problem: ViewProblem, state: ViewState) -> Slopes:
    """Return residuals and derivatives at a state."""
    v, m = problem.weights.shape
    local = np.stack([_seen_from(pose, state.points) for pose in state.poses])
    pixels, slopes, valid = problem.camera.project_jacobian(local)
    used = valid & (problem.weights > 0.0)
    weights = problem.weights[used][:, None, None]
    residuals, by_point = np.zeros((v, m, 2)), np.zeros((v, m, 2, 3))
    by_pose = np.zeros((v, m, 2, 6))
    residuals[used] = weights[:, 0] * (pixels[used] - problem.measured(state.deviation)[used])
    turns = Rotation.from_quat(state.poses[:, :4]).as_matrix()[np.nonzero(used)[0]]
    slopes, local = weights * slopes[used], local[used]
    by_point[used] = slopes @ np.swapaxes(turns, 1, 2)
    by_pose[used] = np.concatenate((-by_point[used], np.cross(slopes, local[:, None, :])), axis=2)
    by_camera = np.where(used, problem.weights, 0.0)[:, :, None, None] * problem.by_camera
    return Slopes(residuals, by_pose, by_point, by_camera)


def blocks_of(slopes: Slopes) -> AdjustmentBlocks:
    """Return the normal equations of the pixels."""
    v, m = slopes.residuals.shape[:2]
    q, size = slopes.by_camera.shape[3], 6 * (v - 1)
    common, mixed = np.zeros((size + q, size + q)), np.zeros((m, size + q, 3))
    gradient = np.zeros(size + q)
    flat = slopes.by_camera.reshape(2 * v * m, q)
    common[size:, size:] = flat.T @ flat
    gradient[size:] = flat.T @ slopes.residuals.ravel()
    mixed[:, size:] = np.einsum("vmcq,vmci->mqi", slopes.by_camera, slopes.by_point)
    for view in range(1, v):
        at, here = slice(6 * view - 6, 6 * view), slopes.by_pose[view].reshape(-1, 6)
        common[at, at] = here.T @ here
        gradient[at] = here.T @ slopes.residuals[view].ravel()
        common[at, size:] = here.T @ slopes.by_camera[view].reshape(2 * m, q)
        common[size:, at] = common[at, size:].T
        mixed[:, at] = np.swapaxes(slopes.by_pose[view], 1, 2) @ slopes.by_point[view]
    own = np.einsum("vmci,vmck->mik", slopes.by_point, slopes.by_point)
    pull = np.einsum("vmci,vmc->mi", slopes.by_point, slopes.residuals)
    return AdjustmentBlocks(common, gradient, own, pull, mixed)


def reduced(blocks: AdjustmentBlocks, inverse: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the Schur complement (c, c) and K (m, 3, c) = V⁻¹Wᵀ, by which points follow: dh = own − K dc."""
    follow = inverse @ np.swapaxes(blocks.mixed, 1, 2)
    m, _, c = follow.shape
    flat = np.swapaxes(blocks.mixed, 0, 1).reshape(c, 3 * m)
    return np.asarray(blocks.common - flat @ follow.reshape(3 * m, c)), follow


def extra_information(
    problem: ViewProblem, state: ViewState, held: int | None, weight: float
) -> tuple[FloatArray, FloatArray]:
    """Return what is known beside the pixels: its JᵀJ (c, c) and Jᵀr (c,).

    ``held``: a view whose distance from the first stays, with this ``weight``; no residual.
    """
    v, q = len(state.poses), problem.by_camera.shape[3]
    size = 6 * (v - 1)
    information, gradient = np.zeros((size + q, size + q)), np.zeros(size + q)
    information[size:, size:], gradient[size:] = np.eye(q), state.deviation
    if problem.prior is not None:
        rows = problem.prior.slopes(state.poses)
        information[:size, :size] += rows.T @ rows
        gradient[:size] += rows.T @ problem.prior.residuals(state.poses)
    if held is not None:
        at = slice(6 * held - 6, 6 * held - 3)
        along = state.poses[held, 4:] / np.linalg.norm(state.poses[held, 4:])
        information[at, at] += weight * np.outer(along, along)
    return information, gradient


def _system(
    problem: ViewProblem, state: ViewState, held: int | None
) -> tuple[AdjustmentBlocks, FloatArray, FloatArray]:
    blocks = blocks_of(slopes_of(problem, state))
    weight = 0.0
    if held is not None:
        at = slice(6 * held - 6, 6 * held - 3)
        weight = SCALE_WEIGHT * float(np.trace(blocks.common[at, at]))
    return blocks, *extra_information(problem, state, held, weight)


def _step(
    blocks: AdjustmentBlocks, extra: FloatArray, pull: FloatArray, damping: float
) -> tuple[FloatArray, FloatArray, float]:
    """Return the step of the common unknowns (c,) and of the points (m, 3), and what it promises."""
    diagonal = np.arange(3)
    own = blocks.own.copy()
    own[:, diagonal, diagonal] *= 1.0 + damping
    empty = np.trace(own, axis1=1, axis2=2) == 0.0
    own += FAR_POINT_DAMPING * np.trace(own, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    own[empty] = np.eye(3)
    inverse = np.asarray(np.linalg.inv(own), dtype=np.float64)
    matrix, follow = reduced(blocks, inverse)
    matrix += extra + damping * np.diag(np.diag(blocks.common))
    gradient = blocks.gradient + pull
    moves = np.einsum("mij,mj->mi", inverse, blocks.pull)
    try:
        step = -np.linalg.solve(matrix, gradient - np.einsum("mci,mi->c", blocks.mixed, moves))
    except np.linalg.LinAlgError:
        return np.zeros(len(gradient)), np.zeros_like(moves), math.inf
    moves = -moves - follow @ step
    return step, moves, float(-gradient @ step - np.sum(blocks.pull * moves))


def _moved(state: ViewState, step: FloatArray, moves: FloatArray, q: int) -> ViewState:
    poses, size = state.poses.copy(), len(step) - q
    steps = step[:size].reshape(-1, 6)
    poses[1:, :4] = (Rotation.from_quat(poses[1:, :4]) * Rotation.from_rotvec(steps[:, 3:])).as_quat()
    poses[1:, 4:] += steps[:, :3]
    return ViewState(poses, state.points + moves, state.deviation + step[size:])


def _rescaled(state: ViewState, factor: float) -> ViewState:
    poses = state.poses.copy()
    poses[:, 4:] *= factor
    return state._replace(poses=poses, points=factor * state.points)


def _farthest(poses: FloatArray) -> int:
    return int(np.linalg.norm(poses[:, 4:], axis=1).argmax())


def _seen_from(pose: FloatArray, points: FloatArray) -> FloatArray:
    rotation = Rotation.from_quat(pose[:4]).as_matrix()
    return np.asarray((points - pose[4:]) @ rotation)
