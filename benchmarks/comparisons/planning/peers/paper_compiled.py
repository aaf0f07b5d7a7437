"""The paper's search (36)–(38), compiled: the same answers as `omniservo.planning.paper_search`, in Numba.

Nelder–Mead with adaptive coefficients on G at 100 samples, from v = 0 until G > 0. Neither its Bernstein form
nor any bound is used: it is what the paper does, without Python in the loop. No proof, no occlusion.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache
from time import perf_counter
from typing import NamedTuple

import numpy as np
from benchmarks.comparisons.planning.attempt import Attempt
from benchmarks.comparisons.planning.neutral import Neutral

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel
from omniservo.planning import CameraPath, Degrees, PlanningProblem, Sphere
from omniservo.planning.paper_search import EVALUATIONS, SAMPLES, first_simplex, virtual_box
from omniservo.planning.problem_arrays import constraints_of, image_limits

CALLBACKS = "Numba"

CLOSE = 1e-4
"""The simplex, and its values, differ by no more at the end, as in SciPy."""


class Search(NamedTuple):
    """What G reads."""

    points: FloatArray
    """(n, 3)"""
    limits: FloatArray
    """(k, 4) unit n and κ; (0, 4) where the virtual plane's box is used"""
    disc: FloatArray
    """(7,) or (0,)"""
    box: FloatArray
    """(ζ_x², ζ_y², ζ_o² or −1) of (30), (32); (0,) where (30) is undefined"""
    spheres: FloatArray
    """(m, 4): centre and squared reach"""
    quaternion: FloatArray
    translation: FloatArray
    rotation_powers: FloatArray
    """w^σ … 1 at the samples (s, σ+1)"""
    translation_powers: FloatArray
    """(s, τ+1)"""


def search_of(problem: PlanningProblem) -> Search:
    """Return the arrays of a problem whose obstacles are spheres."""
    box, camera = virtual_box(problem.camera), problem.camera
    plane = np.zeros(0)
    if box is not None:
        hole = box[2] ** 2 if camera.dead_zone is not None else -1.0
        plane = np.array([box[0] ** 2, box[1] ** 2, hole])
    constraints = constraints_of(problem, image_limits(problem, 0.0))
    spheres = [
        [*o.center, (o.radius + (problem.clearance if o.clearance is None else o.clearance)) ** 2]
        for o in problem.obstacles
        if isinstance(o, Sphere)
    ]
    w = np.linspace(0.0, 1.0, SAMPLES)[:, None]
    return Search(
        points=np.array(problem.points, order="C"),
        limits=np.ascontiguousarray(constraints.limits[:, :4]),
        disc=constraints.disc,
        box=plane,
        spheres=np.array(spheres, dtype=np.float64).reshape(-1, 4),
        quaternion=problem.goal_quaternion,
        translation=problem.goal_translation,
        rotation_powers=np.ascontiguousarray(w ** np.arange(problem.degrees.rotation, -1, -1)),
        translation_powers=np.ascontiguousarray(w ** np.arange(problem.degrees.translation, -1, -1)),
    )


