"""Decoupled servoing on the sphere: areas that no rotation changes, and a rotation between two views."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from omniservo.errors import FeatureLoss
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.geometry.nearest_rotation import nearest_rotation
from omniservo.servoing.adaptive_gain import Gain, refuse_wrong_gain
from omniservo.servoing.feedback import feedback
from omniservo.servoing.rotation_vector import (
    cross_matrix,
    rotation_vector,
    rotation_vector_interaction,
)
from omniservo.servoing.servo_measurement import ServoMeasurement

MOST_TRIANGLES = 84
"""All triangles of nine points; of more points as many, evenly chosen."""

LEAST_AREA = 0.1
"""A triangle smaller than this share of the largest one is not used: of a thin one 1/√Δ runs away."""

_ROUND = [0, 1, 2, 0, 1]
"""A triangle's corners, and the axes, with the first two again: the next ones are a slice, not a copy."""
_NEXT, _LAST = slice(1, 4), slice(2, 5)

LEAST_TRIANGLES = 3
"""The translation has three components."""

_IDENTITY = np.eye(3)


@with_field_docs
@dataclass(frozen=True)
class SphericalServoOptions:
    """How decoupled servoing on the sphere is run."""

    gain: Gain = 1.0
    """λ [1/s]"""

    def __post_init__(self) -> None:
        refuse_wrong_gain(self.gain)


class SphericalServo:
    """v = −λ L⁺ e of e = (1/√Δ_k − 1/√Δ_k*, θu), on bearings in any direction.

    Tahri, Mezouar, Chaumette and Corke, *Decoupled image-based visual servoing for cameras obeying the
    unified projection model* (2010): Δ is the area of the triangle that three bearings span. It is invariant
    to rotation, so its block of L is [L_Δ 0]; 1/√Δ is nearly linear in the distance. θu is the rotation
    vector of the R that turns the bearings into those of the goal image best, min Σ‖s* − R s‖² over all
    points (Wahba 1965). A rotation of the camera alone is found exactly, and its block [J W  J] says how much
    of one a translation looks like.

    Args:
        options: see SphericalServoOptions.
    """

    def __init__(self, options: SphericalServoOptions | None = None) -> None:
        self.options = options or SphericalServoOptions()
        """as given"""

    def error(self, seen: ServoMeasurement) -> tuple[FloatArray, FloatArray]:
        """Return e (k + 3,) and its interaction matrix L (k + 3, 6).

        Raises:
            FeatureLoss: fewer than three triangles are left.
        """
        corners = _triangles(len(seen.bearings))
        area, slope = _areas(seen, corners)
        goal_area = 0.5 * _length(_normals(_spanned(seen.goal_bearings, corners[:3])))
        wide = area > LEAST_AREA * area.max(initial=0.0)
        wide &= goal_area > LEAST_AREA * goal_area.max(initial=0.0)
        use = np.flatnonzero(wide)
        if len(use) < LEAST_TRIANGLES:
            raise FeatureLoss(
                f"{len(seen.bearings)} points span {len(use)} triangles that are wide enough, now and in the "
                f"goal image; at least {LEAST_TRIANGLES} are needed"
            )
        turn, rates = _rotation(seen)
        area, goal_area = area[use], goal_area[use]
        matrix = np.zeros((len(use) + 3, 6))
        matrix[:-3, :3], matrix[-3:] = (-0.5 * area**-1.5 * slope[:, use]).T, rates
        return np.concatenate((area**-0.5 - goal_area**-0.5, turn)), matrix

    def step(self, seen: ServoMeasurement) -> FloatArray:
        """Return the camera twist (6,), (linear [m/s], angular [rad/s]) in the camera frame.

        Raises:
            FeatureLoss: fewer than three triangles are left.
            SingularInteraction: they do not determine a translation.
        """
        return feedback(*self.error(seen), self.options.gain)


