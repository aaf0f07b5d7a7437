"""A target of known geometry: named points and tags in one frame."""

from __future__ import annotations

import json
import math
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.errors import InputError, did_you_mean, spelled, spelled_name
from omniservo.field_docs import with_field_docs
from omniservo.files import read_document, stated_units, write_whole
from omniservo.geometry.arrays import BoolArray, FloatArray, IntArray, finite_array, finite_number, owned
from omniservo.geometry.pose_fields import pose_fields
from omniservo.short_repr import short_repr
from omniservo.tag_dictionaries import dictionary_name
from omniservo.targets.tag import Tag

FORMAT = "omniservo.target/1"

MOST_MEMBERS = 10_000
"""most points, and most tags, of a target"""

_LONGEST_NAME = 100
_NEAR_UNIT = 1e-6
_LARGEST_TURN = 1e6
"""in the file's unit: the square of any stays far from overflow"""


@with_field_docs
@dataclass(frozen=True, eq=False)
class Target:
    """Named points [m] and tags in the target frame.

    Image points join the target by whole numbers, as `ImagePoints.ids` holds them: a named point by its
    index, corner c of tag k by 4k + c (see `Tag` for the order of the corners).
    """

    names: tuple[str, ...] = ()
    """of the points, all different"""
    points: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    """(n, 3) [m]"""
    tags: tuple[Tag, ...] = ()
    """no two of one dictionary and number"""

    __repr__ = short_repr

    def __post_init__(self) -> None:
        points = finite_array("points", self.points, (None, 3)) if len(self.points) else np.empty((0, 3))
        object.__setattr__(self, "points", owned(points))
        object.__setattr__(self, "names", tuple(self.names))
        object.__setattr__(self, "tags", tuple(self.tags))
        if len(self.names) != len(points):
            raise InputError(f"points: {len(points)} given for {len(self.names)} names; one each is needed")
        for name in self.names:
            if not isinstance(name, str) or not 0 < len(name) <= _LONGEST_NAME:
                raise InputError(
                    f"points: name: {spelled(name)} given; text of 1 to {_LONGEST_NAME} characters is needed"
                )
        _no_twice("points: name", self.names)
        _no_twice("tags: dictionary and id", [(tag.dictionary, tag.id) for tag in self.tags])
        if not self.names and not self.tags:
            raise InputError("target: neither points nor tags given; at least one is needed")

    @property
    def dictionaries(self) -> tuple[str, ...]:
        """The dictionaries of the tags, each once, sorted."""
        return tuple(sorted({tag.dictionary for tag in self.tags}))

    def tag_corners(self, dictionary: str | None = None) -> tuple[IntArray, FloatArray]:
        """Return ids 4k + c (4m,) and corners (4m, 3) [m] of the m tags of a dictionary; None: the only one.

        Raises:
            InputError: the target has no tag of that dictionary, or several dictionaries and none is named.
        """
        known = self.dictionaries
        if dictionary is None and len(known) == 1:
            dictionary = known[0]
        with suppress(InputError):
            dictionary = dictionary_name(dictionary or "")
        if dictionary not in known:
            legal = ", ".join(known) or "none, the target has no tag"
            raise InputError(f"dictionary: {spelled(dictionary)} given; legal: {legal}")
        tags = [tag for tag in self.tags if tag.dictionary == dictionary]
        ids = np.array([4 * tag.id + corner for tag in tags for corner in range(4)], dtype=np.int64)
        return ids, np.concatenate([tag.corners for tag in tags])

    def points_of(self, ids: npt.ArrayLike) -> tuple[FloatArray, BoolArray]:
        """Return the named points (k, 3) [m] of ``ids`` (k,), and which of them the target has; else NaN.

        Raises:
            InputError: ids that are not whole numbers.
        """
        return _joined(np.arange(len(self.points)), self.points, ids)

    def corners_of(self, ids: npt.ArrayLike, dictionary: str | None = None) -> tuple[FloatArray, BoolArray]:
        """Return the corners (k, 3) [m] of ``ids`` 4·tag + corner (k,), and which the target has; else NaN.

        Raises:
            InputError: ids that are not whole numbers, or a dictionary as in `tag_corners`.
        """
        return _joined(*self.tag_corners(dictionary), ids)

    def to_dict(self) -> dict[str, Any]:
        """Return plain lists and numbers, in metres and radians; see :meth:`from_dict`."""
        return {
            "format": FORMAT,
            "points": [
                {"name": name, "position": [float(x) for x in point]}
                for name, point in zip(self.names, self.points, strict=True)
            ],
            "tags": [
                {
                    "dictionary": tag.dictionary,
                    "id": tag.id,
                    "edge": tag.edge,
                    **pose_fields(tag.target_T_tag),
                }
                for tag in self.tags
            ],
        }

    @classmethod
    def from_dict(cls, fields: Any, source: str = "target") -> Target:
        """Return the target that an "omniservo.target/1" document describes; see docs/targets.md.

        Raises:
            InputError: one message that names ``source``, the field, what was given and what is legal.
        """
        document = _mapping(fields, source, {"format"}, {"units", "points", "tags"})
        if document["format"] != FORMAT:
            raise InputError(f"{source}: format: {spelled(document['format'])} given; legal: {FORMAT!r}")
        units = stated_units(document.get("units", {}), source)
        points = [
            _point(value, f"{source}: points[{k}]", units["length"])
            for k, value in enumerate(_list(document, "points", source))
        ]
        tags = [
            _tag(value, f"{source}: tags[{k}]", units)
            for k, value in enumerate(_list(document, "tags", source))
        ]
        try:
            return cls(tuple(n for n, _ in points), np.array([p for _, p in points]), tuple(tags))
        except InputError as error:
            raise InputError(f"{source}: {error}") from None

    @classmethod
    def load(cls, path: str | Path) -> Target:
        """Read a target file, YAML or JSON.

        Raises:
            InputError: no such file, or not a target; see :meth:`from_dict`.
        """
        return cls.from_dict(read_document(path), str(path))

    def save(self, path: str | Path, *, force: bool = False) -> None:
        """Write :meth:`to_dict` as JSON, whole or not at all.

        Raises:
            InputError: the file exists and ``force`` is False, or its folder cannot be written.
        """
        write_whole(path, json.dumps(self.to_dict(), indent=2) + "\n", force=force)


