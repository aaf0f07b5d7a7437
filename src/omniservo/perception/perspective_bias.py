"""By how much a patch misses its place because it was laid on affinely, and the surface stands askew."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial import cKDTree

from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.perception.align_patches import Alignment
from omniservo.perception.tangent_patches import TangentFrames

REACH = 10.0
"""[√v] Neighbours farther away say nothing of a patch's surface; nearer ones by a biweight."""
MOST_NEIGHBOURS = 24
MISFIT = 0.03
"""standard deviation of a change of scale between neighbours, as the affinities of patches state it; one on
another surface differs by more and counts less (Geman-McClure)"""
USUAL = 0.4
"""[1/rad] standard deviation of c in either direction before any neighbour counts"""
_STEPS = 10


def without_perspective_bias(
    found: Alignment, before: TangentFrames, after: TangentFrames, variance: FloatArray, good: BoolArray
) -> Alignment:
    """Return the alignment of the ``good`` (n,) patches with its bias taken off; the others as they are.

    A plane is seen again by y(x) = p + A x / (1 + c·x) on tangent planes. The affinity that lies best on it
    leaves out the second order, −A x (c·x), whose mean under a window of variance v is −v A c: the middle of
    the affinity is so far from p. That is alike for all patches of a surface, and more of them do not average
    it out. A is known of each patch; c stands in how the scale changes towards its neighbours,
    ‖A x‖ / ‖y − p‖ − 1 = c·x (robust least squares).

    Args:
        found: of n patches.
        before: (n) planes at the patches.
        after: (n) planes of the other image, on which ``found`` lies.
        variance: (n,) v [rad²] of the weights of a patch's samples, along either axis.
        good: whose places count as neighbours.
    """
    if good.sum() < 2:
        return found
    places, c = found.places.copy(), _perspective(found, before, after, variance, good)
    places[good] += variance[good, None] * np.einsum("nij,nj->ni", found.affinities[good], c)
    return replace(found, places=places)


def _perspective(
    found: Alignment, before: TangentFrames, after: TangentFrames, variance: FloatArray, good: BoolArray
) -> FloatArray:
    """Return c (m, 2) [1/rad] of the m good patches."""
    before, after, reach = before[good], after[good], REACH * np.sqrt(variance[good])
    places, affinities = found.places[good], found.affinities[good]
    count = min(MOST_NEIGHBOURS, len(before) - 1)
    near = np.asarray(cKDTree(before.bearings).query(before.bearings, k=count + 1)[1])[:, 1:]
    seen = after.directions(places[:, None])[:, 0]
    x = np.stack([before.places(before.bearings[near[:, k]]) for k in range(count)], axis=1)
    y = np.stack([after.places(seen[near[:, k]]) - places for k in range(count)], axis=1)
    length = np.linalg.norm(y, axis=2)
    with np.errstate(divide="ignore", invalid="ignore"):
        excess = np.linalg.norm(np.einsum("nij,nkj->nki", affinities, x), axis=2) / length - 1.0
    sure = np.isfinite(excess) & (np.linalg.norm(x, axis=2) < reach[:, None])
    x, excess = np.where(sure[..., None], x, 0.0), np.where(sure, excess, 0.0)
    nearness = np.where(sure, 1.0 - (x**2).sum(2) / reach[:, None] ** 2, 0.0) ** 2 / MISFIT**2
    c = np.zeros((len(x), 2))
    for _ in range(_STEPS):
        misfit = (excess - np.einsum("nki,ni->nk", x, c)) / MISFIT
        weight = nearness / (1.0 + misfit**2) ** 2
        normal = np.einsum("nk,nki,nkj->nij", weight, x, x) + np.eye(2) / USUAL**2
        c = np.linalg.solve(normal, np.einsum("nk,nk,nki->ni", weight, excess, x)[..., None])[..., 0]
    return c
