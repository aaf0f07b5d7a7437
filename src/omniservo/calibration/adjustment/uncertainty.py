"""How far the adjusted camera may be from the true one: parameters, pixels, rays."""

from __future__ import annotations

import numpy as np

from omniservo.calibration.adjustment.lens import (
    angles_of,
    project,
    project_jacobian,
    tangent_axes,
)
from omniservo.calibration.adjustment.refine import Normal, State, residuals
from omniservo.calibration.adjustment.views import Views
from omniservo.geometry.arrays import BoolArray, FloatArray

CONFIDENCE = 0.95
_DRAWS = 2000
_FLAT = 1e-12
"""of the largest eigenvalue: parts below are rounding"""

_BINS = 12
_SURE = 3.0
"""a mean residual this many standard errors from 0 is a pattern, not noise"""


def theta_covariance(normal: Normal, free: BoolArray, variance: float) -> FloatArray:
    """Return σ² S⁻¹ (9, 9) of θ, the poses being eliminated; 0 for what is not free.

    S is brought to a unit diagonal first. Directions that the corners do not determine at all get the largest
    variance that the numbers can hold, not 0.
    """
    S = normal.information()[np.ix_(free, free)]
    d = 1.0 / np.sqrt(np.maximum(np.einsum("ii->i", S), 1e-300))
    values, vectors = np.linalg.eigh(S * d * d[:, None])
    half = d[:, None] * vectors / np.sqrt(np.maximum(values, 1e-14 * values[-1]))
    result = np.zeros((9, 9))
    result[np.ix_(free, free)] = variance * half @ half.T
    return result


def jackknife_covariance(normal: Normal, free: BoolArray) -> FloatArray:
    """Return (V − 1)/V Σ dᵢdᵢᵀ (9, 9), dᵢ the first-order step of θ where view i is left out.

    Views are independent, and corners of one view need not be: images blur, exposures move. (Cluster-robust,
    CR3: MacKinnon & White, J. Econometrics 29, 1985.)
    """
    parts, pulls = normal.of_views()
    without = (parts.sum(axis=0) - parts)[:, free][:, :, free]
    unit = 1.0 / np.sqrt(np.maximum(np.einsum("vii->vi", without), 1e-300))
    values, vectors = np.linalg.eigh(without * unit[:, :, None] * unit[:, None, :])
    along = np.einsum("vij,vi->vj", vectors, unit * pulls[:, free])
    along /= np.maximum(values, 1e-14 * values[:, -1:])
    result, steps = np.zeros((9, 9)), unit * np.einsum("vij,vj->vi", vectors, along)
    result[np.ix_(free, free)] = (len(parts) - 1.0) / len(parts) * steps.T @ steps
    return result


def larger_covariance(one: FloatArray, other: FloatArray, free: BoolArray) -> FloatArray:
    """Return ``one`` (9, 9), made as large as ``other`` along the common axes where that is larger."""
    chosen = np.ix_(free, free)
    scale = np.sqrt(np.maximum(np.diag(one)[free], 1e-300))
    both = np.outer(scale, scale)
    values, vectors = np.linalg.eigh(one[chosen] / both)
    root = np.sqrt(np.maximum(values, _FLAT * values[-1]))
    ratios, axes = np.linalg.eigh((vectors / root).T @ (other[chosen] / both) @ (vectors / root))
    half = vectors * root @ axes
    result = np.zeros((9, 9))
    result[chosen] = (half * np.maximum(ratios, 1.0)) @ half.T * both
    return result


def pixel_responses(theta: FloatArray, rays: FloatArray, *, turned: bool) -> FloatArray:
    """Return ∂pixel/∂θ (n, 2, 9) of ``rays`` (n, 3).

    With ``turned``, what is left after the best rotation of the camera's frame [least squares over the
    rays]: a
    rotation that poses, and a hand-eye calibration with the same camera, absorb.
    """
    _, by_theta, by_point, _ = project_jacobian(theta, rays)
    return _turned_back(by_theta, by_point, rays) if turned else by_theta


