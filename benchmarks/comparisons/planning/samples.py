"""What a path keeps at samples of w, in NumPy: g ≥ 0 where it keeps it, with exact derivatives.

Normalised as in our search. Limits: κ − n·c/‖c‖ (about radians). Dead zone: (‖(U, V)‖ − r D)/(|fx| ‖c‖), the
same. Lengths over a unit: least distance over ℓ; clearance over max(reach, ℓ/20), of a box over
max(clearance, ℓ/20); a line of sight's gap over max(radius, ℓ/20). Rotation: ‖φ‖² − 0.01.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from benchmarks.comparisons.planning.neutral import SMALLEST_UNIT, Neutral
from benchmarks.comparisons.planning.path_space import PathSpace, bernstein_basis
from scipy.spatial.transform import Rotation

from omniservo.geometry.arrays import FloatArray

ROTATION_FLOOR = 0.01


class Poses(NamedTuple):
    """A path at s samples."""

    phi: FloatArray
    """(s, 4)"""
    t: FloatArray
    """(s, 3) [m]"""
    R: FloatArray
    """(s, 3, 3)"""


class Slopes(NamedTuple):
    """∂g/∂φ and ∂g/∂t of a family's rows (s, m)."""

    phi: FloatArray | None
    """(s, m, 4), or None where g does not depend on φ"""
    t: FloatArray | None
    """(s, m, 3), or None"""


