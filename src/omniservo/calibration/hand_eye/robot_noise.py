"""How far reported robot poses are off, and what both unknown poses are then: a mixed linear model.

q = M θ + Δ + ε, where Δ ~ N(0, Ω), Ω = diag(σ_t² I, σ_r² I), the same for all views, is what the robot's
reports are off by, and ε ~ N(0, C) is known from the image. Given (σ_t, σ_r), θ is generalised least squares
with V = Ω + C. They are not known; their restricted likelihood, which unlike the mean square residual counts
what θ has absorbed, is

    L(σ_t, σ_r) ∝ Π|V|^(−½) · |Σ MᵀV⁻¹M|^(−½) · exp(−½ Σ rᵀV⁻¹r),   r = q − M θ,

(Patterson & Thompson, Biometrika 58, 1971). θ and its covariance are mean and covariance over L, flat in σ_t²
and σ_r²: few views say little about the two, and an estimate "0" would claim more than is known. What the
camera is off by, the same in all views, no number of them reduces: it comes on top.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from omniservo.calibration.hand_eye.loop import BOARD_SIZE, LinearLoop
from omniservo.geometry.arrays import FloatArray

_RANGE = ((1e-6, 0.3), (1e-6, 0.3))
"""of σ_t [m] and σ_r [rad]"""

_NODES = (10, 10, 10, 24)
"""a side of each grid over ln σ_t and ln σ_r, which is where the one before has weight; the last one shows a
peak beside a long tail towards 0: on a coarser one the steps jump between two answers without end"""

_COUNTS = 1e-4
"""of the largest weight: what the grid is narrowed to"""


@dataclass(frozen=True, eq=False)
class LoopSolution:
    """The step of both poses, its covariance, and what reported poses are off by."""

    step: FloatArray
    """(12,) of X and Z"""
    covariance: FloatArray
    """(12, 12) of the step"""
    sigmas: tuple[float, float]
    """mean square (σ_t [m], σ_r [rad]) per axis, as a root"""
    offsets: FloatArray
    """(n, 6) expected Δ of each view"""


def solve_loop(linear: LinearLoop) -> LoopSolution:
    """Return mean and covariance of the step over all (σ_t, σ_r) that the views allow.

    Errors of the camera make views disagree, too: by S − M (what θ absorbs of S), S = δq. As if independent,
    that is added to C where σ_t and σ_r are found; θ's own covariance is that of Δ and ε, and of S itself.
    """
    found = _over_robot(linear, np.zeros_like(linear.C))
    if not len(linear.by_camera):
        return found
    V = linear.C + np.diag(np.repeat(np.square(found.sigmas), 3))
    left = linear.by_camera - np.einsum("nij,fj->fni", linear.M, _by_camera(linear, V))
    disagreement = np.einsum("fni,fnj->nij", left, left)
    found = _over_robot(linear, disagreement)
    V = linear.C + disagreement + np.diag(np.repeat(np.square(found.sigmas), 3))
    shared = _by_camera(linear, V)
    return replace(found, covariance=found.covariance + shared.T @ shared)


def _over_robot(linear: LinearLoop, disagreement: FloatArray) -> LoopSolution:
    """Return it without what the camera does to θ, with what it adds (n, 6, 6) to the views' disagreement."""
    ranges = np.log(_RANGE)
    for nodes in _NODES:
        axes = [np.linspace(low, high, nodes) for low, high in ranges]
        logs = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
        # a row of the grid at a time: thousands of views would take gigabytes
        rows = [_given(linear, disagreement, row) for row in np.split(np.exp(logs), nodes)]
        steps, covariances, likelihoods = (np.concatenate(parts) for parts in zip(*rows, strict=True))
        posterior = likelihoods + 2.0 * logs.sum(axis=1)  # the grid is even in ln σ: dσ² = 2σ² d(ln σ)
        weights = np.exp(posterior - posterior.max())
        margins = _margins(weights, nodes)
        ranges = np.array([_narrowed(axis, w) for axis, w in zip(axes, margins, strict=True)])
    weights /= weights.sum()
    step = weights @ steps
    covariance = np.einsum("g,gij->ij", weights, covariances)
    covariance += np.einsum("g,gi,gj->ij", weights, steps - step, steps - step)
    variances = weights @ np.exp(2.0 * logs)
    left = linear.q - linear.M @ step
    V = linear.C + disagreement + np.diag(np.repeat(variances, 3))
    offsets = np.linalg.solve(V, left[:, :, None])[:, :, 0] * np.repeat(variances, 3)
    sigmas = np.sqrt(variances)
    return LoopSolution(step, covariance, (float(sigmas[0]), float(sigmas[1])), offsets)


