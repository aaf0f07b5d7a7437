"""Do pairs of bearings agree on one motion, more of them than chance brings about?

Wrong pairs lie anywhere; right ones lie on the epipolar circles of one essential matrix. That k of n pairs do
so with the best of all matrices by chance is to be expected

    (n − 8) C(n, k) C(k, 8) p^(k − 8)

times, p the share of pairs put together at random that lie as near (Moisan, Stival 2004). Matrices come from
samples of eight pairs and from all that agree. A plane's pairs agree with too many matrices for one to be
found. They lie where one homography takes them: samples are of four pairs, and 4 stands for 8 above.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from omniservo.cameras.models import CentralModel
from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.geometry.false_alarms import false_alarms

SAMPLED = 8
SAMPLES = 600
LEAST_AGREEING = 40
"""fewer say too little of the motion: of two dozen, one or two wrong ones decide it"""
BAND_PX = 1.5
"""Pairs agree within so many pixels."""
FALSE_ALARMS = 1e-6
LEAST_CHANCE = 1e-3
ROUNDS = 3
_OF_PLANE = 4
"""pairs that give a homography"""
LEAST_ON_PLANE = 16
"""fewer leave the plane's slant, and with it the motion, uncertain"""
LEAST_PLANE_SHARE = 2.0 / 3.0
"""of the pairs: a pattern on the plane may be matched one period off, and fewer may be those"""


class Agreement(NamedTuple):
    """Pairs that agree on one motion."""

    members: BoolArray
    """(n,) which do"""
    essential: FloatArray
    """E (3, 3) of all of them, xᵀEy ≈ 0 of bearings x of the initial and y of the goal image"""


def agreeing_pairs(
    camera: CentralModel, initial: FloatArray, goal: FloatArray, least: int = LEAST_AGREEING
) -> Agreement | None:
    """Return which pairs agree on one motion; None where they are no more than chance brings about.

    Args:
        camera: took both images.
        initial: (n, 2) [px].
        goal: (n, 2) [px], the same points.
        least: fewer do not agree.
    """
    if len(initial) < least:
        return None
    x, y, band = _bearings(camera, initial, goal)
    rng = np.random.default_rng(0)
    samples = rng.random((SAMPLES, len(x))).argpartition(SAMPLED, axis=1)[:, :SAMPLED]
    matrices = _essential(x[samples], y[samples])
    agree = _distances(matrices, x, y) < band
    best = int(agree.sum(axis=1).argmax())
    matrix, members = matrices[best], agree[best]
    for _ in range(ROUNDS):
        if np.count_nonzero(members) < least:
            return None
        again = _essential(x[None, members], y[None, members])
        more = (_distances(again, x, y) < band)[0]
        if np.count_nonzero(more) <= np.count_nonzero(members):
            break
        matrix, members = again[0], more
    return Agreement(members, matrix) if _chance(matrix, (x, y), members, band) < FALSE_ALARMS else None


def share_on_one_plane(camera: CentralModel, initial: FloatArray, goal: FloatArray) -> float:
    """Return which share of pairs, 0 to 1, one homography explains as well as `agreeing_pairs` asks.

    A plane's pairs leave many motions: what agrees with one of them is no evidence for it. The arguments are
    those of `agreeing_pairs`.
    """
    return float(_on_plane(*_bearings(camera, initial, goal))[1].mean())


def agree_on_one_plane(camera: CentralModel, initial: FloatArray, goal: FloatArray) -> bool:
    """Tell whether one homography explains most pairs, more of them than chance brings about.

    The arguments are those of `agreeing_pairs`.
    """
    if len(initial) < LEAST_ON_PLANE:
        return False
    x, y, band = _bearings(camera, initial, goal)
    matrix, members = _on_plane(x, y, band)
    if members.sum() < max(LEAST_ON_PLANE, LEAST_PLANE_SHARE * len(x)):
        return False
    wrong = [(_gaps(matrix[None], x, np.roll(y, k, axis=0))[0] < band).mean() for k in range(1, len(x))]
    return _chance_of_all(members, float(np.mean(wrong)), _OF_PLANE) < FALSE_ALARMS


