"""JSON schemas of planning problems, files of obstacles, and plans."""

from __future__ import annotations

from typing import get_args

from omniservo.files import UNITS
from omniservo.planning.obstacles.file_unit import UNIT_FIELDS
from omniservo.planning.obstacles.mesh import MOST_GIVEN
from omniservo.planning.obstacles.obstacle import KINDS
from omniservo.planning.plan import FORMAT as PLAN
from omniservo.planning.plan import Status
from omniservo.planning.problem_file import FORMAT as PROBLEM
from omniservo.planning.problem_file import MOST_POINTS, OPTIONAL
from omniservo.planning.stated_quaternion import ROTATION_FIELDS
from omniservo.planning.workspace import MOST_HALF_SPACES
from omniservo.risk.problem_around import FORMAT as OBSTACLES
from omniservo.schemas.camera_schema import camera_schema
from omniservo.schemas.shapes import (
    COUNT,
    FLAG,
    NOT_NEGATIVE,
    NUMBER,
    POINT,
    POSITIVE,
    TEXT,
    TURNED,
    Schema,
    choice,
    either,
    mapping,
    matrix,
    nullable,
    of_format,
    said,
    several,
    turned_once,
    vector,
)

_PLACE = said(POINT, "[m], initial camera frame")
_COORDINATES: dict[str, Schema] = {
    "center": _PLACE,
    "from": _PLACE,
    "to": _PLACE,
    "radius": said(NOT_NEGATIVE, "[m]"),
    "half_extents": said(vector(3, POSITIVE), "[m]"),
    "radii": said(vector(3, POSITIVE), "[m]"),
    "normal": said(POINT, "of length 1; free where normal·x ≥ offset"),
    "offset": said(NUMBER, "[m]"),
    "vertices": said(several(POINT, 4, MOST_GIVEN), "[m], their convex hull counts"),
    "points": said(several(POINT, 1), "[m]"),
}
_OWN: dict[str, Schema] = {
    "clearance": said(nullable(NOT_NEGATIVE), "of the camera's centre, in place of the problem's [m]"),
    "motion": said(nullable(vector(3, several(NUMBER, 1, 17))), "displacement at w, highest power first [m]"),
}
FILE: dict[str, Schema] = {
    "file": said(TEXT, "path inside the document's folder"),
    "units": said(nullable(choice(*UNITS["length"])), "of the file"),
    "scale": said(nullable(POSITIVE), "of one unit of the file [m]"),
}
_TRANSLATION = {"translation": said(POINT, "[m]")}


def problem_schema() -> Schema:
    """Return the schema of a problem file, and of the problem inside a plan."""
    turned = {name: said(TURNED[name], "of the goal camera") for name in ROTATION_FIELDS}
    goal = mapping({"translation": said(POINT, "of the goal camera's centre [m]")}, turned)
    required = {
        "camera": either(said(TEXT, "a calibration file inside the folder"), camera_schema()),
        "points": said(several(POINT, 1, MOST_POINTS), "the target's points [m]"),
        "goal": {**goal, "oneOf": [{"required": [name]} for name in ROTATION_FIELDS]},
    }
    return of_format(PROBLEM, required, _optional_fields())


def obstacles_schema() -> Schema:
    """Return the schema of what stands beside an estimate in the place of a problem."""
    return of_format(OBSTACLES, {}, _optional_fields())


def plan_schema() -> Schema:
    """Return the schema of a plan."""
    path = mapping(
        {
            "rotation": said(vector(4, several(NUMBER, 1)), "quaternion, highest power of w first"),
            "translation": said(vector(3, several(NUMBER, 1)), "[m], highest power of w first"),
        }
    )
    return of_format(
        PLAN,
        {"problem": problem_schema(), "status": choice(*get_args(Status))},
        {
            "path": nullable(path),
            "certificate": nullable(_certificate()),
            "seconds": said(NOT_NEGATIVE, "that planning took [s]"),
            "method": TEXT,
            "reason": said(TEXT, "why the answer is no, else empty"),
            "notices": said(several(TEXT), "on the problem, in what the command prints"),
            "risk": said({"type": "object"}, "what samples of the estimate say, in what the command prints"),
        },
    )


def _optional_fields() -> dict[str, Schema]:
    degree = {"type": "integer", "minimum": 1, "maximum": 16}
    side = mapping({"normal": _COORDINATES["normal"], "offset": _COORDINATES["offset"]})
    room = mapping({}, {"min": POINT, "max": POINT, "half_spaces": several(side, 0, MOST_HALF_SPACES)})
    room["dependentRequired"] = {"min": ["max"], "max": ["min"]}
    fields: dict[str, Schema] = {
        "obstacles": several({"oneOf": _obstacles()}, 0, MOST_POINTS),
        "clearance": said(NOT_NEGATIVE, "camera's centre to every obstacle's surface [m]"),
        "least_distance": said(NOT_NEGATIVE, "camera's centre to every target point [m]"),
        "visibility_margin": said(NOT_NEGATIVE, "target points to every limit of the image [px]"),
        "occlusion": said(FLAG, "true: no obstacle between camera and target points"),
        "workspace": said(nullable(room), "where the camera's centre stays [m]"),
        "degrees": said(nullable(mapping({}, {"rotation": degree, "translation": degree})), "of the path"),
        "initial_velocity": said(nullable(vector(6)), "linear, angular, per unit of w"),
    }
    return {name: fields[name] for name in OPTIONAL}


def _obstacles() -> list[Schema]:
    return [
        *(_obstacle(kind) for kind in KINDS),
        turned_once(mapping({"type": {"const": "mesh"}, "file": FILE["file"]}, _beside_a_file("mesh"))),
        mapping(
            {"type": {"const": "cloud"}, "file": FILE["file"], "radius": _COORDINATES["radius"]},
            _beside_a_file("cloud"),
        ),
    ]


def _beside_a_file(kind: str) -> dict[str, Schema]:
    units = {name: FILE[name] for name in UNIT_FIELDS}
    return {**({**_TRANSLATION, **TURNED} if kind == "mesh" else {}), **units, **_OWN}


def _obstacle(kind: str) -> Schema:
    turned = set(ROTATION_FIELDS) & set(KINDS[kind].FIELDS)
    required = {name: _COORDINATES[name] for name in KINDS[kind].FIELDS if name not in turned}
    schema = mapping({"type": {"const": kind}, **required}, {**(TURNED if turned else {}), **_OWN})
    return turned_once(schema) if turned else schema


def _certificate() -> Schema:
    margin = mapping(
        {
            "name": said(TEXT, "family, then what it is about"),
            "margin": said(NUMBER, "what is left beyond what is required, in unit"),
            "unit": TEXT,
            "w": said({"type": "number", "minimum": 0, "maximum": 1}, "where the least was found"),
        }
    )
    separator = mapping({"constraint": TEXT, "pieces": several(vector(5), 1)}, {"point": nullable(COUNT)})
    return mapping(
        {"constraints": several(margin), "worst": margin},
        {"polygon": nullable(matrix(None, 2)), "separators": several(separator)},
    )
