"""A plan file as exact numbers. Whatever it lacks or adds is said, never assumed."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

from omniservo.verification.bodies import Box, Capsule, axes_of
from omniservo.verification.fields import Fields, Malformed, NotJudged, PlanFileError, Vector, numbers

MOST_BYTES = 16 << 20
MOST_POINTS = MOST_OBSTACLES = 100_000
MOST_VERTICES = MOST_HALF_SPACES = 1000
MOST_PIECES = 200_000
HIGHEST_DEGREE = 20
STATUSES = ("certified", "refuted", "undecided", "infeasible", "not_found")
_LEAST_FOCAL = Fraction(1, 10**6)
_PROBLEM = (
    "format camera points goal obstacles clearance least_distance "
    "visibility_margin occlusion workspace degrees"
)
_NEAR_UNIT = Fraction(1, 10**6)


@dataclass(frozen=True)
class Camera:
    """The unified camera's numbers as they stand in the file."""

    fx: Fraction
    fy: Fraction
    cx: Fraction
    cy: Fraction
    skew: Fraction
    xi: Fraction
    distortion: Vector
    width: Fraction
    height: Fraction
    max_angle: Fraction | None
    dead_zone: tuple[Fraction, Fraction, Fraction] | None
    """(u₀, v₀, radius) [px]"""


@dataclass(frozen=True)
class Sphere:
    """The ball ‖x − center‖ ≤ radius; of radius 0 a point, which hides nothing."""

    center: Vector
    radius: Fraction
    clearance: Fraction


@dataclass(frozen=True)
class HalfSpace:
    """The solid normal·x < offset, the normal taken as a unit vector."""

    normal: Vector
    offset: Fraction
    clearance: Fraction


Obstacle = Sphere | HalfSpace | Box | Capsule


@dataclass(frozen=True)
class Piece:
    """A plane that separates a body from the path on [start, end]; the normal points to the path."""

    start: Fraction
    end: Fraction
    normal: Vector


Separators = Mapping[tuple[str, int | None], tuple[Piece, ...]]
"""(constraint, target point or None): the planes that prove it, in the order of w"""


@dataclass(frozen=True)
class Problem:
    """What the path has to satisfy, derived from the problem alone."""

    camera: Camera
    points: tuple[Vector, ...]
    goal_translation: Vector
    goal_quaternion: Vector
    obstacles: tuple[Obstacle, ...]
    least_distance: Fraction
    visibility_margin: Fraction
    occlusion: bool
    workspace: tuple[Vector, Vector] | None
    workspace_half_spaces: tuple[HalfSpace, ...]
    degrees: tuple[int, int]


@dataclass(frozen=True)
class Stated:
    """One line of the plan's own certificate."""

    name: str
    margin: Fraction
    unit: str


@dataclass(frozen=True)
class PlanFile:
    """The plan: its problem, its path and what it claims."""

    problem: Problem
    status: str
    rotation: tuple[Vector, ...] | None
    translation: tuple[Vector, ...] | None
    stated: tuple[Stated, ...] | None
    polygon: tuple[Vector, ...] | None
    separators: Separators


def read_plan(plan: Any) -> PlanFile:
    """Read a mapping, a file's path, or an object with ``to_dict()``.

    Raises:
        PlanFileError: not a plan at all.
        Malformed: a plan, but a field is missing or wrong; a certified plan never looks like that.
        NotJudged: it asks for something that this verifier does not know.
    """
    document = plan.to_dict() if hasattr(plan, "to_dict") else plan
    if isinstance(document, str | Path):
        document = _document(Path(document))
    if not isinstance(document, Mapping) or not str(document.get("format")).startswith("omniservo.plan/"):
        raise PlanFileError('not a plan: "format" must be "omniservo.plan/1"')
    return _plan(Fields(document, "plan"))


