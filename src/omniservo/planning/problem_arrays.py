"""A planning problem as arrays for kernels: what to keep, and the list of margins to report."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from omniservo.cameras import ImageLimits, UnifiedCamera
from omniservo.cameras.distorted_region import smallest_scale
from omniservo.cameras.model_domain import model_domain, radius_of_angle
from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray
from omniservo.planning.body_arrays import (
    bodies_of,
    clearance_of,
    hulls_of,
    is_body,
    motion_indices,
    motions_of,
)
from omniservo.planning.certificate import margin_kinds
from omniservo.planning.constraints.constraints import Constraints, Slots
from omniservo.planning.obstacles.ball_tree import BallTree
from omniservo.planning.obstacles.cloud import Cloud
from omniservo.planning.obstacles.half_space import HalfSpace
from omniservo.planning.obstacles.obstacle import Obstacle, hides_points
from omniservo.planning.obstacles.sphere import Sphere
from omniservo.planning.planning_problem import PlanningProblem
from omniservo.planning.workspace import Workspace

TIGHTER_PX = 3e-7
"""Plans are searched with limits so much further inward: more than proving the margin 0 needs."""


_BEYOND_IMAGE = 10.0
"""Circles end at so many times the image's farthest corner."""

COARSE = 1e-4
"""Margins about bodies are claimed so much below the smallest seen [m]: closer takes more planes."""


_SIGHTS = {
    margin_kinds.CLEARANCE: margin_kinds.SIGHT,
    margin_kinds.BODY: margin_kinds.BODY_SIGHT,
    margin_kinds.CLOUD: margin_kinds.CLOUD_SIGHT,
}
"""kind of an obstacle's lines of sight, by that of its clearance"""


class Entry(NamedTuple):
    """One constraint of the certificate."""

    name: str
    unit: str
    about_point: bool
    kind: int
    about: int
    scale: float
    step: float
    shows_planes: bool = False
    """the separating planes that prove it are stored with the plan"""


def constraints_of(problem: PlanningProblem, limits: ImageLimits) -> Constraints:
    """Return what a path must keep; ``limits`` are the image limits to use."""
    in_space = _constraints_in_space(problem)
    return in_space._replace(
        limits=limits.cones,
        disc=_disc(problem.camera, limits),
        mask_edges=_mask_edges(problem.camera, limits),
        mask_firsts=np.cumsum([0, *(len(lines) for lines in limits.mask)]),
    ).with_slots()


def searched_constraints(problem: PlanningProblem) -> Constraints:
    """Return what a path must keep in a search: a little more than is required.

    Raises:
        InputError: the visibility margin leaves nothing of the image.
    """
    return constraints_of(problem, image_limits(problem, TIGHTER_PX))


class ConstraintTable(NamedTuple):
    """A problem as required, without anything tightened."""

    constraints: Constraints
    optics: FloatArray
    """`optics_of`"""
    entries: list[Entry]
    table: FloatArray
    """`entry_table`"""


@lru_cache(maxsize=2)
def constraint_table_of(problem: PlanningProblem) -> ConstraintTable:
    """Return what the end poses and every path of a problem are judged by; kept, not to be changed.

    Raises:
        InputError: the visibility margin leaves nothing of the image.
    """
    limits = image_limits(problem, 0.0)
    constraints = constraints_of(problem, limits)
    entries = entries_of(problem, limits, constraints.ell)
    return ConstraintTable(constraints, optics_of(problem), entries, entry_table(entries))


@lru_cache(maxsize=2)
def _constraints_in_space(problem: PlanningProblem) -> Constraints:
    """Return a problem's constraints without the image limits: kept for all that ask for them."""
    distances = np.sqrt(np.einsum("ij,ij->i", problem.points, problem.points))
    clouds, trees = _clouds(problem)
    box = np.array([[-math.inf] * 3, [math.inf] * 3])
    if problem.workspace is not None and problem.workspace.min is not None:
        box = np.array([problem.workspace.min, problem.workspace.max])
    return Constraints(
        points=np.array(problem.points, order="C"),
        limits=np.zeros((0, 4)),
        disc=np.zeros(0),
        mask_edges=np.zeros((0, 5)),
        mask_firsts=np.zeros(1, dtype=np.int64),
        obstacles=_spheres(problem),
        bodies=bodies_of(problem),
        hulls=hulls_of(problem),
        planes=_planes(problem),
        clouds=clouds,
        cloud_points=trees.points,
        cloud_nodes=trees.nodes,
        motions=motions_of(problem),
        box=box,
        least_distance=float(problem.least_distance),
        occlusion=bool(problem.occlusion),
        ell=max(1e-6, float(distances.mean())),
        slots=Slots(*[0] * len(Slots._fields)),
    )


