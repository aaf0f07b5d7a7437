"""What a plan's problem says otherwise than the problem that was meant, field by field."""

from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from math import hypot
from typing import Any, NamedTuple

from omniservo.verification.fields import BEYOND_FLOATS, Fields, shown
from omniservo.verification.mesh import Mesh
from omniservo.verification.obstacles import obstacle

_PROBLEM = {
    "clearance": 0,
    "least_distance": 1e-3,
    "visibility_margin": 0,
    "occlusion": False,
    "initial_velocity": None,
}
_CAMERA = {
    "skew": 0,
    "distortion": [0, 0, 0, 0],
    "max_angle": None,
    "dead_zone": None,
    "mask": [],
    "deviation_px": 0,
    "model_error": None,
    "calibration_covariance": None,
}
_WORKSPACE: dict[str, Any] = {"min": None, "max": None, "half_spaces": []}
_DEGREES = {"rotation": 2, "translation": 2}
_DIRECTIONS = ("quaternion", "normal")
_SAME_DIRECTION = 1e-12
_SAME_HULL = Fraction(1, 10**12)
"""of the largest coordinate"""


class Difference(NamedTuple):
    """A field with two values; None: it is not there, and has no default."""

    field: str
    plan: Any
    problem: Any

    def __str__(self) -> str:
        """Name the field and both values."""
        said = ["none" if value is None else shown(value) for value in (self.plan, self.problem)]
        return f"problem.{self.field}: {said[0]} in the plan, {said[1]} was meant"


def problem_differences(plan: Mapping[str, Any], meant: Mapping[str, Any]) -> tuple[Difference, ...]:
    """Return every field in which two legal problems differ.

    Numbers are compared exactly, quaternions and normals as the rotations and directions that they mean,
    within 1e-12. A field that is left out has its default, and an obstacle without a clearance the problem's.
    Of a mesh the plan may leave out vertices that lie inside the hull of the others.
    """
    problems = _written_out(plan), _written_out(meant)
    if any(problem["obstacles"] for problem in problems):
        for problem in problems:
            del problem["clearance"]  # it stands in every obstacle
    return tuple(_differences("", *problems))


def _written_out(problem: Mapping[str, Any]) -> dict[str, Any]:
    """Return the problem with its defaults, and a clearance in every obstacle."""
    fields = _filled(problem, _PROBLEM)
    fields["camera"] = _filled(problem["camera"], _CAMERA)
    fields["workspace"] = _filled(problem.get("workspace") or {}, _WORKSPACE)
    fields["degrees"] = _filled(problem.get("degrees") or {}, _DEGREES)
    general = {"clearance": fields["clearance"], "motion": None}
    fields["obstacles"] = [_filled(o, general) for o in fields.get("obstacles", ())]
    return fields


def _filled(fields: Mapping[str, Any], defaults: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields in their order, and the defaults of those that are not there."""
    given = {name: value for name, value in fields.items() if value is not None}
    return given | {name: value for name, value in defaults.items() if name not in given}


def _differences(where: str, plan: Any, meant: Any) -> Iterator[Difference]:
    """Yield what differs at and below a place."""
    if isinstance(plan, Mapping) and isinstance(meant, Mapping) and plan.get("type") == meant.get("type"):
        for name in dict.fromkeys((*plan, *meant)):
            place = f"{where}.{name}" if where else str(name)
            if not _mean_the_same(place, plan.get(name), meant.get(name)):
                yield from _differences(place, plan.get(name), meant.get(name))
    elif _holds_parts(plan) and _holds_parts(meant):
        for i in range(max(len(plan), len(meant))):
            parts = (parts[i] if i < len(parts) else None for parts in (plan, meant))
            yield from _differences(f"{where}[{i}]", *parts)
    elif _plain(plan) != _plain(meant):
        yield Difference(where, plan, meant)


def _holds_parts(value: Any) -> bool:
    """True for a list of points, obstacles or polygons; a vector is one value."""
    return isinstance(value, list | tuple) and not any(isinstance(x, int | float) for x in value)


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def _mean_the_same(place: str, plan: Any, meant: Any) -> bool:
    """True where two values of a field are other numbers for the same direction or mesh."""
    name = place.rpartition(".")[2]
    if name == "vertices" and place.startswith("obstacles["):
        return _same_hull(plan, meant)
    return name in _DIRECTIONS and _same_direction(name, plan, meant)


def _same_hull(plan: Sequence[Any], meant: Sequence[Any]) -> bool:
    """True where all vertices of the plan are meant, and its hull holds those that it lacks within 1e-12."""
    has, wanted = ({tuple(vertex) for vertex in vertices} for vertices in (plan, meant))
    if not has <= wanted:
        return False
    hull = obstacle(Fields({"type": "mesh", "vertices": plan}, "problem"), Fraction(0))
    reach = _SAME_HULL * max(abs(Fraction(x)) for vertex in wanted for x in vertex)
    lacking = (tuple(map(Fraction, vertex)) for vertex in wanted - has)
    return isinstance(hull, Mesh) and all(hull.nearer(vertex, reach) for vertex in lacking)


def _same_direction(name: str, plan: Any, meant: Any) -> bool:
    """True where two near unit vectors have one direction; q and −q are one rotation."""
    if plan is None or meant is None:
        return False
    try:
        first, second = ([x / hypot(*v) for x in v] for v in (plan, meant))
    except (TypeError, *BEYOND_FLOATS):  # in a field that no proof reads anything may stand
        return False
    signs = (1, -1) if name == "quaternion" else (1,)
    return any(
        all(abs(a - sign * b) <= _SAME_DIRECTION for a, b in zip(first, second, strict=True))
        for sign in signs
    )
