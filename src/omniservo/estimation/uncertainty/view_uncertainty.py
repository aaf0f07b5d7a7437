"""First-order uncertainty of several views and of the points they see.

Whitened pixels displaced by e move the common unknowns (poses, camera) by dc = C Σ (Jᵀ − W V⁻¹Bᵀ) e and each
point by dh = V⁻¹Bᵀe − K dc: the response of the optimum. Whatever is in error comes through it: the pixels'
own noise; errors of the camera's model, alike over regions of the image and the same in every view, so that
views do not average them out; what was stated of the camera's parameters and of displacements.

No image shows the scale: without displacements x moves along g = (t, 0; h) freely. A length ℓ that is known
stops that: with a = ∂ log ℓ/∂x, dx becomes dx − g (a·dx).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from omniservo.cameras import ModelError
from omniservo.estimation.refinement.view_adjustment import (
    FAR_POINT_DAMPING,
    AdjustmentBlocks,
    Slopes,
    ViewProblem,
    ViewState,
    blocks_of,
    extra_information,
    reduced,
    slopes_of,
)
from omniservo.estimation.uncertainty.joint_uncertainty import JointUncertainty
from omniservo.estimation.uncertainty.shared_errors import shared_part
from omniservo.estimation.view_scale import GaugeLength
from omniservo.geometry.arrays import FloatArray

NEGLIGIBLE_VARIANCE = 1e-14
"""Directions with a smaller part of the largest variance are left out of a joint law."""

ROWS_AT_ONCE = 64
"""errors of the camera's model that are worked on together: bounds the memory"""