@lru_cache(maxsize=64)
def _triangles(count: int) -> IntArray:
    """Return the corners of at most MOST_TRIANGLES triangles of ``count`` points, (5, k) by `_ROUND`."""
    every = math.comb(count, 3)
    rank = np.linspace(0, every - 1, min(every, MOST_TRIANGLES)).round().astype(np.int64)
    # in the order of `itertools.combinations`, of which a hundred points have too many to list
    left = np.arange(count - 1, -1, -1)
    pairs, triples = (np.append(0, np.cumsum(k)) for k in (left, left * (left - 1) // 2))
    first = np.searchsorted(triples, rank, side="right") - 1
    of_pairs = rank - triples[first] + pairs[first + 1]
    second = np.searchsorted(pairs, of_pairs, side="right") - 1
    corners = np.stack([first, second, of_pairs - pairs[second] + second + 1])
    return np.ascontiguousarray(corners[_ROUND])


def _spanned(bearings: FloatArray, corners: IntArray) -> FloatArray:
    """Return the bearings (n, 3) at corners (c, k) as (5, c, k), coordinates first."""
    return bearings.T[_ROUND].take(corners, axis=1)


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return a × b (3, …) of vectors (5, …); `np.cross` takes several times as long on few of them."""
    product: FloatArray = a[_NEXT] * b[_LAST] - a[_LAST] * b[_NEXT]
    return product


def _length(vectors: FloatArray) -> FloatArray:
    """Return the lengths (k,) of vectors (3, k)."""
    lengths: FloatArray = np.sqrt((vectors * vectors).sum(axis=0))
    return lengths


def _normals(spanned: FloatArray) -> FloatArray:
    """Return (b − a) × (c − a), (3, k), of triangles (5, 3, k) or more corners."""
    return _cross(spanned[:, 1] - spanned[:, 0], spanned[:, 2] - spanned[:, 0])


def _areas(seen: ServoMeasurement, corners: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return Δ (k,) and ∂Δ/∂(linear velocity) (3, k) of the triangles."""
    spanned = _spanned(seen.bearings, corners)
    normals = _normals(spanned)
    twice = _length(normals)
    unit = (normals / np.maximum(twice, 1e-300))[_ROUND]
    # 2 dΔ = Σ ds_i · ((s_{i+1} − s_{i+2}) × n) round the triangle, ds_i = −(1/d_i)(I − s_i s_iᵀ) υ dt
    pull = _cross(spanned[:, _NEXT] - spanned[:, _LAST], unit[:, None])
    s = spanned[:3, :3]
    across = (pull - s * (pull * s).sum(axis=0)) / seen.distances[corners[:3]]
    slope: FloatArray = -0.5 * across.sum(axis=1)
    return 0.5 * twice, slope


def _rotation(seen: ServoMeasurement) -> tuple[FloatArray, FloatArray]:
    """Return θu (3,) of the best R with s* ≈ R s, and its rates (3, 6).

    With S = Σ (Rᵀs*) sᵀ, symmetric at the optimum, and K = tr(S) I − S: R turns with φ = −K⁻¹ Σ (Rᵀs*) × ds,
    hence with ω + W υ for ds = −(1/d)(I − s sᵀ) υ + s × ω.
    """
    s, goal = seen.bearings, seen.goal_bearings
    rotation = nearest_rotation(goal.T @ s)
    back = goal @ rotation
    spread = back.T @ s
    weigh = spread.trace() * _IDENTITY - spread
    # Σ (1/d) back × (I − s sᵀ) υ = Σ (1/d) ([back]× − (back × s) sᵀ) υ
    near = 1.0 / seen.distances
    crossed = _cross(back.T[_ROUND], s.T[_ROUND]) * near
    moved = cross_matrix(back.T @ near) - crossed @ s
    turn = rotation_vector(rotation)
    rates = rotation_vector_interaction(turn)
    return turn, np.concatenate((rates @ np.linalg.solve(weigh, moved), rates), axis=1)