def pixel_bound(theta: FloatArray, covariance: FloatArray, rays: FloatArray, *, turned: bool) -> float:
    """Return the bound [px] that holds with 95% for the pixels of all ``rays`` (n, 3) at once.

    The 95% quantile of max ‖∂pixel/∂θ dθ‖ over the rays, dθ drawn from the normal distribution (seeded).
    """
    values, vectors = np.linalg.eigh(covariance)
    half = vectors * np.sqrt(np.maximum(values, 0.0))
    draws = np.random.default_rng(0).normal(size=(9, _DRAWS))
    moved = (pixel_responses(theta, rays, turned=turned) @ half).reshape(-1, 9) @ draws
    lengths = np.hypot(moved[0::2], moved[1::2])
    return float(np.quantile(lengths.max(axis=0), CONFIDENCE))


def fold_spread(cameras: tuple[FloatArray, ...], rays: FloatArray, *, turned: bool) -> float:
    """Return the largest jackknife standard deviation of a ray's pixel over the folds' cameras [px].

    √((k−1)/k Σ‖pixelᵢ − mean‖²): unlike the covariance it also sees what the model cannot fit.
    """
    pixels = np.stack([project(theta, rays)[0] for theta in cameras])
    away = pixels - pixels.mean(0)
    if turned:
        _, _, by_point, _ = project_jacobian(cameras[0], rays)
        away = _turned_back(away.transpose(1, 2, 0), by_point, rays).transpose(2, 0, 1)
    spread = (away**2).sum(axis=(0, 2)) * (len(cameras) - 1.0) / len(cameras)
    return float(np.sqrt(spread.max()))


def pattern(views: Views, state: State, keep: BoolArray) -> float:
    """Return the largest mean radial residual over rings of equally many corners [px], 0 where only noise.

    What the model leaves unexplained: a ring's mean counts when it is three standard errors from 0.
    """
    errors = residuals(views, state)[keep]
    outward = views.pixels[keep] - state.theta[2:4]
    radial = (errors * outward).sum(1) / np.maximum(np.linalg.norm(outward, axis=1), 1e-9)
    rings = np.array_split(radial[np.argsort(angles_of(state.points(views))[keep])], _BINS)
    largest = 0.0
    for ring in rings:
        if len(ring) >= 3 and abs(ring.mean()) > _SURE * ring.std(ddof=1) / np.sqrt(len(ring)):
            largest = max(largest, float(abs(ring.mean())))
    return largest


def ray_deviation(
    theta: FloatArray, covariance: FloatArray, angles: FloatArray, *, turned: bool
) -> FloatArray:
    """Return the standard deviation [rad] of rays at ``angles`` (n,) from the axis, for given pixels.

    The root of the trace of the ray's 2×2 covariance, root mean square over 16 directions round the axis.
    ``turned``: as in `pixel_responses`.
    """
    azimuths = np.arange(16) * (np.pi / 8.0)
    a, z = np.repeat(angles, 16), np.tile(azimuths, len(angles))
    rays = np.stack([np.sin(a) * np.cos(z), np.sin(a) * np.sin(z), np.cos(a)], 1)
    _, _, by_point, _ = project_jacobian(theta, rays)
    moved = pixel_responses(theta, rays, turned=turned)
    answer = np.linalg.solve(by_point @ tangent_axes(rays), moved)
    traces = np.einsum("nip,pq,niq->n", answer, covariance, answer)
    return np.asarray(np.sqrt(np.maximum(traces, 0.0).reshape(-1, 16).mean(axis=1)))


def _turned_back(moves: FloatArray, by_point: FloatArray, rays: FloatArray) -> FloatArray:
    """Return pixel moves (n, 2, m) less the rotation of the rays that explains each of the m best."""
    rotation = np.cross(rays[:, None, :], by_point).reshape(-1, 3)
    flat = moves.reshape(-1, moves.shape[2])
    left = flat - rotation @ np.linalg.lstsq(rotation, flat, rcond=None)[0]
    return np.asarray(left.reshape(moves.shape))