@dataclass(frozen=True, eq=False)
class ViewResponse:
    """How the optimum answers displaced pixels."""

    slopes: Slopes
    blocks: AdjustmentBlocks
    inverse: FloatArray
    """(m, 3, 3) V⁻¹"""
    follow: FloatArray
    """(m, 3, c) K"""
    spread: FloatArray
    """(c, c) C"""
    noise: FloatArray
    """(c, c) what C makes of independent noise of the pixels of 1"""
    known: FloatArray
    """(k, c) what independent errors of one σ, of what is known beside the pixels, do to the common ones"""

    @classmethod
    def at(cls, problem: ViewProblem, state: ViewState) -> ViewResponse | None:
        """Return it at a minimum; None where the views do not determine it."""
        slopes = slopes_of(problem, state)
        blocks = blocks_of(slopes)
        size = np.trace(blocks.own, axis1=1, axis2=2)[:, None, None]
        own = blocks.own + FAR_POINT_DAMPING * size * np.eye(3)
        held = None if problem.prior is not None else int(np.linalg.norm(state.poses[:, 4:], axis=1).argmax())
        try:
            inverse = np.asarray(np.linalg.inv(own), dtype=np.float64)
            of_pixels, follow = reduced(blocks, inverse)
            # Any weight along the scale will do: what it adds is taken away again with the gauge.
            extra, _ = extra_information(problem, state, held, float(np.trace(blocks.common)))
            matrix = of_pixels + extra
            if not np.diag(matrix).min() > 0.0:
                return None
            unit = 1.0 / np.sqrt(np.diag(matrix))
            spread = unit[:, None] * np.linalg.inv(unit[:, None] * (matrix + matrix.T) / 2.0 * unit) * unit
        except np.linalg.LinAlgError:
            return None
        if not np.isfinite(spread).all() or np.diag(spread).min() <= 0.0:
            return None
        noise = spread @ of_pixels @ spread
        q = problem.by_camera.shape[3]
        known = spread[len(spread) - q :]
        if problem.prior is not None:
            of_poses = spread[: len(spread) - q]
            known = np.concatenate((known, problem.prior.slopes(state.poses) @ of_poses))
        return cls(slopes, blocks, inverse, follow, spread, 0.5 * (noise + noise.T), known)

    @property
    def pose_size(self) -> int:
        """6(v − 1), how many of the common unknowns are poses."""
        return 6 * (len(self.slopes.residuals) - 1)

    @property
    def parameters(self) -> float:
        """How many degrees of freedom of the residuals the unknowns take."""
        return 3.0 * len(self.inverse) + float(np.trace(self.spread @ self._of_pixels))

    @property
    def _of_pixels(self) -> FloatArray:
        return reduced(self.blocks, self.inverse)[0]

    def points_of(self, common: FloatArray) -> FloatArray:
        """Return what the points (f, m, 3) do where the common unknowns move by (f, c)."""
        return np.asarray(-np.einsum("mic,fc->fmi", self.follow, common))

    def answer(self, moves: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return what whitened pixels, displaced by (f, v, m, 2), do to the common ones and the points."""
        by_pose, by_point, by_camera = self.slopes.by_pose, self.slopes.by_point, self.slopes.by_camera
        pull = np.einsum("fvmc,vmci->fmi", moves, by_point, optimize=True)
        poses = np.einsum("fvmc,vmci->fvi", moves[:, 1:], by_pose[1:], optimize=True)
        camera = np.einsum("fvmc,vmcq->fq", moves, by_camera, optimize=True)
        own = np.einsum("mij,fmj->fmi", self.inverse, pull)
        gradient = np.concatenate((poses.reshape(len(moves), -1), camera), axis=1)
        common = (gradient - np.einsum("mci,fmi->fc", self.blocks.mixed, own, optimize=True)) @ self.spread
        return common, own + self.points_of(common)

    def left(self, moves: FloatArray, common: FloatArray, points: FloatArray) -> FloatArray:
        """Return the whitened residuals (f, v, m, 2) that displaced pixels leave, given their `answer`."""
        size, f = self.pose_size, len(moves)
        left = np.einsum("vmci,fmi->fvmc", self.slopes.by_point, points, optimize=True) - moves
        poses = common[:, :size].reshape(f, -1, 6)
        left[:, 1:] += np.einsum("vmci,fvi->fvmc", self.slopes.by_pose[1:], poses, optimize=True)
        left += np.einsum("vmcq,fq->fvmc", self.slopes.by_camera, common[:, size:], optimize=True)
        return np.asarray(left)

    def window_factor(self, pixels: FloatArray, windows: FloatArray) -> float:
        """Return λ, by which overlapping windows (v, m) [px] make the variance of the poses larger.

        See `shared_errors`; measurements of different views are independent.
        """
        size, shared = self.pose_size, np.zeros((self.pose_size, self.pose_size))
        reach = np.swapaxes(self.blocks.mixed, 0, 1).reshape(-1, len(self.inverse), 3)
        for view in range(len(pixels)):
            seen = np.flatnonzero(np.abs(self.slopes.by_point[view]).sum(axis=(1, 2)) > 0.0)
            if not len(seen):
                continue
            point = self.slopes.by_point[view, seen]
            gradient = -np.einsum(
                "cmi,mij,mkj->kcm", reach[:, seen], self.inverse[seen], point, optimize=True
            )
            if view:
                at = slice(6 * view - 6, 6 * view)
                gradient[:, at] += np.einsum("mki->kim", self.slopes.by_pose[view, seen])
            gradient[:, size:] += np.einsum("mkq->kqm", self.slopes.by_camera[view, seen])
            answers = np.einsum("bc,kcm->kbm", self.spread[:size], gradient, optimize=True)
            overlap = shared_part(pixels[view, seen], windows[view, seen])
            shared += sum(a @ overlap @ a.T for a in answers)
        values, vectors = np.linalg.eigh(self.noise[:size, :size])
        kept = values > 1e-9 * values[-1]
        axes = vectors[:, kept] / np.sqrt(values[kept])
        return max(1.0, float(np.mean(np.einsum("ak,ab,bk->k", axes, shared, axes))))


class ViewNoise(NamedTuple):
    """σ of the whitened pixels' own noise."""

    sigma: float
    """what covariances rest on"""
    freedom: float
    """degrees of freedom of σ; infinite where it was stated"""
    from_residuals: float
    """σ of all that residuals show"""
    raised: float = 1.0
    """by which factor stated errors are too small, since the residuals contradict them"""
    words: str = ""
    """says so"""


class ModelErrors(NamedTuple):
    """What independent errors of the camera's model do."""

    common: FloatArray
    """(f, c)"""
    points: FloatArray
    """(f, m, 3)"""
    squares: float
    """Σ of the whitened squares that they leave"""
    inner: FloatArray
    """(f, f) products of what any two of them leave"""

    @classmethod
    def of(cls, error: ModelError | None, problem: ViewProblem, response: ViewResponse) -> ModelErrors:
        """Return what they do in all views: the same field of errors in each."""
        m = problem.weights.shape[1]
        common, points, left = [], [], []
        for moves in _moves(error, problem):
            answer = response.answer(moves)
            common.append(answer[0])
            points.append(answer[1])
            remains = response.left(moves, *answer)[:, problem.weights > 0.0]
            left.append(remains.reshape(len(moves), -1).astype(np.float32))
        if not common:
            c = len(response.spread)
            return cls(np.empty((0, c)), np.empty((0, m, 3)), 0.0, np.empty((0, 0)))
        rows = np.concatenate(left)
        inner = (rows @ rows.T).astype(np.float64)
        return cls(np.concatenate(common), np.concatenate(points), float(np.trace(inner)), inner)


def _moves(error: ModelError | None, problem: ViewProblem) -> Iterator[FloatArray]:
    """Yield independent errors of the model at all pixels, whitened, some (f, v, m, 2) at a time."""
    if error is None:
        return
    seen = problem.weights > 0.0
    rows = error.rows(problem.pixels[seen])
    for start in range(0, len(rows), ROWS_AT_ONCE):
        some = rows[start : start + ROWS_AT_ONCE] * problem.weights[seen]
        for coordinate in range(2):
            moves = np.zeros((len(some), *problem.pixels.shape))
            moves[:, seen, coordinate] = some
            yield moves


@dataclass(frozen=True, eq=False)
class ViewUncertainty:
    """The law of x = (poses of the views after the first; points), in the gauge that the scale fixes.

    dx = τ (Σₖ zₖ noiseₖ + own) + Σ_q z_q shared_q, all z standard normal, τ as in `JointUncertainty`.
    """

    noise: FloatArray
    """(r, 6k + 3m) what each independent direction of the pixels' noise does to x"""
    own: FloatArray
    """(m, 3, 3) covariance of what that noise does to each point alone"""
    shared: FloatArray
    """(f, 6k + 3m) what independent errors of one σ, that all pixels share, do to x: of the camera's model
    and parameters, and of stated displacements"""
    freedom: float
    """ν of the pixels' σ; infinite where it was stated"""

    @classmethod
    def of_response(
        cls,
        response: ViewResponse,
        state: ViewState,
        length: GaugeLength | None,
        errors: ModelErrors,
        noise: ViewNoise,
        window_factor: float,
    ) -> ViewUncertainty:
        """Return the law; ``length`` None: displacements fix the scale."""
        m, size = len(response.inverse), response.pose_size
        values, vectors = np.linalg.eigh(response.noise)
        kept = values > NEGLIGIBLE_VARIANCE * max(values[-1], 0.0)
        common = noise.sigma * (vectors[:, kept] * np.sqrt(window_factor * values[kept])).T
        rows = _rows(common, response.points_of(common), size)
        shared = np.concatenate(
            (
                _rows(response.known, response.points_of(response.known), size),
                -noise.raised * _rows(errors.common, errors.points, size),
            )
        )
        own = noise.sigma**2 * response.inverse
        if length is None:
            return cls(rows, own, shared, noise.freedom)
        g, a = _gauge(length, state)
        lengths = np.flatnonzero(np.any(a[size:].reshape(m, 3) != 0.0, axis=1))
        roots = np.linalg.cholesky(own[lengths])
        alone = np.zeros((3 * len(lengths), size + 3 * m))
        for rank, j in enumerate(lengths):  # what these points do alone, the scale follows
            at = size + 3 * j
            alone[3 * rank : 3 * rank + 3, at : at + 3] = roots[rank].T
        own[lengths] = 0.0
        rows = np.concatenate((rows, alone))
        return cls(rows - np.outer(rows @ a, g), own, shared - np.outer(shared @ a, g), noise.freedom)

    @property
    def inflation(self) -> float:
        """ν/(ν − 2), covariance of Student's t over σ²; 1 where σ was given."""
        return self.freedom / (self.freedom - 2.0) if 2.0 < self.freedom < math.inf else 1.0

    def pose_covariance(self, view: int) -> FloatArray:
        """Return that of (t, δ) (6, 6) of a view, 1 … k."""
        at = slice(6 * view - 6, 6 * view)
        noise, shared = self.noise[:, at], self.shared[:, at]
        return np.asarray(self.inflation * noise.T @ noise + shared.T @ shared)

    def point_covariances(self) -> FloatArray:
        """Return that of each point (m, 3, 3)."""
        m = len(self.own)
        noise, shared = (rows[:, -3 * m :].reshape(-1, m, 3) for rows in (self.noise, self.shared))
        spread = self.own + np.einsum("fmi,fmj->mij", noise, noise)
        return np.asarray(self.inflation * spread + np.einsum("fmi,fmj->mij", shared, shared))

    def size_variance(self, points: FloatArray) -> float:
        """Return that of the logarithm of √Σ‖h‖² over the points (m, 3): of the scale of the structure."""
        a, m = points / float(np.square(points).sum()), len(points)
        noise, shared = (rows[:, -3 * m :] @ a.ravel() for rows in (self.noise, self.shared))
        alone = float(np.einsum("mi,mij,mj->", a, self.own, a))
        return self.inflation * (float(noise @ noise) + alone) + float(shared @ shared)

    def law(self, view: int) -> JointUncertainty:
        """Return the joint law of a view's pose and the points."""
        m = len(self.own)
        columns = np.concatenate((np.arange(6 * view - 6, 6 * view), np.arange(-3 * m, 0)))
        return JointUncertainty(
            noise=self.noise[:, columns],
            own=self.own.copy(),
            freedom=self.freedom,
            calibration=self.shared[:, columns],
            camera=np.empty((len(self.shared), 0)),
        )


def _rows(common: FloatArray, points: FloatArray, size: int) -> FloatArray:
    return np.concatenate((common[:, :size], points.reshape(len(common), 3 * points.shape[1])), axis=1)


def _gauge(length: GaugeLength, state: ViewState) -> tuple[FloatArray, FloatArray]:
    """Return g and a, (6k + 3m,) each."""
    centres, points = state.poses[:, 4:], state.points
    by_centres, by_points = length.log_gradient(centres, points)
    along, across = np.zeros((len(centres) - 1, 6)), np.zeros((len(centres) - 1, 6))
    along[:, :3], across[:, :3] = centres[1:], by_centres[1:]
    return (
        np.concatenate((along.ravel(), points.ravel())),
        np.concatenate((across.ravel(), by_points.ravel())),
    )