def image_limits(problem: PlanningProblem, extra: float) -> ImageLimits:
    """Return the camera's limits moved inward by the visibility margin and ``extra`` px.

    Raises:
        InputError: the margin leaves nothing of the image.
    """
    try:
        return problem.camera.image_limits(problem.image_margin + extra)
    except InputError as error:
        raise InputError(f"visibility_margin: {_spelled(problem)} given: {error}") from None


def _spelled(problem: PlanningProblem) -> str:
    deviation = problem.camera.deviation_px
    more = f", and the camera's deviation of {deviation:g} px," if deviation else ""
    return f"{problem.visibility_margin:g} px{more}"


def _disc(camera: UnifiedCamera, limits: ImageLimits) -> FloatArray:
    zone = limits.dead_zone
    if zone is None:
        return np.zeros(0)
    u, v = zone.center
    return np.array([camera.fx, camera.skew, camera.fy, camera.cx - u, camera.cy - v, zone.radius, camera.xi])


def _clearance_kind(obstacle: Obstacle) -> int:
    """Return the kind of an obstacle's clearance: a sphere that moves is a body."""
    if isinstance(obstacle, HalfSpace | Cloud):
        return margin_kinds.FREE_SIDE if isinstance(obstacle, HalfSpace) else margin_kinds.CLOUD
    return margin_kinds.BODY if is_body(obstacle) else margin_kinds.CLEARANCE


def _mask_edges(camera: UnifiedCamera, limits: ImageLimits) -> FloatArray:
    """Return the cones of the mask's edges (`image_mask`): n·p ≥ b is (Kᵀ(−n, b))·c ≤ −ξ (Kᵀ(−n, b))₃ ρ."""
    if not limits.mask:
        return np.zeros((0, 5))
    lines = np.vstack(limits.mask) * [-1.0, -1.0, 1.0]
    normals = lines @ camera.matrix
    lengths = np.linalg.norm(normals, axis=1)
    edges = np.column_stack([normals, -camera.xi * normals[:, 2], lengths**2])
    return np.asarray(edges / lengths[:, None], dtype=np.float64)


def _spheres(problem: PlanningProblem) -> FloatArray:
    rows = [
        (*o.center.tolist(), o.radius, o.radius + clearance_of(problem, o))
        for o in problem.obstacles
        if isinstance(o, Sphere) and o.motion is None
    ]
    return np.array(rows, dtype=np.float64).reshape(-1, 5)


def _planes(problem: PlanningProblem) -> FloatArray:
    rows = [
        (*o.normal, o.offset + clearance_of(problem, o), clearance_of(problem, o), motion)
        for o, motion in zip(problem.obstacles, motion_indices(problem), strict=True)
        if isinstance(o, HalfSpace)
    ]
    if problem.workspace is not None:
        rows += [(*side.normal, side.offset, 0.0, -1.0) for side in problem.workspace.half_spaces]
    return np.array(rows, dtype=np.float64).reshape(-1, 6)


def _clouds(problem: PlanningProblem) -> tuple[FloatArray, BallTree]:
    found = zip(problem.obstacles, motion_indices(problem), strict=True)
    clouds = [(o, motion) for o, motion in found if isinstance(o, Cloud)]
    if not clouds:
        return np.zeros((0, 7)), BallTree(np.zeros((0, 3)), np.zeros((0, 7)))
    points, nodes = [o.tree.points for o, _ in clouds], [o.tree.nodes for o, _ in clouds]
    ends = np.cumsum([(0, 0)] + [(len(k), len(p)) for k, p in zip(nodes, points, strict=True)], axis=0)
    rows = [
        (begin[0], end[0], begin[1], end[1], o.radius, o.radius + clearance_of(problem, o), motion)
        for begin, end, (o, motion) in zip(ends[:-1], ends[1:], clouds, strict=True)
    ]
    return np.array(rows, dtype=np.float64), BallTree(np.concatenate(points), np.concatenate(nodes))


def optics_of(problem: PlanningProblem) -> FloatArray:
    """Return the ``optics`` of `margins.path_margins`.

    A circle beyond the whole image is drawn in: its margin is a finite number, whose digits tell 1e-7 px.
    """
    camera = problem.camera
    angle = camera.max_angle
    radius = math.inf if angle is None else radius_of_angle(camera.xi, angle)
    radius = min(radius, _BEYOND_IMAGE * _farthest_corner(camera))
    domain = math.acos(model_domain(camera.xi)[0])
    return np.array([camera.xi, radius, smallest_scale(camera), problem.image_margin, domain])


