"""How far the adjusted camera is off, alike over regions of the image: from residuals of views left out.

The corners u of all views see one field e(u), `ModelError`, beside noise of their own. Of a view's residuals
y only what its pose (6 numbers) cannot absorb counts: with Q onto the complement of ∂pixel/∂pose

    Qy ~ N(0, Q(τ² I + σ² K_ℓ)Qᵀ),     K_ℓ(u, u') = exp(−‖u − u'‖²/(2ℓ²)),

K_ℓ common to all views. τ, σ maximise that likelihood for each ℓ of `LENGTHS`; the best ℓ is stated. The
field is written in a basis of one function a grid point ℓ apart, so that views may be many.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.spatial import cKDTree

from omniservo.calibration.adjustment.lens import project_jacobian
from omniservo.calibration.adjustment.refine import State
from omniservo.calibration.adjustment.views import Views
from omniservo.cameras import ModelError
from omniservo.geometry.arrays import BoolArray, FloatArray


class LikelyError(NamedTuple):
    """The most likely field, and what it did to the camera that was adjusted to it."""

    error: ModelError
    pulls: FloatArray
    """(f, 9) what each independent error of a field, one σ, adds to ∂cost/∂θ, the poses being free: with S
    their information, θ is off by S⁻¹pull. Of the longest ℓ that is as likely as the best (95%): it moves
    the camera most, and residuals show it least"""


LENGTHS = (1 / 20, 1 / 14, 1 / 10, 1 / 7, 1 / 5)
"""ℓ over the image's longer side. Shorter is noise of corners; of longer ones pose and camera absorb nearly
all, and residuals say nothing of them."""

LONGER = (1 / 3.5,)
"""not stated, but what it does to the camera counts where the residuals allow it"""

_UNDECIDED = 1.92
"""of ln(likelihood): lengths within that are as likely (95%)"""

_SPACING = 0.9
"""of the grid, in ℓ"""

_NEAR = 1.5
"""Grid points farther from every corner, in ℓ, say nothing."""

_RATIOS = (-12.0, 6.0)
"""ln(σ²/τ²) that is checked"""

_LEAST_PART = 1e-4
"""of the largest eigenvalue: smaller parts of the field are left out"""


def likely_error(
    views: Views, state: State, residuals: FloatArray, keep: BoolArray, size: tuple[int, int]
) -> LikelyError:
    """Return the field that residuals (N, 2) [px], each of a view left out, make most likely."""
    turned = state.turned(views)
    _, by_theta, by_point, _ = project_jacobian(state.theta, turned + state.translations[views.row_view])
    by_pose = np.concatenate([np.cross(turned[:, None, :], by_point), by_point], axis=2)
    found = []
    for part in (*LENGTHS, *LONGER):
        length = part * max(size)
        grid, half = _basis(views.pixels[keep], length)
        m = half.shape[1]
        pulls = np.zeros((2 * m, 9))
        information, pull, square, count = np.zeros((2 * m, 2 * m)), np.zeros(2 * m), 0.0, 0
        for i in range(views.count):
            rows = np.flatnonzero(keep[views.rows(i)]) + views.ends[i]
            functions = ModelError(1.0, length).covariance(views.pixels[rows], grid) @ half
            fields = np.zeros((len(rows), 2, 2 * m))
            fields[:, 0, :m] = fields[:, 1, m:] = functions
            pose = np.linalg.qr(by_pose[rows].reshape(-1, 6))[0]
            basis, error, slopes = (
                x - pose @ (pose.T @ x)
                for x in (fields.reshape(-1, 2 * m), residuals[rows].ravel(), by_theta[rows].reshape(-1, 9))
            )
            pulls += basis.T @ slopes
            information += basis.T @ basis
            pull += basis.T @ error
            square += float(error @ error)
            count += len(error) - pose.shape[1]
        found.append((*_most_likely(information, pull, square, max(count, 1)), length, pulls))
    _, sigma, length, _ = min(found[: len(LENGTHS)], key=lambda entry: entry[0])
    least = min(cost for cost, *_ in found)
    longest = [entry for entry in found if entry[0] <= least + _UNDECIDED][-1]
    return LikelyError(ModelError(sigma, length), longest[1] * longest[3])


def _basis(pixels: FloatArray, length: float) -> tuple[FloatArray, FloatArray]:
    """Return grid points (g, 2) near the corners and K^(−½) (g, m): e = K(u, grid) K^(−½) c, c ~ N(0, σ²)."""
    low, high = pixels.min(axis=0) - 0.5 * length, pixels.max(axis=0) + 0.5 * length
    step = _SPACING * length
    sides = [np.linspace(a, b, math.ceil((b - a) / step) + 1) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, 2)
    grid = grid[cKDTree(pixels).query(grid)[0] < _NEAR * length]
    values, vectors = np.linalg.eigh(ModelError(1.0, length).covariance(grid, grid))
    used = values > _LEAST_PART * values[-1]
    return grid, vectors[:, used] / np.sqrt(values[used])


def _most_likely(information: FloatArray, pull: FloatArray, square: float, count: int) -> tuple[float, float]:
    """Return −ln(likelihood) and σ [px] of the most likely σ²/τ²."""
    values, vectors = np.linalg.eigh(information)
    values, pulls = np.maximum(values, 0.0), np.square(vectors.T @ pull)

    def variance(ratio: float) -> float:
        """Return τ²."""
        left = square - float(np.sum(ratio * pulls / (1.0 + ratio * values)))
        return max(left, 1e-12 * square, 1e-30) / count

    def cost(logarithm: float) -> float:
        ratio = math.exp(logarithm)
        return 0.5 * (count * math.log(variance(ratio)) + float(np.log1p(ratio * values).sum()))

    best = minimize_scalar(cost, bounds=_RATIOS, method="bounded")
    ratio = math.exp(float(best.x))
    return float(best.fun), math.sqrt(ratio * variance(ratio))
