"""Camera and poses adjusted together: Levenberg–Marquardt on θ and one pose a view.

The cost is Σ w ρ(‖e‖²) over corners, e = projection − corner [px], ρ(s) = s, or Cauchy's c² ln(1 + s/c²).
With A = ∂e/∂θ and B = ∂e/∂pose the normal equations are [[U, W], [Wᵀ, V]], V block diagonal (6 × 6 a view);
eliminating the poses leaves S = U − W V⁻¹ Wᵀ (9 × 9). A pose moves by a rotation vector δ on the left and a
translation: X' = exp(δ)·RX + t + τ.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from omniservo.calibration.adjustment.chart import Chart
from omniservo.calibration.adjustment.lens import (
    ALPHA,
    LARGEST_ALPHA,
    angles_of,
    project,
    project_jacobian,
)
from omniservo.calibration.adjustment.views import Views
from omniservo.geometry.arrays import BoolArray, FloatArray, IntArray

THETA, TURN, SHIFT, RESIDUAL = slice(0, 9), slice(9, 12), slice(12, 15), 15
"""The places of [A B e] (16,): by θ, by δ [rad] and τ [m], and the residual [px]"""

POSE = slice(9, 15)
"""of B: `TURN` and `SHIFT`"""

_LARGEST_DAMPING = 1e10
_ENOUGH = 1e-7
"""converged: a step would lower the cost by less than this part of the variance of one coordinate"""

_NEARLY = 1e-3
"""the same where the steps are used up, in a curved valley: θ is then within 0.03 standard deviations"""

_ENOUGH_ROBUST = 1e-3
"""the same with a robust loss, which is only ever a step on the way"""

_ENOUGH_POSES = 1e-6
"""a pose has converged when its cost falls by less than this part"""

_EXACT_PX = 1e-11
"""converged as well: the corners fit to rounding"""


@dataclass(frozen=True, eq=False)
class State:
    """A camera and the poses of the targets in it: X_camera = R X + t."""

    theta: FloatArray
    """(9,), see `lens`"""
    rotations: FloatArray
    """(V, 3, 3)"""
    translations: FloatArray
    """(V, 3) [m]"""

    def points(self, views: Views) -> FloatArray:
        """Return the target's points (N, 3) in the camera frame."""
        return self.turned(views) + self.translations[views.row_view]

    def turned(self, views: Views) -> FloatArray:
        """Return RX (N, 3)."""
        return np.asarray((self.rotations[views.row_view] @ views.points[:, :, None])[:, :, 0])

    def some(self, chosen: IntArray) -> State:
        """Return the state of the ``chosen`` views alone."""
        return State(self.theta, self.rotations[chosen], self.translations[chosen])

    def with_theta(self, theta: FloatArray) -> State:
        """Return the same poses with another camera."""
        return replace(self, theta=theta)


@dataclass(frozen=True, eq=False)
class Normal:
    """Normal equations by view."""

    blocks: FloatArray
    """(V, 16, 16) Σ w [A B e]ᵀ[A B e], places `THETA`, `POSE`, `RESIDUAL`"""

    def information(self) -> FloatArray:
        """Return S (9, 9): what the corners say about θ, the poses being free."""
        return np.asarray(self.of_views()[0].sum(axis=0))

    def of_views(self) -> tuple[FloatArray, FloatArray]:
        """Return each view's part (V, 9, 9) of S, and of ∂cost/∂θ (V, 9), which add up to 0 at a minimum."""
        W, V = self.blocks[:, THETA, POSE], self.blocks[:, POSE, POSE]
        followed = W @ np.linalg.inv(V)
        pulls = self.blocks[:, THETA, RESIDUAL] - np.einsum(
            "vij,vj->vi", followed, self.blocks[:, POSE, RESIDUAL]
        )
        return self.blocks[:, THETA, THETA] - followed @ np.swapaxes(W, 1, 2), pulls


def residuals(views: Views, state: State) -> FloatArray:
    """Return projection − corner (N, 2) [px]; infinite where the model has no projection."""
    pixels, ok = project(state.theta, state.points(views))
    errors = pixels - views.pixels
    errors[~ok] = np.inf
    return errors