def _document(path: Path) -> Any:
    try:
        if path.stat().st_size > MOST_BYTES:
            raise PlanFileError(f"{path}: {path.stat().st_size} bytes; at most {MOST_BYTES} are read")
        return json.loads(path.read_text(encoding="utf-8-sig"), object_pairs_hook=_once)
    except OSError as error:
        raise PlanFileError(f"{path}: {error.strerror or error}") from None
    except RecursionError:
        raise PlanFileError(f"{path}: nested too deeply") from None
    except PlanFileError:
        raise
    except ValueError as error:
        raise PlanFileError(f"{path}: not JSON: {error}") from None


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Refuse a field that stands twice: two readers might take different ones."""
    fields = dict(pairs)
    if len(fields) != len(pairs):
        raise ValueError("a field stands twice in one object")
    return fields


def _plan(plan: Fields) -> PlanFile:
    plan.exactly("format", "omniservo.plan/1")
    status = plan.one_of("status", STATUSES)
    rotation = translation = None
    if not (status == "infeasible" and plan.get("path") is None):
        path = plan.table("path")
        rotation, translation = _rows(path, "rotation", 4), _rows(path, "translation", 3)
    stated = polygon = None
    separators: Separators = {}
    if status == "certified" or plan.get("certificate") is not None:
        certificate = plan.table("certificate")
        stated = tuple(_stated(line) for line in certificate.tables("constraints"))
        if certificate.get("polygon") is not None:
            polygon = certificate.vectors("polygon", 2, MOST_VERTICES)
        separators = _separators(certificate)
    return PlanFile(_problem(plan), status, rotation, translation, stated, polygon, separators)


def _separators(certificate: Fields) -> Separators:
    found: dict[tuple[str, int | None], tuple[Piece, ...]] = {}
    total = 0
    for fields in certificate.tables("separators", default=()):
        fields.only("constraint point pieces")
        name, point = fields.get("constraint"), fields.get("point")
        if not isinstance(name, str) or isinstance(point, bool) or not isinstance(point, int | None):
            raise Malformed(f"{fields.where}: constraint must be text, point a whole number")
        if (name, point) in found:
            raise Malformed(f"{fields.where}: {name!r:.80}, point {point}, stands twice")
        rows = fields.vectors("pieces", 5, MOST_PIECES)
        total += len(rows)
        if total > MOST_PIECES:
            raise NotJudged(f"certificate.separators: more than {MOST_PIECES} planes")
        if not all(0 <= a < b <= 1 for a, b, *_ in rows):
            raise Malformed(f"{fields.where}.pieces: legal: 0 <= from < to <= 1")
        found[name, point] = tuple(Piece(a, b, tuple(n)) for a, b, *n in rows)
    return found


def _rows(path: Fields, name: str, count: int) -> tuple[Vector, ...]:
    rows = path.items(name, count)
    if len(rows) != count or not isinstance(rows[0], list | tuple):
        raise Malformed(f"{path.where}.{name}: {count} rows of coefficients are needed")
    columns = len(rows[0])
    if not 1 <= columns <= HIGHEST_DEGREE + 1:
        raise Malformed(f"{path.where}.{name}: degree {columns - 1}; 0 to {HIGHEST_DEGREE} are judged")
    return tuple(numbers(row, columns, f"{path.where}.{name}[{i}]") for i, row in enumerate(rows))


def _stated(line: Fields) -> Stated:
    name, unit = line.get("name"), line.get("unit")
    if not isinstance(name, str) or not isinstance(unit, str):
        raise Malformed(f"{line.where}: name and unit must be text")
    if line.get("w") is not None and not 0 <= line.number("w") <= 1:
        raise Malformed(f"{line.where}.w: {line.get('w')} given; legal: 0 to 1")
    return Stated(name, line.number("margin"), unit)


def _problem(plan: Fields) -> Problem:
    problem = plan.table("problem", _PROBLEM)
    problem.exactly("format", "omniservo.problem/1")
    goal = problem.table("goal", "translation quaternion")
    clearance = problem.number("clearance", default=0, least=0)
    obstacles = problem.tables("obstacles", MOST_OBSTACLES, default=())
    points = problem.vectors("points", 3, MOST_POINTS)
    if not points:
        raise Malformed("problem.points: empty; at least one target point is needed")
    return Problem(
        camera=_camera(problem),
        points=points,
        goal_translation=goal.vector("translation", 3),
        goal_quaternion=near_unit(goal.vector("quaternion", 4), f"{goal.where}.quaternion"),
        obstacles=tuple(_obstacle(fields, clearance) for fields in obstacles),
        least_distance=problem.number("least_distance", default=1e-3, least=0),
        visibility_margin=problem.number("visibility_margin", default=0, least=0),
        occlusion=problem.flag("occlusion", default=False),
        workspace=_workspace(problem),
        workspace_half_spaces=_workspace_half_spaces(problem),
        degrees=_degrees(problem),
    )


def _camera(problem: Fields) -> Camera:
    known = "model fx fy cx cy skew xi distortion width height max_angle dead_zone"
    camera = problem.table("camera", known)
    camera.exactly("model", "unified")
    fx, fy = camera.number("fx"), camera.number("fy")
    if min(abs(fx), abs(fy)) < _LEAST_FOCAL:
        raise Malformed(
            f"problem.camera: fx {float(fx):g}, fy {float(fy):g} given; legal: at least 1e-6 in size"
        )
    angle = camera.number("max_angle", above=0) if camera.get("max_angle") is not None else None
    if angle is not None and angle > Fraction(math.pi):
        raise Malformed(f"problem.camera.max_angle: {float(angle)} given; legal: up to pi")
    return Camera(
        fx=fx,
        fy=fy,
        cx=camera.number("cx"),
        cy=camera.number("cy"),
        skew=camera.number("skew", default=0),
        xi=camera.number("xi", least=0),
        distortion=numbers(camera.get("distortion", (0, 0, 0, 0)), 4, "problem.camera.distortion"),
        width=camera.number("width", above=0),
        height=camera.number("height", above=0),
        max_angle=angle,
        dead_zone=_dead_zone(camera),
    )


def _dead_zone(camera: Fields) -> tuple[Fraction, Fraction, Fraction] | None:
    if camera.get("dead_zone") is None:
        return None
    zone = camera.table("dead_zone", "center radius")
    u, v = zone.vector("center", 2)
    return u, v, zone.number("radius", above=0)


def _obstacle(fields: Fields, clearance: Fraction) -> Obstacle:
    kind = fields.get("type")
    if kind not in ("sphere", "box", "capsule", "half_space"):
        raise NotJudged(f"{fields.where}: this verifier does not judge obstacles of type {kind!r}")
    if fields.get("clearance") is not None:
        clearance = fields.number("clearance", least=0)
    if kind == "sphere":
        fields.only("type center radius clearance")
        return Sphere(fields.vector("center", 3), fields.number("radius", least=0), clearance)
    if kind == "box":
        fields.only("type center quaternion half_extents clearance")
        extents = fields.vector("half_extents", 3)
        if min(extents) <= 0:
            raise Malformed(f"{fields.where}.half_extents: {fields.get('half_extents')} given; legal: > 0")
        axes = axes_of(near_unit(fields.vector("quaternion", 4), f"{fields.where}.quaternion"))
        return Box(fields.vector("center", 3), axes, extents, clearance)
    if kind == "capsule":
        fields.only("type from to radius clearance")
        return Capsule(
            fields.vector("from", 3), fields.vector("to", 3), fields.number("radius", above=0), clearance
        )
    fields.only("type normal offset clearance")
    return _half_space(fields, clearance)


def _half_space(fields: Fields, clearance: Fraction) -> HalfSpace:
    normal = near_unit(fields.vector("normal", 3), f"{fields.where}.normal")
    return HalfSpace(normal, fields.number("offset"), clearance)


def _workspace(problem: Fields) -> tuple[Vector, Vector] | None:
    if problem.get("workspace") is None:
        return None
    box = problem.table("workspace", "min max half_spaces")
    if box.get("min") is None and box.get("max") is None:
        return None
    return box.vector("min", 3), box.vector("max", 3)


def _workspace_half_spaces(problem: Fields) -> tuple[HalfSpace, ...]:
    if problem.get("workspace") is None:
        return ()
    sides = problem.table("workspace").tables("half_spaces", MOST_HALF_SPACES, default=())
    for fields in sides:
        fields.only("normal offset")
    return tuple(_half_space(fields, Fraction(0)) for fields in sides)


def _degrees(problem: Fields) -> tuple[int, int]:
    if problem.get("degrees") is None:
        return 2, 2
    degrees = problem.table("degrees", "rotation translation")
    return int(degrees.number("rotation", least=1)), int(degrees.number("translation", least=1))


def near_unit(vector: Vector, where: str) -> Vector:
    """Return the vector, whose length must be 1 within 1e-6; only its direction is used from here on."""
    squared = sum(x * x for x in vector)
    if not (1 - _NEAR_UNIT) ** 2 <= squared <= (1 + _NEAR_UNIT) ** 2:
        raise Malformed(f"{where}: length {math.sqrt(squared):.9g}; legal: 1 within 1e-6")
    return vector