@kernel
def coefficients(search: Search, v: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return Ũ, Ṽ (25)."""
    sigma, tau = search.rotation_powers.shape[1] - 1, search.translation_powers.shape[1] - 1
    u, c = np.zeros((4, sigma + 1)), np.zeros((3, tau + 1))
    u[3, sigma] = 1.0
    for r in range(4):
        total = 0.0
        for k in range(sigma - 1):
            u[r, k + 1] = v[r * (sigma - 1) + k]
            total += u[r, k + 1]
        u[r, 0] = search.quaternion[r] - total - u[r, sigma]
    first = 4 * (sigma - 1)
    for r in range(3):
        total = 0.0
        for k in range(tau - 1):
            c[r, k + 1] = v[first + r * (tau - 1) + k]
            total += c[r, k + 1]
        c[r, 0] = search.translation[r] - total
    return u, c


@kernel
def worst_value(search: Search, v: FloatArray) -> float:
    """Return G(v) (37)."""
    u, c = coefficients(search, v)
    rotation, translation, spheres = search.rotation_powers, search.translation_powers, search.spheres
    worst = math.inf
    for s in range(rotation.shape[0]):
        qx, qy, qz, qw, x, y, z = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for k in range(rotation.shape[1]):
            power = rotation[s, k]
            qx, qy = qx + power * u[0, k], qy + power * u[1, k]
            qz, qw = qz + power * u[2, k], qw + power * u[3, k]
        for k in range(translation.shape[1]):
            power = translation[s, k]
            x, y, z = x + power * c[0, k], y + power * c[1, k], z + power * c[2, k]
        worst = min(
            worst, _seen(search.points, search.limits, search.disc, search.box, qx, qy, qz, qw, x, y, z)
        )
        for i in range(spheres.shape[0]):
            a, b, d = x - spheres[i, 0], y - spheres[i, 1], z - spheres[i, 2]
            worst = min(worst, a * a + b * b + d * d - spheres[i, 3])
    return worst


@kernel
def _seen(
    points: FloatArray,
    limits: FloatArray,
    disc: FloatArray,
    box: FloatArray,
    x: float,
    y: float,
    z: float,
    w: float,
    tx: float,
    ty: float,
    tz: float,
) -> float:
    """Return the smallest visibility at φ = (x, y, z, w) and t, with c = Λ(φ)ᵀ(h − t)."""
    r00, r11 = x * x - y * y - z * z + w * w, y * y - x * x - z * z + w * w
    r22 = z * z - x * x - y * y + w * w
    r01, r02, r12 = 2.0 * (x * y - z * w), 2.0 * (x * z + y * w), 2.0 * (y * z - x * w)
    r10, r20, r21 = 2.0 * (x * y + z * w), 2.0 * (x * z - y * w), 2.0 * (y * z + x * w)
    worst = math.inf
    for j in range(points.shape[0]):
        a, b, c = points[j, 0] - tx, points[j, 1] - ty, points[j, 2] - tz
        cx, cy = r00 * a + r10 * b + r20 * c, r01 * a + r11 * b + r21 * c
        cz = r02 * a + r12 * b + r22 * c
        if box.shape[0] > 0:
            worst = min(worst, _in_box(box, cx, cy, cz))
            continue
        rho = math.sqrt(cx * cx + cy * cy + cz * cz)
        for i in range(limits.shape[0]):
            along = limits[i, 0] * cx + limits[i, 1] * cy + limits[i, 2] * cz
            worst = min(worst, limits[i, 3] * rho - along)
        if disc.shape[0] > 0:
            worst = min(worst, _outside(disc, cx, cy, cz, rho))
    return worst


@kernel
def _in_box(box: FloatArray, x: float, y: float, z: float) -> float:
    """Return the least of (33) on the virtual plane."""
    square = z * z
    value = min(z, min(box[0] * square - x * x, box[1] * square - y * y))
    if box[2] >= 0.0:
        value = min(value, x * x + y * y - box[2] * square)
    return value


@kernel
def _outside(disc: FloatArray, x: float, y: float, z: float, rho: float) -> float:
    """Return (‖p − p₀‖ − r) D/f of the dead zone's disc."""
    d = z + disc[6] * rho
    u, v = disc[0] * x + disc[1] * y + disc[3] * d, disc[2] * y + disc[4] * d
    return float((math.sqrt(u * u + v * v) - disc[5] * d) / abs(disc[0]))


@kernel
def maximise(search: Search, first: FloatArray) -> tuple[FloatArray, float, int]:
    """Return the best v, G there and the evaluations: Nelder–Mead from the simplex ``first`` (nv+1, nv).

    It stops as soon as G > 0.
    """
    simplex, values = first.copy(), np.empty(first.shape[0])
    calls = 0
    for k in range(first.shape[0]):
        values[k] = -worst_value(search, simplex[k])
        calls += 1
        if values[k] < 0.0:
            return simplex[k], -values[k], calls
    while calls < EVALUATIONS:
        _sort(simplex, values)
        if _is_small(simplex, values):
            break
        spent, best = _improve(search, simplex, values)
        calls += spent
        if best >= 0 and values[best] < 0.0:
            return simplex[best], -values[best], calls
    _sort(simplex, values)
    return simplex[0], -values[0], calls


@kernel
def _improve(search: Search, simplex: FloatArray, values: FloatArray) -> tuple[int, int]:
    """Replace the worst corner, or shrink; return the evaluations and the corner that may be good, or −1."""
    n = simplex.shape[1]
    centre = np.zeros(n)
    for k in range(n):
        for i in range(n):
            centre[i] += simplex[k, i] / n
    grow, contract, shrink = 1.0 + 2.0 / n, 0.75 - 0.5 / n, 1.0 - 1.0 / n
    reflected, tried = np.empty(n), np.empty(n)
    value = _try(search, simplex, centre, 1.0, reflected)
    if value < values[0]:
        if value >= 0.0:  # else it is the answer: no further corner is looked at
            further = _try(search, simplex, centre, grow, tried)
            if further < value:
                _replace(simplex, values, tried, further)
                return 2, n
            _replace(simplex, values, reflected, value)
            return 2, n
        _replace(simplex, values, reflected, value)
        return 1, n
    if value < values[n - 1]:
        _replace(simplex, values, reflected, value)
        return 1, n
    outside = value < values[n]
    nearer = _try(search, simplex, centre, contract if outside else -contract, tried)
    if nearer <= value if outside else nearer < values[n]:
        _replace(simplex, values, tried, nearer)
        return 2, n
    for k in range(1, n + 1):
        for i in range(n):
            simplex[k, i] = simplex[0, i] + shrink * (simplex[k, i] - simplex[0, i])
        values[k] = -worst_value(search, simplex[k])
        if values[k] < 0.0:
            return 2 + k, k
    return 2 + n, -1


@kernel
def _try(search: Search, simplex: FloatArray, centre: FloatArray, part: float, out: FloatArray) -> float:
    """Write centre + part · (centre − worst corner) and return −G there."""
    last = simplex.shape[0] - 1
    for i in range(out.shape[0]):
        out[i] = (1.0 + part) * centre[i] - part * simplex[last, i]
    return -worst_value(search, out)


@kernel
def _replace(simplex: FloatArray, values: FloatArray, corner: FloatArray, value: float) -> None:
    last = simplex.shape[0] - 1
    values[last] = value
    for i in range(corner.shape[0]):
        simplex[last, i] = corner[i]


@kernel
def _is_small(simplex: FloatArray, values: FloatArray) -> bool:
    widest, most = 0.0, 0.0
    for k in range(1, simplex.shape[0]):
        most = max(most, abs(values[k] - values[0]))
        for i in range(simplex.shape[1]):
            widest = max(widest, abs(simplex[k, i] - simplex[0, i]))
    return widest <= CLOSE and most <= CLOSE


@kernel
def _sort(simplex: FloatArray, values: FloatArray) -> None:
    """Sort the corners by value, the smallest first; equal ones stay in order."""
    for k in range(1, values.shape[0]):
        i = k
        while i > 0 and values[i] < values[i - 1]:
            values[i], values[i - 1] = values[i - 1], values[i]
            for c in range(simplex.shape[1]):
                simplex[i, c], simplex[i - 1, c] = simplex[i - 1, c], simplex[i, c]
            i -= 1


def quadratic(problem: PlanningProblem) -> PlanningProblem:
    """Return the problem at degree 2, as the paper has it, whatever degrees are allowed."""
    return replace(problem, degrees=Degrees(2, 2))


def sampled_value(problem: PlanningProblem, path: CameraPath) -> float:
    """Return G (37) of a path of degree 2."""
    v = np.concatenate([path.rotation[:, 1:-1].ravel(), path.translation[:, 1:-1].ravel()])
    return worst_value(search_of(quadratic(problem)), v)


@lru_cache(maxsize=1)
def _arrays(problem: PlanningProblem) -> tuple[Search, FloatArray]:
    """Return what the search reads, so that repeated calls follow one another at once."""
    return search_of(quadratic(problem)), first_simplex(quadratic(problem))


def solve(problem: PlanningProblem, neutral: Neutral, budget: float) -> Attempt:
    """Search at degree 2; ``budget`` is not needed."""
    search, simplex = _arrays(problem)
    begin = perf_counter()
    v, value, calls = maximise(search, simplex)
    rotation, translation = coefficients(search, v)
    seconds = perf_counter() - begin
    return Attempt(value > 0.0, CameraPath(rotation, translation), seconds, facts={"evaluations": calls})