def _on_plane(x: FloatArray, y: FloatArray, band: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return the homography that most pairs of bearings obey within ``band`` (n,) [rad], and which do."""
    rng = np.random.default_rng(0)
    samples = rng.random((SAMPLES, len(x))).argpartition(_OF_PLANE, axis=1)[:, :_OF_PLANE]
    matrices = _homographies(x[samples], y[samples])
    best = matrices[int((_gaps(matrices, x, y) < band).mean(axis=1).argmax())]
    matrix, members = best, np.zeros(len(x), dtype=np.bool_)
    for _ in range(ROUNDS):
        more = (_gaps(best[None], x, y) < band)[0]
        if more.sum() <= members.sum() or np.count_nonzero(more) < _OF_PLANE:
            break
        members, matrix = more, best
        best = _homographies(x[None, members], y[None, members])[0]
    return matrix, members


def _bearings(
    camera: CentralModel, initial: FloatArray, goal: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return bearings (n, 3) of both images, and what `BAND_PX` pixels are there (n,) [rad]."""
    band = BAND_PX * 0.5 * (radians_per_pixel(camera, initial) + radians_per_pixel(camera, goal))
    return camera.unproject(initial)[0], camera.unproject(goal)[0], band


def _homographies(x: FloatArray, y: FloatArray) -> FloatArray:
    """Matrices H (m, 3, 3) with y × Hx ≈ 0, of bearings (m, k, 3), k ≥ 4, least squares."""
    cross = np.cross(np.eye(3), y[:, :, None, :])
    rows = (cross[..., None] * x[:, :, None, None, :]).reshape(len(x), -1, 9)
    _, vectors = np.linalg.eigh(np.swapaxes(rows, 1, 2) @ rows)
    return np.asarray(vectors[:, :, 0].reshape(-1, 3, 3))


def _gaps(matrices: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
    """Angles (m, n) [rad] between the goal's bearings and where homographies have them."""
    there = x @ np.swapaxes(matrices, 1, 2)
    there /= np.maximum(np.linalg.norm(there, axis=2, keepdims=True), 1e-12)
    cosine = np.abs((there * y).sum(axis=2))  # a homography's sign is free
    return np.asarray(np.arctan2(np.linalg.norm(np.cross(there, y), axis=2), cosine))


def _chance(
    matrix: FloatArray, pairs: tuple[FloatArray, FloatArray], members: BoolArray, band: FloatArray
) -> float:
    """Return how many matrices agree with as many pairs, to be expected of pairs that are all wrong."""
    turned = [np.roll(pairs[1], shift, axis=0) for shift in range(1, len(members))]
    near = [(_distances(matrix[None], pairs[0], other)[0] < band).mean() for other in turned]
    return _chance_of_all(members, float(np.mean(near)), SAMPLED)


def _chance_of_all(members: BoolArray, share: float, sampled: int) -> float:
    """Return how many models are as good by chance, of which ``share`` of wrong pairs agree with one."""
    n, k = len(members), int(np.count_nonzero(members))
    return false_alarms(n, k, sampled, max(share, LEAST_CHANCE), n - sampled)


def _essential(x: FloatArray, y: FloatArray) -> FloatArray:
    """Essential matrices (m, 3, 3) with xᵀEy ≈ 0, of bearings (m, k, 3), k ≥ 8, least squares."""
    products = (x[:, :, :, None] * y[:, :, None, :]).reshape(len(x), -1, 9)
    _, vectors = np.linalg.eigh(np.swapaxes(products, 1, 2) @ products)
    left, _, right = np.linalg.svd(vectors[:, :, 0].reshape(-1, 3, 3))
    return np.asarray(left @ np.diag([1.0, 1.0, 0.0]) @ right)


def _distances(matrices: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
    """Angles (m, n) [rad] of bearings from their epipolar circles, the larger of both images'."""
    of_x, of_y = y @ np.swapaxes(matrices, 1, 2), x @ matrices
    products = np.abs((of_x * x).sum(axis=2))
    least = np.minimum(np.linalg.norm(of_x, axis=2), np.linalg.norm(of_y, axis=2))
    return np.asarray(products / np.maximum(least, 1e-12))


def radians_per_pixel(camera: CentralModel, pixels: FloatArray) -> FloatArray:
    """(n,) the root of a pixel's solid angle; a large one at the rim, where that is not known."""
    around, valid = camera.unproject(
        pixels[:, None] + np.array([[0.5, 0.0], [-0.5, 0.0], [0.0, 0.5], [0.0, -0.5]])
    )
    area = np.linalg.norm(np.cross(around[:, 0] - around[:, 1], around[:, 2] - around[:, 3]), axis=1)
    return np.asarray(np.sqrt(np.where(valid.all(axis=1), area, np.nanmedian(area))))
