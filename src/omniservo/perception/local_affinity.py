"""How a patch has changed its shape between two views, from where its neighbours have gone."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.perception.tangent_patches import TangentFrames

_NEIGHBOURS = 6
_RIDGE = 0.5
"""of a similarity against the affinity that three neighbours in one line cannot tell; a neighbour has 1"""


def transported(frames: TangentFrames, bearings: FloatArray) -> TangentFrames:
    """Frames at other bearings (n, 3), turned there about b × b′ and not about themselves."""
    total = frames.bearings + bearings
    along = (frames.first * total).sum(1) / (1.0 + (frames.bearings * bearings).sum(1))
    first = frames.first - along[:, None] * total
    first -= (first * bearings).sum(1, keepdims=True) * bearings
    return TangentFrames(bearings, first / np.linalg.norm(first, axis=1, keepdims=True))


def local_affinities(before: TangentFrames, after: TangentFrames, known: BoolArray) -> FloatArray:
    """Affinities (n, 2, 2) from each point's plane before to its plane after, for ``known`` (n,) ones.

    At each point the affinity that takes its nearest neighbours before to those after, near ones counting
    more, drawn towards the similarity that does it best. A lone point has the identity.
    """
    affinities = np.tile(np.eye(2), (len(before), 1, 1))
    rows = np.flatnonzero(known)
    count = min(_NEIGHBOURS, len(rows) - 1)
    if count < 1:
        return affinities
    near = np.asarray(cKDTree(before.bearings[rows]).query(before.bearings[rows], k=count + 1)[1])[:, 1:]
    x, y = (
        np.stack([f[rows].places(f.bearings[rows][near[:, k]]) for k in range(count)], axis=1)
        for f in (before, after)
    )
    square = (x**2).sum(2)
    sure = np.isfinite(x).all(2) & np.isfinite(y).all(2) & (square > 1e-12)
    weight = np.where(sure, 1.0 / np.where(sure, square, 1.0), 0.0)
    x, y = np.where(sure[..., None], x, 0.0), np.where(sure[..., None], y, 0.0)
    total = np.maximum(sure.sum(1), 1)
    real = (weight * (x * y).sum(2)).sum(1) / total
    turned = (weight * (x[..., 0] * y[..., 1] - x[..., 1] * y[..., 0])).sum(1) / total
    prior = np.stack([np.stack([real, -turned], axis=1), np.stack([turned, real], axis=1)], axis=1)
    left = np.einsum("nk,nki,nkj->nij", weight, x, x) + _RIDGE * np.eye(2)
    right = np.einsum("nk,nki,nkj->nij", weight, y, x) + _RIDGE * prior
    fitted = right @ np.linalg.inv(left)
    upright = sure.any(1) & (np.linalg.det(fitted) > 0.01)
    affinities[rows[upright]] = fitted[upright]
    return affinities
