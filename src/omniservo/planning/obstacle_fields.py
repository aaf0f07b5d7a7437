"""Obstacles as fields of a problem file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from omniservo.errors import InputError
from omniservo.planning.box import Box
from omniservo.planning.capsule import Capsule
from omniservo.planning.cloud import Cloud
from omniservo.planning.half_space import HalfSpace
from omniservo.planning.planning_problem import Obstacle
from omniservo.planning.sphere import Sphere

_FIELDS = {
    "sphere": (Sphere, {"center": "center", "radius": "radius"}),
    "box": (Box, {"center": "center", "quaternion": "quaternion", "half_extents": "half_extents"}),
    "capsule": (Capsule, {"from": "start", "to": "end", "radius": "radius"}),
    "half_space": (HalfSpace, {"normal": "normal", "offset": "offset"}),
    "cloud": (Cloud, {"points": "points", "radius": "radius"}),
}
"""type: class, and the attribute of each field; every type may have its own clearance as well"""


def obstacle_fields(obstacle: Obstacle) -> dict[str, Any]:
    """Return the fields of an obstacle."""
    kind, names = next((k, names) for k, (c, names) in _FIELDS.items() if isinstance(obstacle, c))
    fields: dict[str, Any] = {"type": kind}
    for field, attribute in names.items():
        value = getattr(obstacle, attribute)
        fields[field] = value.tolist() if hasattr(value, "tolist") else value
    return fields if obstacle.clearance is None else {**fields, "clearance": obstacle.clearance}


def obstacle_from_fields(value: Any) -> Obstacle:
    """Return the obstacle of a file's fields.

    Raises:
        InputError: a field is missing, unknown or not legal.
    """
    kind = value.get("type") if isinstance(value, Mapping) else None
    if isinstance(value, Mapping) and not (isinstance(kind, str) and kind in _FIELDS):
        legal = ", ".join(map(repr, _FIELDS))
        raise InputError(f"type: {kind!r:.40} given; legal: {legal} (a sphere of radius 0 is a point)")
    make, names = _FIELDS[kind or "sphere"]
    fields = only_fields(value, ("type", *names), ("clearance",))
    given = {attribute: fields[field] for field, attribute in names.items()}
    obstacle: Obstacle = make(**given, clearance=fields.get("clearance"))
    return obstacle


def only_fields(fields: Any, required: Sequence[str], optional: Sequence[str]) -> Mapping[str, Any]:
    """Return ``fields`` if it is a mapping with all of the required names and no unknown one."""
    if not isinstance(fields, Mapping):
        raise InputError(f"{fields!r:.60} given; a mapping of fields is needed")
    missing = [name for name in required if name not in fields]
    if missing:
        raise InputError(f"{missing[0]}: missing; needed: {', '.join(required)}")
    unknown = [str(name) for name in fields if name not in (*required, *optional)]
    if unknown:
        legal = ", ".join((*required, *optional))
        raise InputError(f"{unknown[0]:.40}: no such field; legal: {legal}")
    return fields
