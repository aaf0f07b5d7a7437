"""The paper's own search, (36)–(38): sampled max–min by Nelder–Mead."""

from __future__ import annotations

import contextlib
import math

import numpy as np

from omniservo.cameras import UnifiedCamera
from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray
from omniservo.planning.camera_path import CameraPath
from omniservo.planning.obstacles.sphere import Sphere
from omniservo.planning.planning_problem import PlanningProblem
from omniservo.planning.problem_arrays import constraints_of, image_limits

SAMPLES = 100
"""Samples of w, evenly on [0, 1]."""

EVALUATIONS = 4000
"""Evaluations of G before the search gives up."""


FIRST_STEP = 0.4
"""Size of the first simplex: in U, and in V times the mean distance of the target points. The paper does not
say; SciPy's 0.00025 around v = 0 takes ten times the evaluations."""


class _Found(Exception):
    """G > 0."""


def paper_path(problem: PlanningProblem) -> tuple[CameraPath, str]:
    """Return the path of (38) and a note on what had to differ from the paper's text.

    Unknowns v = (U, V) of (25), from v = 0, which is the path w^σ, w^τ; G is maximised by Nelder–Mead until
    it is positive. Constraints are those of (36): distance to every obstacle, Z > 0, the box (31) on the
    virtual plane, the dead zone (32). As in the paper there is none for occlusion, least distance, workspace
    and masks, and G mixes units. Where (30) is undefined (γ not a positive real number) the exact limits of
    the image take its place.

    Raises:
        InputError: an obstacle that is not a sphere, or moves: the paper has spheres that stand; or
            an initial velocity, which (25) does not know.
    """
    if problem.initial_velocity is not None:
        raise InputError('method: "paper" given; legal: "certified", where there is an initial_velocity')
    if not all(isinstance(o, Sphere) for o in problem.obstacles):
        raise InputError('method: "paper" given; legal: "certified", where an obstacle is not a sphere')
    for i, obstacle in enumerate(problem.obstacles):
        if obstacle.motion is not None:
            raise InputError(f'method: "paper" given; legal: "certified", where obstacle {i} moves')
    sigma, tau = problem.degrees.rotation, problem.degrees.translation
    box = virtual_box(problem.camera)
    view = _ExactView(problem) if box is None else _VirtualPlaneView(problem.camera, box)
    value = _Objective(problem, view, sigma, tau)
    simplex = first_simplex(problem)
    best = simplex[0]
    if value(best) <= 0.0 and best.size:
        best = _maximise(value, simplex)
    undefined = "(30) is undefined for this camera: its exact image limits are used in (36)"
    return value.path(best), undefined if box is None else ""


def first_simplex(problem: PlanningProblem) -> FloatArray:
    """Return v = 0 and a step along each unknown (nv+1, nv).

    Steps are a little askew, so that no two corners have the same G and the search is the same everywhere.
    """
    sigma, tau = problem.degrees.rotation, problem.degrees.translation
    ell = float(np.linalg.norm(problem.points, axis=1).mean())
    units = FIRST_STEP * np.array([1.0] * (4 * (sigma - 1)) + [ell] * (3 * (tau - 1)))
    askew = 1e-3 * np.arange(1.0, len(units) + 1.0)[:, None]
    return np.vstack([np.zeros(len(units)), (np.eye(len(units)) + askew) * units])


def _maximise(value: _Objective, simplex: FloatArray) -> FloatArray:
    """Return the best point of Nelder–Mead on −G, stopped as soon as G > 0."""
    from scipy.optimize import minimize  # slow to import, and few plans are searched for in this way

    best: FloatArray = simplex[0]
    most = value(best)

    def negative(v: FloatArray) -> float:
        nonlocal best, most
        g = value(v)
        if g > most:
            best, most = v.copy(), g
        if most > 0.0:
            raise _Found
        return -g

    with contextlib.suppress(_Found):
        minimize(
            negative,
            best,
            method="Nelder-Mead",
            options={"maxfev": EVALUATIONS, "adaptive": True, "initial_simplex": simplex},
        )
    return best


def virtual_box(camera: UnifiedCamera) -> tuple[float, float, float] | None:
    """Return (ζ_x, ζ_y, ζ_o) of (30), (32) on the virtual plane, or None where (30) is undefined.

    (ζ_x, ζ_y) = γ K⁻¹(width, height), with γ = (1 + ξδ)/(1 − ξ²r²), δ = √(1 + (1 − ξ²)r²) at that corner (5).
    ζ_o is the dead zone's radius carried over in the same way, along the x axis.
    """
    y = camera.height / camera.fy - camera.cy / camera.fy
    x = (camera.width - camera.cx - camera.skew * y) / camera.fx
    gamma = _gamma(camera.xi, math.hypot(x, y))
    if gamma is None:
        return None
    hole = 0.0
    if camera.dead_zone is not None:
        radius = camera.dead_zone.radius / abs(camera.fx)
        factor = _gamma(camera.xi, radius)
        if factor is None:
            return None
        hole = factor * radius
    return abs(gamma * x), abs(gamma * y), hole