def linearise(views: Views, state: State, weights: FloatArray) -> Normal:
    """Return the normal equations at ``state`` with a weight (N,) a corner."""
    turned = state.turned(views)
    points = turned + state.translations[views.row_view]
    pixels, by_theta, by_point, ok = project_jacobian(state.theta, points)
    rows = np.empty((len(points), 2, 16))
    rows[:, :, THETA] = by_theta
    rows[:, :, TURN] = np.cross(turned[:, None, :], by_point)
    rows[:, :, SHIFT] = by_point
    rows[:, :, RESIDUAL] = pixels - views.pixels
    rows *= np.sqrt(np.where(ok, weights, 0.0))[:, None, None]
    blocks = np.empty((views.count, 16, 16))
    for i in range(views.count):
        part = rows[views.rows(i)].reshape(-1, 16)
        blocks[i] = part.T @ part
    return Normal(blocks)


def refine(
    views: Views,
    start: State,
    free: BoolArray,
    *,
    keep: BoolArray | None = None,
    scale_px: float | None = None,
    iterations: int = 100,
) -> tuple[State, float, bool]:
    """Return the adjusted state, its cost [px²] and whether it is a minimum.

    Args:
        views: the corners.
        start: where to begin.
        free: (9,) which of θ move.
        keep: (N,) the corners that count; None is all.
        scale_px: c of Cauchy's loss; None is least squares.
        iterations: at most.
    """
    mask = np.ones(len(views.pixels)) if keep is None else keep.astype(np.float64)
    state, damping = start, 1e-3
    chart = Chart(angles_of(start.points(views)), free)
    cost, weights = _cost(residuals(views, state), mask, scale_px)
    normal = linearise(views, state, weights)
    enough = _ENOUGH if scale_px is None else _ENOUGH_ROBUST
    coordinates = max(1.0, 2.0 * mask.sum() - free.sum() - 6.0 * views.count)
    gain = np.inf
    for _ in range(iterations):
        moved, gain = _step(normal, state, free, damping, chart)
        if gain <= enough * cost / coordinates or cost <= (_EXACT_PX**2) * coordinates:
            return state, cost, bool(damping <= 1.0 or cost <= (_EXACT_PX**2) * coordinates)
        new_cost, new_weights = _cost(residuals(views, moved), mask, scale_px)
        if new_cost < cost:
            state, cost, weights = moved, new_cost, new_weights
            damping = max(damping * 0.1, 1e-12)
            normal = linearise(views, state, weights)
        else:
            damping *= 10.0
            if damping > _LARGEST_DAMPING:
                break
    return state, cost, bool(gain <= _NEARLY * cost / coordinates and damping <= 1.0)


def refine_poses(
    views: Views, start: State, *, scale_px: float | None, keep: BoolArray | None = None, iterations: int = 30
) -> tuple[State, FloatArray]:
    """Return the state with each pose adjusted by itself, the camera held, and each view's cost (V,) [px²].

    Every view has its own damping, so that a wrong one does not hold up the others.
    """
    mask = np.ones(len(views.pixels)) if keep is None else keep.astype(np.float64)
    state, damping = start, np.full(views.count, 1e-3)
    terms, weights = _terms(residuals(views, state), mask, scale_px)
    cost = np.add.reduceat(terms, views.ends[:-1])
    normal = linearise(views, state, weights)
    going = np.ones(views.count, dtype=np.bool_)
    for _ in range(iterations):
        V, b = normal.blocks[:, POSE, POSE], normal.blocks[:, POSE, RESIDUAL]
        steps = -_solved(_damped(V, damping), b[:, :, None])[:, :, 0] * going[:, None]
        moved = _moved(state, state.theta, steps)
        terms, new_weights = _terms(residuals(views, moved), mask, scale_px)
        new_cost = np.add.reduceat(terms, views.ends[:-1])
        better = going & (new_cost < cost)
        small = new_cost > (1.0 - _ENOUGH_POSES) * cost
        damping = np.where(better, damping * 0.1, damping * 10.0)
        going &= (damping < _LARGEST_DAMPING) & ~(better & small)
        pick = better[:, None, None]
        state = State(
            state.theta,
            np.where(pick, moved.rotations, state.rotations),
            np.where(better[:, None], moved.translations, state.translations),
        )
        cost = np.where(better, new_cost, cost)
        weights = np.where(better[views.row_view], new_weights, weights)
        if not going.any():
            break
        normal = linearise(views, state, weights)
    return state, cost