def _farthest_corner(camera: UnifiedCamera) -> float:
    """Return the largest ‖m‖ of the image's corners, before distortion."""
    u, v = np.array([-0.5, camera.width - 0.5]), np.array([-0.5, camera.height - 0.5])
    corners = np.array([[a, b, 1.0] for a in u for b in v])
    return float(np.linalg.norm(np.linalg.solve(camera.matrix, corners.T)[:2], axis=0).max())


def entries_of(problem: PlanningProblem, limits: ImageLimits, ell: float) -> list[Entry]:
    """Return every constraint whose margin `margins.path_margins` can find, in the certificate's order.

    The visibility polygon and the dead zone of a distorted camera are not among them.
    """
    metre, entries = 1e-9 * ell, []
    for i, (o, about) in enumerate(_among_its_kind(problem)):
        kind = _clearance_kind(o)
        step = COARSE if kind == margin_kinds.BODY else metre
        name, planes = f"clearance obstacle {i}", kind == margin_kinds.BODY and not isinstance(o, Sphere)
        entries.append(Entry(name, "m", False, kind, about, 1.0, step, planes))
    if not problem.camera.is_distorted:
        entries += _image_entries(problem.camera, limits)
    entries.append(Entry("domain", "rad", True, margin_kinds.DOMAIN, 0, 1.0, 1e-9))
    entries.append(Entry("least_distance", "m", True, margin_kinds.LEAST, 0, 1.0, metre))
    if problem.occlusion:
        for i, (o, about) in enumerate(_among_its_kind(problem)):
            name = f"occlusion obstacle {i}"
            if not hides_points(o):
                continue
            kind = _SIGHTS[_clearance_kind(o)]
            step = COARSE if kind == margin_kinds.BODY_SIGHT else metre
            planes = kind == margin_kinds.BODY_SIGHT and not isinstance(o, Sphere)
            entries.append(Entry(name, "m", True, kind, about, 1.0, step, planes))
    if problem.workspace is not None:
        entries += _workspace_entries(problem, problem.workspace, metre)
    entries.append(Entry("rotation", "1", False, margin_kinds.ROTATION, 0, 1.0, 1e-9))
    return entries


def _workspace_entries(problem: PlanningProblem, workspace: Workspace, metre: float) -> list[Entry]:
    """Return the walls of the box, then the half-spaces, whose rows follow those of the obstacles."""
    entries = [
        Entry(f"workspace {'xyz'[axis]} {side}", "m", False, margin_kinds.WALL, 3 * wall + axis, 1.0, metre)
        for wall, side in enumerate(("min", "max") if workspace.min is not None else ())
        for axis in range(3)
    ]
    first = sum(isinstance(o, HalfSpace) for o in problem.obstacles)
    return entries + [
        Entry(f"workspace half-space {i}", "m", False, margin_kinds.FREE_SIDE, first + i, 1.0, metre)
        for i in range(len(workspace.half_spaces))
    ]


def _among_its_kind(problem: PlanningProblem) -> list[tuple[Obstacle, int]]:
    """Return every obstacle with its row in its kind's array: spheres, half-spaces, bodies, clouds."""
    seen: dict[int, int] = {}
    found = []
    for o in problem.obstacles:
        kind = _clearance_kind(o)
        found.append((o, seen.get(kind, 0)))
        seen[kind] = seen.get(kind, 0) + 1
    return found


def _image_entries(camera: UnifiedCamera, limits: ImageLimits) -> list[Entry]:
    entries = []
    lengths = np.linalg.norm(limits.normals, axis=1)
    for i, name in enumerate(limits.names):
        if name.endswith("edge"):
            column, focal = (0, camera.fx) if name in ("left edge", "right edge") else (1, camera.fy)
            scale = abs(focal) / (abs(limits.normals[i, column]) / lengths[i])
            entries.append(Entry(f"visibility {name}", "px", True, margin_kinds.EDGE, i, float(scale), 1e-6))
        elif name == "max_angle":
            entries.append(Entry("visibility max_angle", "px", True, margin_kinds.CIRCLE, i, 1.0, 1e-6))
    if limits.dead_zone is not None:
        entries.append(Entry("dead_zone", "px", True, margin_kinds.DISC, 0, 1.0, 1e-6))
    for i in range(len(limits.mask)):
        entries.append(Entry(f"visibility mask {i}", "px", True, margin_kinds.MASK, i, 1.0, 1e-6))
    return entries


def entry_table(entries: list[Entry]) -> FloatArray:
    """Return the entries as rows (e, 4): kind, index, scale, step."""
    rows = [(e.kind, e.about, e.scale, e.step) for e in entries]
    return np.array(rows, dtype=np.float64).reshape(-1, 4)
