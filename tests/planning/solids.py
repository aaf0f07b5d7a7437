"""Solid obstacles as test references: distances by definition or by SciPy, and problems about them."""

import numpy as np
from scipy.optimize import lsq_linear, minimize, minimize_scalar, nnls
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import preset
from omniservo.planning import (
    CameraPath,
    Capsule,
    Cylinder,
    Ellipsoid,
    HalfSpace,
    Mesh,
    PlanningProblem,
    Sphere,
)

FINE = np.linspace(0.0, 1.0, 5001)
POINTS = np.array([[-0.1, -0.1, 0.6], [0.1, -0.1, 0.55], [0.1, 0.1, 0.6], [-0.1, 0.1, 0.62], [0, 0, 0.58]])
GOAL = np.array([0.0, -0.10, 0.20])


def asked(*obstacles, points=POINTS, goal=GOAL, turn=(0.0, 0.0, 0.0), **changes):
    fields = {"clearance": 0.01, "least_distance": 0.02} | changes
    pose = RigidTransform.from_components(np.array(goal), Rotation.from_rotvec(turn))
    return PlanningProblem(preset("fe185"), points, pose, obstacles, **fields)


def distances(obstacle, x):
    """Signed distances of points x (…, 3) to the surface: the definition, in NumPy."""
    if isinstance(obstacle, Sphere):
        return np.linalg.norm(x - obstacle.center, axis=-1) - obstacle.radius
    if isinstance(obstacle, Mesh):
        flat = [hull_distance(obstacle.vertices, p, p) for p in np.reshape(x, (-1, 3))]
        return np.reshape(flat, np.shape(x)[:-1])
    if isinstance(obstacle, Cylinder | Ellipsoid):
        flat = [sight_distance(obstacle, p, p) for p in np.reshape(x, (-1, 3))]
        return np.reshape(flat, np.shape(x)[:-1])
    if isinstance(obstacle, HalfSpace):
        return x @ obstacle.normal - obstacle.offset
    if isinstance(obstacle, Capsule):
        along = obstacle.end - obstacle.start
        share = np.clip((x - obstacle.start) @ along / (along @ along), 0.0, 1.0)
        return np.linalg.norm(x - obstacle.start - share[..., None] * along, axis=-1) - obstacle.radius
    axes = Rotation.from_quat(obstacle.quaternion).as_matrix()
    beyond = np.abs((x - obstacle.center) @ axes) - obstacle.half_extents
    return np.linalg.norm(np.maximum(beyond, 0.0), axis=-1) + np.minimum(beyond.max(axis=-1), 0.0)


def sight_distance(obstacle, t, h):
    """Distance of the segment from t to h to the surface, by SciPy's bounded least squares."""
    if isinstance(obstacle, Mesh):
        return hull_distance(obstacle.vertices, t, h)
    if isinstance(obstacle, Cylinder | Ellipsoid):
        return round_distance(obstacle, t, h)
    if isinstance(obstacle, Sphere):
        columns, center, low, high, radius = [], obstacle.center, [], [], obstacle.radius
    elif isinstance(obstacle, Capsule):
        columns, center = [obstacle.end - obstacle.start], obstacle.start
        low, high, radius = [0.0], [1.0], obstacle.radius
    else:
        columns, center = list(Rotation.from_quat(obstacle.quaternion).as_matrix().T), obstacle.center
        low, high, radius = list(-obstacle.half_extents), list(obstacle.half_extents), 0.0
    system = np.column_stack([h - t, *(-c for c in columns)])
    found = lsq_linear(system, center - t, bounds=([0.0, *low], [1.0, *high]), method="bvls")
    return np.sqrt(2.0 * found.cost) - radius


def round_distance(obstacle, t, h):
    """Distance of the segment from t to h to a cylinder or an ellipsoid outside: SciPy's SLSQP."""
    if isinstance(obstacle, Cylinder):
        center, half = 0.5 * (obstacle.start + obstacle.end), 0.5 * (obstacle.end - obstacle.start)
        length = np.linalg.norm(half)
        axes = np.linalg.svd(half[None] / length)[2].T
        axes[:, 0] = half / length
        sizes = np.array([length, obstacle.radius, obstacle.radius])
        discs = [np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 1.0])]
    else:
        center, sizes = obstacle.center, obstacle.radii
        axes = Rotation.from_quat(obstacle.quaternion).as_matrix()
        discs = [np.ones(3)]
    spread = axes * sizes
    within = [
        {
            "type": "ineq",
            "fun": lambda y, on=on: 1.0 - on @ y[:3] ** 2,
            "jac": lambda y, on=on: np.append(-2.0 * on * y[:3], 0.0),
        }
        for on in discs
    ]

    def apart(y):
        return center + spread @ y[:3] - t - y[3] * (h - t)

    for start in (
        [0.0, 0.0, 0.0, 0.5],
        [0.3, 0.2, 0.1, 0.9],
    ):  # convex: one start is enough, if SLSQP ends well
        found = minimize(
            lambda y: float(apart(y) @ apart(y)),
            start,
            jac=lambda y: 2.0 * np.append(spread.T @ apart(y), -(h - t) @ apart(y)),
            bounds=[(None, None)] * 3 + [(0.0, 1.0)],
            constraints=within,
            method="SLSQP",
            options={"ftol": 1e-16, "maxiter": 500},
        )
        if min(w["fun"](found.x) for w in within) > -1e-9:
            return np.sqrt(max(found.fun, 0.0))
    raise AssertionError(found.message)


def hull_distance(vertices, t, h):
    """Distance of the segment from t to h to the hull of vertices: SciPy's non-negative least squares."""
    heavy, n = 1e3, len(vertices)
    system = np.zeros((5, n + 2))
    system[:3] = np.column_stack([vertices.T, -t, -h])
    system[3, :n] = system[4, n:] = heavy
    weights = nnls(system, np.array([0.0, 0.0, 0.0, heavy, heavy]))[0]
    near = vertices.T @ weights[:n] / weights[:n].sum()
    return np.linalg.norm(near - (weights[n] * t + weights[n + 1] * h) / weights[n:].sum())


def margins_of(certificate):
    return {c.name.split(" (")[0]: c.margin for c in certificate.constraints}


def displaced(obstacle, w):
    """m(w) of an obstacle (…, 3), 0 where it stands still."""
    motion = np.zeros((3, 1)) if obstacle.motion is None else obstacle.motion
    return np.stack([np.polyval(row, w) for row in motion], axis=-1)


def true_clearance(obstacle, path):
    """The smallest distance along the path, refined beyond the samples."""

    def away(w):
        return distances(obstacle, path.positions(w) - displaced(obstacle, w))

    w = FINE[::250] if isinstance(obstacle, Mesh | Cylinder | Ellipsoid) else FINE
    values = away(w)
    k = int(np.argmin(values))
    around = w[max(k - 1, 0)], w[min(k + 1, len(w) - 1)]
    best = minimize_scalar(
        lambda w: float(away(w)),
        bounds=around,
        method="bounded",
        options={"xatol": 1e-13},
    )
    return min(float(best.fun), float(values.min()))


def detour(dip):
    """A path to GOAL that bends by ``dip``."""
    bend = np.array(dip)
    rotation = np.array([[0.0, 0.0]] * 3 + [[0.0, 1.0]])
    return CameraPath(rotation, np.column_stack([-4.0 * bend, GOAL + 4.0 * bend, np.zeros(3)]))