class Samples:
    """The constraints of a `PathSpace` at fixed samples w (s,)."""

    def __init__(self, space: PathSpace, w: FloatArray) -> None:
        self.space, self.w = space, np.asarray(w, dtype=np.float64)
        self._rotation = bernstein_basis(space.sigma, self.w)
        self._translation = bernstein_basis(space.tau, self.w)

    def poses(self, x: FloatArray) -> Poses:
        """Return the path of x at the samples."""
        controls, centres = self.space.controls(x)
        phi = self._rotation @ controls.T
        return Poses(phi, self._translation @ centres.T, Rotation.from_quat(phi).as_matrix())

    def values(self, x: FloatArray) -> FloatArray:
        """Return g (s, m), the families in the order of `families`."""
        return np.concatenate([g for g, _ in families(self.space.neutral, self.poses(x), False)], axis=1)

    def linearised(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return g (s, m) and ∂g/∂x (s, m, nx)."""
        found = families(self.space.neutral, self.poses(x), True)
        g = np.concatenate([values for values, _ in found], axis=1)
        jacobian = np.zeros((*g.shape, self.space.size))
        first, turns = 0, self.space.turns
        for values, slopes in found:
            block = jacobian[:, first : first + values.shape[1]]
            first += values.shape[1]
            if slopes.phi is not None and turns:
                _spread(slopes.phi, self._rotation, block[..., :turns])
            if slopes.t is not None and turns < self.space.size:
                _spread(self.space.neutral.ell * slopes.t, self._translation, block[..., turns:])
        return g, jacobian


def _spread(slopes: FloatArray, basis: FloatArray, out: FloatArray) -> None:
    """Write ∂g/∂control points: a block for each inner control point."""
    width = slopes.shape[2]
    for k in range(1, basis.shape[1] - 1):
        out[..., width * (k - 1) : width * k] = basis[:, k, None, None] * slopes


def families(neutral: Neutral, poses: Poses, slopes: bool) -> list[tuple[FloatArray, Slopes]]:
    """Return g (s, m) and its slopes, family by family.

    Limits (point by point, k each), dead zone (n), least distance (n), spheres with reach > 0, boxes,
    lines of sight (spheres with radius > 0, n each), rotation (1).
    """
    away = neutral.points[None] - poses.t[:, None]
    distance = np.maximum(np.linalg.norm(away, axis=2), 1e-12)
    c = away @ poses.R
    found = [_limits(neutral, poses, c, distance, slopes)]
    if neutral.disc.size:
        found.append(_dead_zone(neutral, poses, c, distance, slopes))
    found.append(
        (
            (distance - neutral.least_distance) / neutral.ell,
            Slopes(None, -away / (distance[..., None] * neutral.ell) if slopes else None),
        )
    )
    found += [_spheres(neutral, poses), _boxes(neutral, poses)]
    if neutral.occlusion:
        found.append(_sights(neutral, poses, away, distance))
    square = np.sum(poses.phi**2, axis=1)[:, None] - ROTATION_FLOOR
    found.append((square, Slopes(2.0 * poses.phi[:, None], None)))
    return found


def _camera_slopes(poses: Poses, c: FloatArray, slope: FloatArray) -> Slopes:
    """Return the slopes of values that depend on a camera point c alone, from ∂g/∂c (s, m, 3).

    dc = −Rᵀdt − ω × c with ω = 2 vec(φ* ⊗ dφ)/‖φ‖².
    """
    x, y, z, w = poses.phi.T
    rows = np.array([[w, z, -y, -x], [-z, w, x, -y], [y, -x, w, -z]])
    turn = np.moveaxis(rows, 2, 0) * (2.0 / np.sum(poses.phi**2, axis=1))[:, None, None]
    return Slopes(-np.cross(c, slope) @ turn, -slope @ poses.R.transpose(0, 2, 1))


def _limits(
    neutral: Neutral, poses: Poses, c: FloatArray, distance: FloatArray, slopes: bool
) -> tuple[FloatArray, Slopes]:
    normals, kappas = neutral.limits[:, :3], neutral.limits[:, 3]
    bearing = c / distance[..., None]
    along = bearing @ normals.T
    g = (kappas - along).reshape(len(c), -1)
    if not slopes:
        return g, Slopes(None, None)
    slope = (along[..., None] * bearing[:, :, None] - normals) / distance[..., None, None]
    shape = (len(c), -1, 3)
    return g, _camera_slopes(poses, np.repeat(c, len(normals), axis=1), slope.reshape(shape))


def _dead_zone(
    neutral: Neutral, poses: Poses, c: FloatArray, distance: FloatArray, slopes: bool
) -> tuple[FloatArray, Slopes]:
    fx, skew, fy, cu, cv, radius, xi = neutral.disc
    d = c[..., 2] + xi * distance
    u, v = fx * c[..., 0] + skew * c[..., 1] + cu * d, fy * c[..., 1] + cv * d
    length = np.hypot(u, v)
    g = (length - radius * d) / (abs(fx) * distance)
    if not slopes:
        return g, Slopes(None, None)
    eu, ev = u / np.maximum(length, 1e-12), v / np.maximum(length, 1e-12)
    third = eu * cu + ev * cv - radius
    bearing = c / distance[..., None]
    slope = np.stack([eu * fx, eu * skew + ev * fy, third], axis=-1) + (third * xi)[..., None] * bearing
    slope = (slope / abs(fx) - g[..., None] * bearing) / distance[..., None]
    return g, _camera_slopes(poses, c, slope)


def _spheres(neutral: Neutral, poses: Poses) -> tuple[FloatArray, Slopes]:
    rows = neutral.spheres[neutral.spheres[:, 4] > 0.0]
    unit = np.maximum(rows[:, 4], SMALLEST_UNIT * neutral.ell)
    offset = poses.t[:, None] - rows[:, :3]
    distance = np.linalg.norm(offset, axis=2)
    slope = offset / (np.maximum(distance, 1e-12) * unit)[..., None]
    return (distance - rows[:, 4]) / unit, Slopes(None, slope)


def _boxes(neutral: Neutral, poses: Poses) -> tuple[FloatArray, Slopes]:
    """Signed distance: outside that to the nearest point, inside minus the depth below the nearest face."""
    count = len(neutral.boxes)
    axes, extents, clearance = (
        neutral.boxes[:, 3:12].reshape(-1, 3, 3),
        neutral.boxes[:, 12:15],
        neutral.boxes[:, 15],
    )
    unit = np.maximum(clearance, SMALLEST_UNIT * neutral.ell)
    local = np.einsum("bki,sbi->sbk", axes, poses.t[:, None] - neutral.boxes[:, :3])
    beyond = np.abs(local) - extents
    outside = np.maximum(beyond, 0.0)
    gap = np.linalg.norm(outside, axis=2)
    inside = gap == 0.0
    face = np.eye(3)[np.argmax(beyond, axis=2)] if count else np.zeros((len(local), 0, 3))
    way = np.where(inside[..., None], face, outside / np.where(inside, 1.0, gap)[..., None])
    signed = np.where(inside, beyond.max(axis=2, initial=-np.inf), gap)
    slope = np.einsum("bki,sbk->sbi", axes, np.sign(local) * way)
    return (signed - clearance) / unit, Slopes(None, slope / unit[:, None])


def _sights(
    neutral: Neutral, poses: Poses, away: FloatArray, distance: FloatArray
) -> tuple[FloatArray, Slopes]:
    rows = neutral.spheres[neutral.spheres[:, 3] > 0.0]
    radius, unit = rows[:, 3], np.maximum(rows[:, 3], SMALLEST_UNIT * neutral.ell)
    p = (poses.t[:, None] - rows[:, :3])[:, :, None]
    part = np.clip(-np.sum(p * away[:, None], axis=3) / distance[:, None] ** 2, 0.0, 1.0)
    nearest = p + part[..., None] * away[:, None]
    gap = np.linalg.norm(nearest, axis=3)
    slope = nearest * ((1.0 - part) / (np.maximum(gap, 1e-12) * unit[:, None]))[..., None]
    g = ((gap - radius[:, None]) / unit[:, None]).reshape(len(p), -1)
    return g, Slopes(None, slope.reshape(len(p), -1, 3))
