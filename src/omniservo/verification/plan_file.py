"""A plan file as exact numbers. Whatever it lacks or adds is said, never assumed."""

import json
import math
import stat
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

from omniservo.verification.fields import (
    Fields,
    Malformed,
    NotJudged,
    PlanFileError,
    Vector,
    near_unit,
    numbers,
    shown,
)
from omniservo.verification.obstacles import HalfSpace, Obstacle, half_space, obstacle
from omniservo.verification.polynomials import integers
from omniservo.verification.work import bits, products, spend

MOST_BYTES = 16 << 20
MOST_POINTS = MOST_OBSTACLES = 100_000
MOST_VERTICES = MOST_HALF_SPACES = 1000
MOST_PIECES = 200_000
MOST_MASKS, FEWEST_CORNERS, MOST_CORNERS = 64, 3, 64
HIGHEST_DEGREE = 20
STATUSES = ("certified", "refuted", "undecided", "infeasible", "not_found")
_LEAST_FOCAL = Fraction(1, 10**6)
_PROBLEM = (
    "format camera points goal obstacles clearance least_distance "
    "visibility_margin occlusion workspace degrees initial_velocity"
)


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
    mask: tuple[tuple[Vector, ...], ...] = ()
    """convex polygons [px] in which the camera sees itself or nothing; corners in either order"""
    deviation: Fraction = Fraction(0)
    """how far a true pixel may lie from the model's [px]"""


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
    """what is required, and the camera's deviation [px]"""
    occlusion: bool
    workspace: tuple[Vector, Vector] | None
    workspace_half_spaces: tuple[HalfSpace, ...]
    degrees: tuple[int, int]
    initial_velocity: Vector | None
    """the twist at w = 0: linear [m], angular [rad] per unit of w"""


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
    worst: Stated | str | None
    """the line, or the name alone, that the plan calls its worst"""
    polygon: tuple[Vector, ...] | None
    separators: Separators


def plan_document(plan: Any) -> Mapping[str, Any]:
    """Return the fields of a mapping, of a file's path, or of an object with ``to_dict()``.

    Raises:
        PlanFileError: not a plan at all.
    """
    return _fields_of(plan, "plan")


def read_plan(document: Mapping[str, Any]) -> PlanFile:
    """Read the fields of a plan.

    Raises:
        Malformed: a field is missing or wrong; a certified plan never looks like that.
        NotJudged: it asks for something that this verifier does not know.
    """
    return _plan(Fields(document, "plan"))


def read_problem(problem: Any) -> Mapping[str, Any]:
    """Return the fields of a problem, in the same three ways, once they are found legal.

    Raises:
        PlanFileError: not a problem, not legal, or its camera is a path, which this verifier does not follow.
    """
    document = _fields_of(problem, "problem")
    if isinstance(document.get("camera"), str):
        raise PlanFileError("problem.camera: a path given; a problem with its camera in it is needed")
    try:
        _problem(Fields({"problem": document}, "plan"))
    except (Malformed, NotJudged) as fault:
        raise PlanFileError(str(fault)) from None
    return document


def _fields_of(value: Any, kind: str) -> Mapping[str, Any]:
    document = value.to_dict() if hasattr(value, "to_dict") else value
    if isinstance(document, str | Path):
        document = _document(Path(document))
    if not isinstance(document, Mapping) or not str(document.get("format")).startswith(f"omniservo.{kind}/"):
        where = f"{value}: " if isinstance(value, str | Path) else ""
        raise PlanFileError(f'{where}not a {kind}: "format" must be "omniservo.{kind}/1"')
    return document


def _document(path: Path) -> Any:
    try:
        if not stat.S_ISREG(path.stat().st_mode):
            raise PlanFileError(f"{path}: a directory, device or pipe; a file is needed")
        with path.open("rb") as file:
            text = file.read(MOST_BYTES + 1)
        if len(text) > MOST_BYTES:
            raise PlanFileError(f"{path}: at most {MOST_BYTES} bytes are read")
        return json.loads(text.decode("utf-8-sig"), object_pairs_hook=_once)
    except FileNotFoundError:
        raise PlanFileError(f"{path}: no such file") from None
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
    stated = polygon = worst = None
    separators: Separators = {}
    if status == "certified" or plan.get("certificate") is not None:
        certificate = plan.table("certificate")
        stated = tuple(_stated(line) for line in certificate.tables("constraints"))
        worst = certificate.get("worst")
        if worst is not None and not isinstance(worst, str):
            worst = _stated(certificate.table("worst"))
        if certificate.get("polygon") is not None:
            polygon = certificate.vectors("polygon", 2, MOST_VERTICES)
        separators = _separators(certificate)
    return PlanFile(_problem(plan), status, rotation, translation, stated, worst, polygon, separators)