def _by_camera(linear: LinearLoop, V: FloatArray) -> FloatArray:
    """Return what each error of the camera (f, m) does to θ: (Σ MᵀV⁻¹M)⁻¹ Σ MᵀV⁻¹ S."""
    weighted = np.swapaxes(np.linalg.solve(V, linear.M), 1, 2)
    inverse = _inverted((weighted @ linear.M).sum(axis=0))
    return np.asarray(np.einsum("nmi,fni->fm", weighted, linear.by_camera) @ inverse)


def _given(
    linear: LinearLoop, disagreement: FloatArray, sigmas: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return θ (g, m), its covariance (g, m, m) and ln L (g,) for each of (σ_t, σ_r) (g, 2) of one σ_t.

    With P the block of C + σ_t² I for translations, B the one beside it and E diag(λ) Eᵀ = S, what is left of
    the block for rotations, S = C₂₂ − BᵀP⁻¹B: V⁻¹ = diag(P⁻¹, 0) + Kᵀ diag(λ + σ_r²)⁻¹ K, K = Eᵀ[−BᵀP⁻¹ I].
    So a row of the grid takes one decomposition a view.
    """
    C = linear.C + disagreement
    rows = np.concatenate([linear.M, linear.q[:, :, None]], axis=2)
    count = rows.shape[2]
    P, B = C[:, :3, :3] + sigmas[0, 0] ** 2 * np.eye(3), C[:, :3, 3:]
    solved = np.linalg.solve(P, np.concatenate([rows[:, :3], B], axis=2))
    first, ahead = solved[:, :, :count], solved[:, :, count:]
    values, E = np.linalg.eigh(C[:, 3:, 3:] - B.mT @ ahead)
    turned = E.mT @ (rows[:, 3:] - ahead.mT @ rows[:, :3])
    spreads = np.maximum(values, 0.0) + sigmas[:, 1, None, None] ** 2
    stacked, weights = turned.reshape(-1, count), 1.0 / spreads.reshape(len(sigmas), -1, 1)
    products = (weights * stacked).mT @ stacked + (rows[:, :3].mT @ first).sum(axis=0)
    normal, right = products[:, :-1, :-1], products[:, :-1, -1]
    covariances = _inverted(normal)
    steps = np.einsum("gij,gj->gi", covariances, right)
    squares = products[:, -1, -1] - np.einsum("gi,gi->g", right, steps)
    logdets = np.linalg.slogdet(P)[1].sum() + np.log(spreads).sum(axis=(1, 2)) + np.linalg.slogdet(normal)[1]
    if disagreement.any():
        K = np.concatenate([-E.mT @ ahead.mT, E.mT], axis=2)
        own = K.mT @ (turned / spreads[..., None])[..., :-1]
        own[:, :, :3] += first[:, :, :-1]
        shared = np.einsum("gnim,nij,gnjk->gmk", own, disagreement, own, optimize=True)
        covariances = covariances - covariances @ shared @ covariances
    return steps, covariances, -0.5 * (logdets + squares)


def _inverted(normal: FloatArray) -> FloatArray:
    """Return the inverses of normal matrices (…, m, m), to which the prior of the board's size is added."""
    # the board's size: known within a factor e, so that it stays finite where the views do not show it
    normal[..., BOARD_SIZE:, BOARD_SIZE:] += 1.0
    scale = 1.0 / np.sqrt(np.einsum("...ii->...i", normal))
    both = scale[..., :, None] * scale[..., None, :]
    return np.asarray(np.linalg.inv(normal * both) * both)


def _margins(weights: FloatArray, nodes: int) -> tuple[FloatArray, FloatArray]:
    square = weights.reshape(nodes, nodes)
    return square.max(axis=1), square.max(axis=0)


def _narrowed(axis: FloatArray, weights: FloatArray) -> tuple[float, float]:
    """Return the part of an axis outside which weights do not count, a node wider."""
    counts = np.flatnonzero(weights >= _COUNTS * weights.max())
    return axis[max(counts[0] - 1, 0)], axis[min(counts[-1] + 1, len(axis) - 1)]
