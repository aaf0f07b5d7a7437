"""Neighbouring matches that err alike: what their windows share, and what hangs together beyond.

A natural feature is measured in a patch of the picture, under a Gaussian window of standard deviation w. Two
patches that overlap see the same noise. With independent noise of the grey values the errors of two places d
apart have the correlation of their windows' product,

    R_jk = a 2 w_j w_k/(w_j² + w_k²) exp(−½ d²/(w_j² + w_k²)),   R_jj = 1,

a = 1 where a patch is only shifted; what an affine fit takes up leaves a = `SHARED`. With G_j what one σ of
match j does to the motion, its covariance is Σ_jk R_jk G_j G_kᵀ instead of C = Σ_j G_j G_jᵀ: in the mean over
its p axes larger by λ = tr(C⁻¹ Σ_jk R_jk G_j G_kᵀ)/p.

No noise of pictures reaches farther. Where the Sampson distances of matches hang together over places whose
windows hardly meet, a smooth law puts them off their epipolar lines: another camera's. Let c be the
distances, clipped at the gate since a wrong match may lie anywhere, and T = Σ_B c_j c_k over the pairs B in a
band of distances. Were their signs alike as far as windows overlap, R, and by chance beyond, T would have the
mean tr(BS) and the variance 2 tr((BS)²), S_jk = |c_j| R_jk |c_k|.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.distance import cdist

from omniservo.geometry.arrays import FloatArray

SHARED = 0.6
"""of the variance of two matches with one window; fitted to rendered pairs, which show 0.4 to 0.65"""

BAND = (1.5, 4.0)
"""[√(w_j² + w_k²)] of pairs that hardly err alike, and of which a picture holds many"""

MOST_MATCHES = 1000
"""so many tell whether they hang together; what is told costs their number cubed"""


def shared_error_factor(response: FloatArray, pixels: FloatArray, windows: FloatArray) -> float:
    """Return λ, by which overlapping windows make the motion's variance larger.

    Args:
        response: (n, p, 4) what one σ of each match's pixel coordinates does to the motion.
        pixels: (n, 4) of the matches; where they lie in the initial image tells what overlaps.
        windows: (n,) standard deviation [px] of their windows there.
    """
    _, shared = _overlaps(pixels, windows)
    columns = np.moveaxis(response, 2, 0)
    alone, joint = (np.einsum("cna,cnb->ab", columns, c) for c in (columns, shared @ columns))
    values, vectors = np.linalg.eigh(alone)
    known = values > 1e-9 * values[-1]
    axes = vectors[:, known] / np.sqrt(values[known])
    return float(np.mean(np.einsum("ak,ab,bk->k", axes, joint, axes)))


def hang_together(distances: FloatArray, pixels: FloatArray, windows: FloatArray) -> float:
    """Return by how many standard deviations matches are alike farther apart than their windows reach.

    Args:
        distances: (n,) Sampson distances, clipped; of the best `MOST_MATCHES` if there are more.
        pixels: (n, 4) of the matches.
        windows: (n,) standard deviation of their windows in the initial image [px].
    """
    c = distances[:MOST_MATCHES]
    apart, shared = _overlaps(pixels[:MOST_MATCHES], windows[:MOST_MATCHES])
    band = (apart > BAND[0] ** 2) & (apart < BAND[1] ** 2)
    product = band @ (shared * np.outer(np.abs(c), np.abs(c)))
    variance = 2.0 * float(np.sum(product * product.T))
    return float(c @ band @ c - np.trace(product)) / math.sqrt(variance) if variance > 0.0 else 0.0


def _overlaps(pixels: FloatArray, windows: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return d²/(w_j² + w_k²) and R, (n, n) each."""
    square = windows[:, None] ** 2 + windows**2
    apart = cdist(pixels[:, :2], pixels[:, :2], "sqeuclidean") / square
    shared = SHARED * 2.0 * np.outer(windows, windows) / square * np.exp(-0.5 * apart)
    np.fill_diagonal(shared, 1.0)
    return apart, shared