def _step(normal: Normal, state: State, free: BoolArray, damping: float, chart: Chart) -> tuple[State, float]:
    """Return the damped Gauss–Newton step's state, and by how much it should lower the cost."""
    G = normal.blocks
    T = chart.jacobian(state.theta)
    U, W = T.T @ G[:, THETA, THETA].sum(0) @ T, T.T @ G[:, THETA, POSE]
    a = T.T @ G[:, THETA, RESIDUAL].sum(0)
    V, b = _damped(G[:, POSE, POSE], np.full(len(G), damping)), G[:, POSE, RESIDUAL]
    solved = _solved(V, np.concatenate([np.swapaxes(W, 1, 2), b[:, :, None]], 2))
    by_theta, own = solved[:, :, THETA], solved[:, :, -1:]  # V⁻¹Wᵀ, V⁻¹b
    diagonal = np.einsum("ii->i", U)
    S = U + np.diag(damping * np.maximum(diagonal, 1e-12 * diagonal.max())) - (W @ by_theta).sum(0)
    rhs = -a + (W @ own)[:, :, 0].sum(0)
    change = _bounded(S, rhs, free, state.theta[ALPHA])
    steps = -(own[:, :, 0] + by_theta @ change)
    gain = -(2.0 * (a @ change + (b * steps).sum()))
    gain -= change @ U @ change + 2.0 * np.einsum("i,vij,vj->", change, W, steps)
    gain -= np.einsum("vi,vij,vj->", steps, G[:, POSE, POSE], steps)
    return _moved(state, chart.moved(state.theta, change), steps), float(gain)


def _bounded(S: FloatArray, rhs: FloatArray, free: BoolArray, alpha: float) -> FloatArray:
    """Solve S x = rhs over the free θ, with α kept in [0, LARGEST_ALPHA]."""
    change = np.zeros(9)
    change[free] = _scaled_solve(S[np.ix_(free, free)], rhs[free])
    wanted = alpha + change[ALPHA]
    if free[ALPHA] and not 0.0 <= wanted <= LARGEST_ALPHA:
        held = np.array(free)
        held[ALPHA] = False
        step = min(max(wanted, 0.0), LARGEST_ALPHA) - alpha
        change[ALPHA] = step
        change[held] = _scaled_solve(S[np.ix_(held, held)], rhs[held] - S[held, ALPHA] * step)
    return change


def _scaled_solve(S: FloatArray, rhs: FloatArray) -> FloatArray:
    """Solve with rows and columns brought to a unit diagonal; least squares where it is singular."""
    d = 1.0 / np.sqrt(np.maximum(np.einsum("ii->i", S), 1e-300))
    return np.asarray(d * np.linalg.lstsq(S * d * d[:, None], rhs * d, rcond=1e-14)[0])


def _damped(V: FloatArray, damping: FloatArray) -> FloatArray:
    diagonal = np.einsum("vii->vi", V)
    floor = 1e-12 * diagonal.max(axis=1, keepdims=True) + 1e-300
    return np.asarray(V + (damping[:, None] * diagonal + floor)[:, :, None] * np.eye(6))


def _solved(V: FloatArray, rhs: FloatArray) -> FloatArray:
    """Solve V x = rhs by view, brought to unit diagonals first: rad and m differ in size."""
    d = 1.0 / np.sqrt(np.einsum("vii->vi", V))
    return np.asarray(d[:, :, None] * np.linalg.solve(V * d[:, :, None] * d[:, None, :], d[:, :, None] * rhs))


def _moved(state: State, theta: FloatArray, steps: FloatArray) -> State:
    turns = Rotation.from_rotvec(steps[:, :3]).as_matrix()
    return State(theta, turns @ state.rotations, state.translations + steps[:, 3:])


def _cost(errors: FloatArray, mask: FloatArray, scale_px: float | None) -> tuple[float, FloatArray]:
    terms, weights = _terms(errors, mask, scale_px)
    return float(terms.sum()), weights


def _terms(errors: FloatArray, mask: FloatArray, scale_px: float | None) -> tuple[FloatArray, FloatArray]:
    """Return each corner's part of the cost and its weight ρ'(‖e‖²) in the normal equations."""
    squares = np.where(mask > 0.0, (errors * errors).sum(1), 0.0)
    if scale_px is None:
        return squares, mask
    ratio = squares / scale_px**2
    # a corner without projection costs a lot, but not everything: its view may simply be wrong
    terms = scale_px**2 * np.log1p(np.minimum(ratio, 1e12))
    return mask * terms, mask / (1.0 + ratio)
