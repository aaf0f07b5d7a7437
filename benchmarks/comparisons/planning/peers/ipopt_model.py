"""The constraints of `samples` as CasADi expressions: one model for all problems of one structure.

Numbers of a problem are parameters, so that a model and its exact derivatives are built once for each number
of points, obstacles and so on. Rows stand in the order of `samples.families`, sample by sample.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from benchmarks.comparisons.planning.neutral import SMALLEST_UNIT, Neutral
from benchmarks.comparisons.planning.path_space import PathSpace, bernstein_basis
from benchmarks.comparisons.planning.samples import ROTATION_FLOOR

from omniservo.geometry.arrays import FloatArray

TINY = 1e-24
"""under a root, so that its derivatives are finite at 0 [m², px²]"""


class Structure(NamedTuple):
    """What two problems must share to share a model."""

    sigma: int
    tau: int
    points: int
    limits: int
    disc: bool
    spheres: int
    boxes: int
    hiding: int


class Model(NamedTuple):
    """Symbols of a model."""

    x: Any
    """unknowns of `PathSpace` (nx,)"""
    parameters: Any
    """numbers of a problem, as `parameters_of` gives them"""
    g: Any
    """constraints (s·m,)"""


def structure_of(space: PathSpace) -> Structure:
    """Return the structure of a problem's paths."""
    neutral = space.neutral
    return Structure(
        space.sigma,
        space.tau,
        len(neutral.points),
        len(neutral.limits),
        bool(neutral.disc.size),
        len(_solid(neutral)),
        len(neutral.boxes),
        len(_hiding(neutral)),
    )


def parameters_of(neutral: Neutral) -> FloatArray:
    """Return the numbers of a problem, in the order of `_shapes`."""
    parts = (
        neutral.quaternion,
        neutral.translation,
        [neutral.ell, neutral.least_distance],
        neutral.points,
        neutral.limits,
        neutral.disc,
        _solid(neutral),
        neutral.boxes,
        _hiding(neutral),
    )
    return np.concatenate([np.ravel(part) for part in parts])


def _solid(neutral: Neutral) -> FloatArray:
    """Return centre and reach of the spheres to keep away from (m, 4)."""
    return neutral.spheres[neutral.spheres[:, 4] > 0.0][:, [0, 1, 2, 4]]


def _hiding(neutral: Neutral) -> FloatArray:
    """Return centre and radius of the spheres that hide (q, 4)."""
    return neutral.spheres[(neutral.spheres[:, 3] > 0.0) & neutral.occlusion][:, :4]


def _shapes(s: Structure) -> dict[str, tuple[int, int]]:
    """Return name → (width of a row, rows) of the parameters."""
    return {
        "quaternion": (4, 1),
        "translation": (3, 1),
        "lengths": (2, 1),
        "points": (3, s.points),
        "limits": (4, s.limits),
        "disc": (7, int(s.disc)),
        "spheres": (4, s.spheres),
        "boxes": (16, s.boxes),
        "hiding": (4, s.hiding),
    }


def model_of(structure: Structure, w: FloatArray) -> Model:
    """Return the model at samples w (s,)."""
    sigma, tau = structure.sigma, structure.tau
    shapes = _shapes(structure)
    parameters = ca.SX.sym("p", sum(width * rows for width, rows in shapes.values()))
    given, first = {}, 0
    for name, (width, rows) in shapes.items():
        given[name] = ca.reshape(parameters[first : first + width * rows], width, rows)
        first += width * rows
    turns = 4 * (sigma - 1)
    x = ca.SX.sym("x", turns + 3 * (tau - 1))
    part = ca.DM(np.arange(sigma + 1) / sigma).T
    phi = ca.DM([0.0, 0.0, 0.0, 1.0]) @ (1.0 - part) + given["quaternion"] @ part
    phi[:, 1:-1] += ca.reshape(x[:turns], 4, sigma - 1)
    t = given["translation"] @ ca.DM(np.arange(tau + 1) / tau).T
    t[:, 1:-1] += given["lengths"][0] * ca.reshape(x[turns:], 3, tau - 1)
    phi, t = phi @ ca.DM(bernstein_basis(sigma, w)).T, t @ ca.DM(bernstein_basis(tau, w)).T
    rows = [_pose_rows(given, phi[:, s], t[:, s]) for s in range(len(w))]
    return Model(x, parameters, ca.vertcat(*rows))


