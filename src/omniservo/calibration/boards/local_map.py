"""Where a point of the board is seen, from the points around it: no camera is needed."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from omniservo.geometry.arrays import BoolArray, FloatArray

_NEIGHBOURS = 14
_RIDGE = 0.02  # holds the curvature at 0 where few points say nothing about it
_LEAST_SPREAD = 0.04  # variance of the neighbours' places across their best line


def local_map(
    places: FloatArray, pixels: FloatArray, wanted: FloatArray, *, without_itself: bool = False
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return pixels (n, 2) of the ``wanted`` places, the map's derivative (n, 2, 2), and where it is known.

    A quadratic polynomial in the place, fitted to the nearest known points, nearer ones weighing more.

    Args:
        places: (m, 2) known points on the board, in steps of its grid.
        pixels: (m, 2) [px] their images.
        wanted: (n, 2) places on the board.
        without_itself: ``wanted`` are the known points, and each is predicted from the others alone.
    """
    first = int(without_itself)
    count = min(_NEIGHBOURS, len(places) - first)
    if count < 3:
        return np.zeros((len(wanted), 2)), np.zeros((len(wanted), 2, 2)), np.zeros(len(wanted), dtype=bool)
    found = cKDTree(places).query(wanted, k=count + first)
    distance, near = np.asarray(found[0])[:, first:], np.asarray(found[1])[:, first:]
    x, y = np.moveaxis(places[near] - wanted[:, None, :], 2, 0)
    weight = 1.0 / (0.3 + distance**2)
    design = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=2)
    ridge = np.diag([0.0, 0.0, 0.0, _RIDGE, _RIDGE, _RIDGE]) + 1e-9 * np.eye(6)
    left = np.einsum("nk,nki,nkj->nij", weight, design, design) + ridge
    right = np.einsum("nk,nki,nkc->nic", weight, design, pixels[near])
    solution = np.linalg.solve(left, right)
    spread = np.stack([x - x.mean(1, keepdims=True), y - y.mean(1, keepdims=True)], axis=2)
    least = np.linalg.eigvalsh(np.swapaxes(spread, 1, 2) @ spread / count)[:, 0]
    # nobody predicts far away: the third neighbour must be near
    known = (least > _LEAST_SPREAD) & (np.sort(distance, axis=1)[:, 2] < 3.0)
    axes = np.swapaxes(solution[:, 1:3], 1, 2)
    known &= np.abs(np.linalg.det(axes)) > 4.0
    return solution[:, 0], axes, known
