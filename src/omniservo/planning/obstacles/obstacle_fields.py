"""Obstacles as fields of a problem file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from omniservo.errors import InputError, did_you_mean, spelled, spelled_name
from omniservo.files import file_inside
from omniservo.planning.obstacles.cloud import Cloud
from omniservo.planning.obstacles.cloud_file import read_cloud
from omniservo.planning.obstacles.file_unit import UNIT_FIELDS, file_unit
from omniservo.planning.obstacles.mesh_fields import meshes_of_file
from omniservo.planning.obstacles.obstacle import KINDS, Obstacle
from omniservo.planning.stated_quaternion import ROTATION_FIELDS, stated_quaternion


def obstacle_fields(obstacle: Obstacle) -> dict[str, Any]:
    """Return the fields of an obstacle."""
    fields: dict[str, Any] = {"type": next(k for k, c in KINDS.items() if type(obstacle) is c)}
    for field, attribute in obstacle.FIELDS.items():
        value = getattr(obstacle, attribute)
        fields[field] = value.tolist() if hasattr(value, "tolist") else value
    if obstacle.clearance is not None:
        fields["clearance"] = obstacle.clearance
    if obstacle.motion is not None:
        fields["motion"] = obstacle.motion.tolist()
    return fields


def obstacles_from_fields(value: Any, folder: Path | None = None) -> tuple[Obstacle, ...]:
    """Return the obstacle of a file's fields, or the meshes of a file that it names inside ``folder``.

    Raises:
        InputError: a field is missing, unknown or not legal.
    """
    if isinstance(value, Mapping) and value.get("type") == "mesh" and "file" in value:
        if "vertices" in value:
            raise InputError("file: given beside vertices; legal: one of the two")
        places = ("translation", *ROTATION_FIELDS, *UNIT_FIELDS)
        return meshes_of_file(only_fields(value, ("type", "file"), (*places, "clearance", "motion")), folder)
    return (obstacle_from_fields(value, folder),)


def obstacle_from_fields(value: Any, folder: Path | None = None) -> Obstacle:
    """Return the obstacle of a file's fields; ``folder`` is where a file that it names is looked up.

    Raises:
        InputError: a field is missing, unknown or not legal.
    """
    kind = value.get("type") if isinstance(value, Mapping) else None
    if isinstance(value, Mapping) and not (isinstance(kind, str) and kind in KINDS):
        legal = ", ".join(map(repr, KINDS))
        raise InputError(
            f"type: {spelled(kind)} given; legal: {legal} (a sphere of radius 0 is a point)"
            + did_you_mean(kind, KINDS)
        )
    if kind == "cloud" and "file" in value:
        return _cloud_of_file(value, folder)
    make = KINDS[kind or "sphere"]
    names = make.FIELDS
    turned = ROTATION_FIELDS if "quaternion" in names else ()
    needed = [name for name in names if name not in turned]
    fields = only_fields(value, ("type", *needed), (*turned, "clearance", "motion"))
    given = {attribute: fields[field] for field, attribute in names.items() if field in needed}
    if turned:
        given["quaternion"] = stated_quaternion(fields)
    obstacle: Obstacle = make(**given, clearance=fields.get("clearance"), motion=fields.get("motion"))
    return obstacle


def _cloud_of_file(value: Mapping[str, Any], folder: Path | None) -> Cloud:
    """Return the cloud of the points of a file."""
    if "points" in value:
        raise InputError("file: given beside points; legal: one of the two")
    fields = only_fields(value, ("type", "file", "radius"), (*UNIT_FIELDS, "clearance", "motion"))
    name, unit = fields["file"], file_unit(fields)
    if not isinstance(name, str):
        raise InputError(f"file: {spelled(name)} given; a path is needed")
    path = file_inside("file", name, folder)
    try:
        points = read_cloud(path)
    except InputError as error:
        raise InputError(f"file: {error}") from None
    own = {key: fields.get(key) for key in ("clearance", "motion")}
    return Cloud(points if unit is None else unit * points, fields["radius"], **own, file=name)


def only_fields(fields: Any, required: Sequence[str], optional: Sequence[str]) -> Mapping[str, Any]:
    """Return ``fields`` if it is a mapping with all of the required names and no unknown one."""
    if not isinstance(fields, Mapping):
        raise InputError(f"{spelled(fields)} given; a mapping of fields is needed")
    missing = [name for name in required if name not in fields]
    if missing:
        raise InputError(f"{missing[0]}: missing; needed: {', '.join(required)}")
    unknown = [str(name) for name in fields if name not in (*required, *optional)]
    if unknown:
        legal = (*required, *optional)
        meant = did_you_mean(unknown[0], legal)
        raise InputError(f"{spelled_name(unknown[0])}: no such field; legal: {', '.join(legal)}{meant}")
    return fields
