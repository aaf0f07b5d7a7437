"""Neighbouring matches that err alike: what their windows share.

A natural feature is measured in a patch of the image, under a Gaussian window of standard deviation w. Two
patches that overlap see the same noise. With independent noise of the grey values the errors of two places d
apart have the correlation of their windows' product,

    R_jk = a 2 w_j w_k/(w_j² + w_k²) exp(−½ d²/(w_j² + w_k²)),   R_jj = 1,

a = 1 where a patch is only shifted; what an affine fit absorbs leaves a = `SHARED`. With G_j what one σ of
match j does to the motion, its covariance is Σ_jk R_jk G_j G_kᵀ instead of C = Σ_j G_j G_jᵀ: in the mean over
its p axes larger by λ = tr(C⁻¹ Σ_jk R_jk G_j G_kᵀ)/p.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial.distance import cdist

from omniservo.geometry.arrays import FloatArray

SHARED = 0.3
"""of the variance of two matches with one window; fitted to rendered pairs, which show 0.2 to 0.3"""


def shared_part(pixels: FloatArray, windows: FloatArray) -> FloatArray:
    """Return R (n, n) of pixels (n, 2) in windows of these standard deviations (n,) [px]."""
    square = windows[:, None] ** 2 + windows**2
    apart = cdist(pixels, pixels, "sqeuclidean")
    shared = SHARED * 2.0 * np.outer(windows, windows) / square * np.exp(-0.5 * apart / square)
    np.fill_diagonal(shared, 1.0)
    return np.asarray(shared)


def shared_error_factor(response: FloatArray, pixels: FloatArray, windows: FloatArray) -> float:
    """Return λ, by which overlapping windows make the motion's variance larger.

    Args:
        response: (n, p, 4) what one σ of each match's pixel coordinates does to the motion.
        pixels: (n, 4) of the matches; where they lie in the initial image tells what overlaps.
        windows: (n,) standard deviation [px] of their windows there.
    """
    shared = shared_part(pixels[:, :2], windows)
    columns = np.moveaxis(response, 2, 0)
    alone, joint = (np.einsum("cna,cnb->ab", columns, c) for c in (columns, shared @ columns))
    values, vectors = np.linalg.eigh(alone)
    known = values > 1e-9 * values[-1]
    axes = vectors[:, known] / np.sqrt(values[known])
    return float(np.mean(np.einsum("ak,ab,bk->k", axes, joint, axes)))