def _separators(certificate: Fields) -> Separators:
    found: dict[tuple[str, int | None], tuple[Piece, ...]] = {}
    total = 0
    for fields in certificate.tables("separators", default=()):
        fields.only("constraint point pieces")
        name, point = fields.get("constraint"), fields.get("point")
        if not isinstance(name, str) or isinstance(point, bool) or not isinstance(point, int | None):
            raise Malformed(f"{fields.where}: constraint must be text, point a whole number")
        if (name, point) in found:
            raise Malformed(f"{fields.where}: {name!r:.80}, point {shown(point)}, stands twice")
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
    camera = _camera(problem)
    return Problem(
        camera=camera,
        points=points,
        goal_translation=goal.vector("translation", 3),
        goal_quaternion=near_unit(goal.vector("quaternion", 4), f"{goal.where}.quaternion"),
        obstacles=tuple(obstacle(fields, clearance) for fields in obstacles),
        least_distance=problem.number("least_distance", default=1e-3, least=0),
        visibility_margin=problem.number("visibility_margin", default=0, least=0) + camera.deviation,
        occlusion=problem.flag("occlusion", default=False),
        workspace=_workspace(problem),
        workspace_half_spaces=_workspace_half_spaces(problem),
        degrees=_degrees(problem),
        initial_velocity=_velocity(problem),
    )


def _camera(problem: Fields) -> Camera:
    known = "model fx fy cx cy skew xi distortion width height max_angle dead_zone mask"
    camera = problem.table("camera", f"{known} deviation_px model_error calibration_covariance")
    camera.exactly("model", "unified")
    fx, fy = camera.number("fx"), camera.number("fy")
    if min(abs(fx), abs(fy)) < _LEAST_FOCAL:
        raise Malformed(
            f"problem.camera: fx {float(fx):g}, fy {float(fy):g} given; legal: at least 1e-6 in size"
        )
    angle = camera.number("max_angle", above=0) if camera.get("max_angle") is not None else None
    if angle is not None and angle > Fraction(math.pi):
        raise Malformed(f"problem.camera.max_angle: {float(angle)} given; legal: up to pi")
    distortion = numbers(camera.get("distortion", (0, 0, 0, 0)), 4, "problem.camera.distortion")
    mask = _mask(camera)
    return Camera(
        fx=fx,
        fy=fy,
        cx=camera.number("cx"),
        cy=camera.number("cy"),
        skew=camera.number("skew", default=0),
        xi=camera.number("xi", least=0),
        distortion=distortion,
        width=camera.number("width", above=0),
        height=camera.number("height", above=0),
        max_angle=angle,
        dead_zone=_dead_zone(camera),
        mask=mask,
        deviation=camera.number("deviation_px", default=0, least=0),
    )


def _dead_zone(camera: Fields) -> tuple[Fraction, Fraction, Fraction] | None:
    if camera.get("dead_zone") is None:
        return None
    zone = camera.table("dead_zone", "center radius")
    u, v = zone.vector("center", 2)
    return u, v, zone.number("radius", above=0)


def _mask(camera: Fields) -> tuple[tuple[Vector, ...], ...]:
    if camera.get("mask") is None:
        return ()
    polygons = []
    for i, corners in enumerate(camera.items("mask", MOST_MASKS)):
        where = f"{camera.where}.mask[{i}]"
        if not isinstance(corners, list | tuple) or not FEWEST_CORNERS <= len(corners) <= MOST_CORNERS:
            raise Malformed(f"{where}: {FEWEST_CORNERS} to {MOST_CORNERS} corners are needed")
        polygon = tuple(numbers(corner, 2, f"{where}[{k}]") for k, corner in enumerate(corners))
        if not _strictly_convex(polygon):
            raise Malformed(f"{where}: not convex, or a corner that is none; legal: convex polygons")
        polygons.append(polygon)
    return tuple(polygons)


def _strictly_convex(polygon: tuple[Vector, ...]) -> bool:
    """True where every corner but a side's own two lies on the same side of it, and none on it."""
    n, flat = len(polygon), integers(*(x for corner in polygon for x in corner))
    corners = list(zip(flat[::2], flat[1::2], strict=True))
    spend(products(16 * n * n, bits(flat), bits(flat)))
    turns = set()
    for i, (x, y) in enumerate(corners):
        dx, dy = corners[(i + 1) % n][0] - x, corners[(i + 1) % n][1] - y
        others = (corners[(i + k) % n] for k in range(2, n))
        crosses = [dx * (v - y) - dy * (u - x) for u, v in others]
        turns |= {(cross > 0) - (cross < 0) for cross in crosses}
    return turns in ({1}, {-1})


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
    return tuple(half_space(fields, Fraction(0)) for fields in sides)


def _velocity(problem: Fields) -> Vector | None:
    return problem.vector("initial_velocity", 6) if problem.get("initial_velocity") is not None else None


def _degrees(problem: Fields) -> tuple[int, int]:
    if problem.get("degrees") is None:
        return 2, 2
    degrees = problem.table("degrees", "rotation translation")
    rotation, translation = (degrees.number(name, default=2, least=1) for name in ("rotation", "translation"))
    if rotation.denominator != 1 or translation.denominator != 1:
        raise Malformed(f"{degrees.where}: {shown(problem.get('degrees'))} given; legal: whole numbers")
    return int(rotation), int(translation)