def _joined(known: IntArray, places: FloatArray, ids: npt.ArrayLike) -> tuple[FloatArray, BoolArray]:
    """Return the rows of ``places`` whose number in ``known`` is required, NaN for the others."""
    asked = np.asarray(ids)
    if asked.ndim != 1 or (asked.size and asked.dtype.kind not in "iu"):
        raise InputError(f"ids: {asked.dtype} {asked.shape} given; whole numbers (k,) are needed")
    row = {int(number): place for place, number in enumerate(known)}
    rows = np.array([row.get(int(number), -1) for number in asked], dtype=np.int64)
    points = np.full((len(asked), 3), math.nan)
    points[rows >= 0] = places[rows[rows >= 0]]
    return points, rows >= 0


def _no_twice(what: str, values: Any) -> None:
    for value, count in Counter(values).items():
        if count > 1:
            raise InputError(f"{what}: {spelled(value)} given {count} times; once is legal")


def _mapping(value: Any, source: str, needed: set[str], optional: set[str]) -> dict[str, Any]:
    legal = ", ".join(sorted(needed | optional))
    if not isinstance(value, dict):
        raise InputError(f"{source}: {spelled(value)} given; a mapping with the fields {legal} is needed")
    for name in value:
        if name not in needed | optional:
            raise InputError(
                f"{source}: {spelled_name(name)}: no such field; legal: {legal}"
                f"{did_you_mean(name, needed | optional)}"
            )
    for name in sorted(needed):
        if name not in value:
            raise InputError(f"{source}: {name}: missing field; the fields are {legal}")
    return value


def _list(document: dict[str, Any], name: str, source: str) -> list[Any]:
    value = document.get(name, [])
    if not isinstance(value, list):
        raise InputError(f"{source}: {name}: {spelled(value)} given; a list is needed")
    if len(value) > MOST_MEMBERS:
        raise InputError(f"{source}: {name}: {len(value)} given; legal: at most {MOST_MEMBERS}")
    return value


def _point(value: Any, source: str, metres: float) -> tuple[str, FloatArray]:
    fields = _mapping(value, source, {"name", "position"}, set())
    return fields["name"], metres * finite_array(f"{source}: position", fields["position"], (3,))


def _tag(value: Any, source: str, units: dict[str, float]) -> Tag:
    pose = {"translation", "quaternion", "rotation_vector"}
    fields = _mapping(value, source, {"dictionary", "id", "edge"}, pose)
    if "quaternion" in fields and "rotation_vector" in fields:
        raise InputError(f"{source}: quaternion and rotation_vector given; one of them is legal")
    translation = finite_array(f"{source}: translation", fields.get("translation", (0, 0, 0)), (3,))
    if "quaternion" in fields:
        quaternion = finite_array(f"{source}: quaternion", fields["quaternion"], (4,))
        norm = math.hypot(*quaternion)
        if abs(norm - 1.0) > _NEAR_UNIT:
            raise InputError(f"{source}: quaternion: norm {norm:g} given; 1 within {_NEAR_UNIT:g} is needed")
        rotation = Rotation.from_quat(quaternion)
    else:
        vector = finite_array(f"{source}: rotation_vector", fields.get("rotation_vector", (0, 0, 0)), (3,))
        if np.abs(vector).max() > _LARGEST_TURN:
            raise InputError(f"{source}: rotation_vector: {vector.tolist()} given; legal: -1e6 to 1e6")
        rotation = Rotation.from_rotvec(units["angle"] * vector)
    metres = units["length"]
    edge = metres * finite_number(f"{source}: edge", fields["edge"], above=0.0)
    try:
        return Tag(
            fields["dictionary"],
            fields["id"],
            edge,
            RigidTransform.from_components(metres * translation, rotation),
        )
    except InputError as error:
        raise InputError(f"{source}: {error}") from None