def _pose_rows(given: dict[str, Any], phi: Any, t: Any) -> Any:
    """Return the constraints at one pose (m,)."""
    n, ell = given["points"].shape[1], given["lengths"][0]
    away = given["points"] - ca.repmat(t, 1, n)
    distance = ca.sqrt(ca.sum1(away**2))
    bearings = _rotation(phi).T @ away / ca.repmat(distance, 3, 1)
    kappas = ca.repmat(given["limits"][3, :].T, 1, n)
    rows = [ca.vec(kappas - given["limits"][:3, :].T @ bearings)]
    if given["disc"].shape[1]:
        rows.append(_dead_zone(given["disc"], bearings))
    rows.append((distance.T - given["lengths"][1]) / ell)
    spheres = given["spheres"]
    rows.append(_gap(ca.repmat(t, 1, spheres.shape[1]) - spheres[:3, :], spheres[3, :], ell))
    for i in range(given["boxes"].shape[1]):
        rows.append(_box(given["boxes"][:, i], t, ell))
    for i in range(given["hiding"].shape[1]):
        p = ca.repmat(t - given["hiding"][:3, i], 1, n)
        nearest = ca.fmin(ca.fmax(-ca.sum1(p * away) / distance**2, 0.0), 1.0)
        rows.append(_gap(p + ca.repmat(nearest, 3, 1) * away, given["hiding"][3, i], ell))
    rows.append(ca.dot(phi, phi) - ROTATION_FLOOR)
    return ca.vertcat(*rows)


def _rotation(phi: Any) -> Any:
    """Return R (3, 3) of a quaternion of any length."""
    x, y, z, w = phi[0], phi[1], phi[2], phi[3]
    f = 2.0 / ca.dot(phi, phi)
    return ca.vertcat(
        ca.horzcat(1.0 - f * (y * y + z * z), f * (x * y - z * w), f * (x * z + y * w)),
        ca.horzcat(f * (x * y + z * w), 1.0 - f * (x * x + z * z), f * (y * z - x * w)),
        ca.horzcat(f * (x * z - y * w), f * (y * z + x * w), 1.0 - f * (x * x + y * y)),
    )


def _dead_zone(disc: Any, bearings: Any) -> Any:
    """Return (‖(U, V)‖ − r D)/|fx| of unit bearings (3, n)."""
    d = bearings[2, :] + disc[6]
    u = disc[0] * bearings[0, :] + disc[1] * bearings[1, :] + disc[3] * d
    v = disc[2] * bearings[1, :] + disc[4] * d
    return ((ca.sqrt(u**2 + v**2 + TINY) - disc[5] * d) / ca.fabs(disc[0])).T


def _gap(offset: Any, reach: Any, ell: Any) -> Any:
    """Return (‖offset‖ − reach)/unit of offsets (3, m)."""
    return ((ca.sqrt(ca.sum1(offset**2) + TINY) - reach) / ca.fmax(reach, SMALLEST_UNIT * ell)).T


def _box(box: Any, t: Any, ell: Any) -> Any:
    """Return (signed distance − clearance)/unit."""
    beyond = ca.fabs(ca.reshape(box[3:12], 3, 3).T @ (t - box[:3])) - box[12:15]
    outside = ca.fmax(beyond, 0.0)
    deepest = ca.mmax(beyond)
    signed = ca.if_else(deepest > 0.0, ca.sqrt(ca.dot(outside, outside) + TINY), deepest)
    return (signed - box[15]) / ca.fmax(box[15], SMALLEST_UNIT * ell)