def _gamma(xi: float, radius: float) -> float | None:
    """Return γ (5) at r on m̄, or None where it is not a positive real number."""
    square = 1.0 + (1.0 - xi * xi) * radius * radius
    below = 1.0 - (xi * radius) ** 2
    if square < 0.0 or below <= 0.0:
        return None
    return (1.0 + xi * math.sqrt(square)) / below


class _VirtualPlaneView:
    """(33) on camera points c = Λ(φ)ᵀ(h − t)."""

    def __init__(self, camera: UnifiedCamera, box: tuple[float, float, float]) -> None:
        self._x, self._y, self._hole = box
        self._dead = camera.dead_zone is not None

    def __call__(self, c: FloatArray) -> float:
        x, y, z = c[..., 0] ** 2, c[..., 1] ** 2, c[..., 2]
        least = min(z.min(), (self._x**2 * z**2 - x).min(), (self._y**2 * z**2 - y).min())
        if self._dead:
            least = min(least, (x + y - self._hole**2 * z**2).min())
        return float(least)


class _ExactView:
    """The image's cones, κ‖c‖ − n·c with unit n, and the dead zone's disc, (‖p − p₀‖ − r)/f."""

    def __init__(self, problem: PlanningProblem) -> None:
        constraints = constraints_of(problem, image_limits(problem, 0.0))
        self._normals, self._kappas = constraints.limits[:, :3], constraints.limits[:, 3]
        self._disc = constraints.disc

    def __call__(self, c: FloatArray) -> float:
        rho = np.sqrt(np.einsum("...i,...i->...", c, c))
        least = float((self._kappas * rho[..., None] - c @ self._normals.T).min())
        if self._disc.size:
            fx, skew, fy, cu, cv, radius, xi = self._disc
            d = c[..., 2] + xi * rho
            u = fx * c[..., 0] + skew * c[..., 1] + cu * d
            v = fy * c[..., 1] + cv * d
            least = min(least, float((np.hypot(u, v) - radius * d).min() / abs(fx)))
        return least


class _Objective:
    """G(v) (37)."""

    def __init__(
        self, problem: PlanningProblem, view: _ExactView | _VirtualPlaneView, sigma: int, tau: int
    ) -> None:
        self._view, self._sigma = view, sigma
        self._goal, self._quaternion = problem.goal_translation, problem.goal_quaternion
        self._points = problem.points
        spheres = [o for o in problem.obstacles if isinstance(o, Sphere)]
        self._obstacles = np.array([o.center for o in spheres]).reshape(-1, 3)
        self._reach = np.array(
            [o.radius + (problem.clearance if o.clearance is None else o.clearance) for o in spheres]
        )
        w = np.linspace(0.0, 1.0, SAMPLES)
        self._rotation_powers = w[None, :] ** np.arange(sigma, -1, -1)[:, None]
        self._translation_powers = w[None, :] ** np.arange(tau, -1, -1)[:, None]

    def coefficients(self, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return Ũ, Ṽ (25)."""
        split = 4 * (self._sigma - 1)
        u, free = v[:split].reshape(4, -1), v[split:].reshape(3, -1)
        start = np.array([0.0, 0.0, 0.0, 1.0])
        first_u = (self._quaternion - u.sum(axis=1) - start)[:, None]
        first_v = (self._goal - free.sum(axis=1))[:, None]
        return np.hstack([first_u, u, start[:, None]]), np.hstack([first_v, free, np.zeros((3, 1))])

    def path(self, v: FloatArray) -> CameraPath:
        """Return the path of v."""
        return CameraPath(*self.coefficients(v))

    def __call__(self, v: FloatArray) -> float:
        u, coefficients = self.coefficients(v)
        t = (coefficients @ self._translation_powers).T
        x, y, z, w = u @ self._rotation_powers
        matrix = np.array(
            [
                [x * x - y * y - z * z + w * w, 2 * (x * y - z * w), 2 * (x * z + y * w)],
                [2 * (x * y + z * w), -x * x + y * y - z * z + w * w, 2 * (y * z - x * w)],
                [2 * (x * z - y * w), 2 * (y * z + x * w), -x * x - y * y + z * z + w * w],
            ]
        )
        least = self._view(np.einsum("ijk,kni->knj", matrix, self._points[None] - t[:, None]))
        if len(self._obstacles):
            apart = t[:, None] - self._obstacles
            least = min(least, float((np.einsum("kmi,kmi->km", apart, apart) - self._reach**2).min()))
        return least
