"""What is proven of a path: one margin a constraint."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from omniservo.errors import InputError, spelled
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray, finite_array, finite_number, frozen
from omniservo.planning.obstacles.obstacle_fields import only_fields

UNSEEN_PX = -1e6
"""What an image limit leaves to a point outside the model's domain [px]."""


@with_field_docs
@dataclass(frozen=True, eq=False)
class Separator:
    """Separating planes along the path: the proof of one constraint about a box or a capsule."""

    constraint: str
    """"clearance obstacle 2" or "occlusion obstacle 2\""""
    point: int | None
    """the target point whose lines of sight are meant; None for a clearance"""
    pieces: FloatArray
    """(k, 5): from w, to w, and the plane's normal there, which points from the body to the path"""


@with_field_docs
@dataclass(frozen=True)
class ConstraintMargin:
    """What is left of one constraint beyond what the problem asks for."""

    name: str
    """family, then what it is about: "visibility left edge (point 3)"; the point is where it is smallest"""
    margin: float
    """in ``unit``; of a certified plan a lower bound over all w in [0, 1] and all points; 0: just met"""
    unit: str
    """m, px, rad, or 1"""
    w: float
    """where the smallest value was found"""

    @property
    def is_unseen(self) -> bool:
        """Whether a point has no pixel at all there: the margin stands for no distance, but for none."""
        return self.margin <= UNSEEN_PX


@with_field_docs
@dataclass(frozen=True, eq=False)
class Certificate:
    """Every constraint of the problem with its margin along the path."""

    constraints: tuple[ConstraintMargin, ...]
    worst: ConstraintMargin
    """the one with the least left, lengths taken relative to the mean distance of the target, pixels to the
    focal length"""
    polygon: FloatArray | None = None
    """for a distorted camera: corners (k, 2) of the convex polygon on the plane m̄ that the visibility margin
    was proven with"""
    separators: tuple[Separator, ...] = ()
    """of every constraint about a box or a capsule that is proven"""

    def __repr__(self) -> str:
        worst = self.worst
        return (
            f"Certificate({len(self.constraints)} constraints, worst: {worst.name} "
            f"{worst.margin:+.3g} {worst.unit} at w = {worst.w:.3g})"
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the certificate of a plan file."""
        fields: dict[str, Any] = {
            "constraints": [_fields(c) for c in self.constraints],
            "worst": _fields(self.worst),
        }
        if self.polygon is not None:
            fields["polygon"] = self.polygon.tolist()
        if self.separators:
            fields["separators"] = [_separator_fields(s) for s in self.separators]
        return fields

    @classmethod
    def from_dict(cls, fields: Mapping[str, Any]) -> Certificate:
        """Return the certificate of a plan file.

        Raises:
            InputError: a field is missing, unknown or not legal.
        """
        fields = fields_of("certificate", fields, ("constraints", "worst"), ("polygon", "separators"))
        polygon = fields.get("polygon")
        return cls(
            tuple(_margin(c) for c in _listed("certificate.constraints", fields["constraints"])),
            _margin(fields["worst"]),
            None if polygon is None else frozen(finite_array("certificate.polygon", polygon, (None, 2))),
            tuple(_separator(s) for s in _listed("certificate.separators", fields.get("separators", []))),
        )


def fields_of(
    where: str, fields: Any, required: tuple[str, ...], optional: tuple[str, ...] = ()
) -> Mapping[str, Any]:
    """Return what stands at a place of a plan file, if it is a mapping with these fields.

    Raises:
        InputError: it is none, or a field is missing or unknown; the message begins with ``where``.
    """
    try:
        return only_fields(fields, required, optional)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None


def _listed(where: str, value: Any) -> list[Any]:
    if not isinstance(value, list):
        raise InputError(f"{where}: {spelled(value)} given; a list is needed")
    return value


def _fields(c: ConstraintMargin) -> dict[str, Any]:
    return {"name": c.name, "margin": c.margin, "unit": c.unit, "w": c.w}


def _margin(fields: Any) -> ConstraintMargin:
    fields = fields_of("certificate: a constraint", fields, ("name", "margin", "unit", "w"))
    margin = finite_number("certificate.margin", fields["margin"])
    w = finite_number("certificate.w", fields["w"], minimum=0.0, maximum=1.0)
    return ConstraintMargin(str(fields["name"]), margin, str(fields["unit"]), w)


def _separator_fields(s: Separator) -> dict[str, Any]:
    point = {} if s.point is None else {"point": s.point}
    return {"constraint": s.constraint, **point, "pieces": s.pieces.tolist()}


def _separator(fields: Any) -> Separator:
    fields = fields_of("certificate.separators", fields, ("constraint", "pieces"), ("point",))
    pieces = frozen(finite_array("certificate.separators.pieces", fields["pieces"], (None, 5)))
    point = fields.get("point")
    if not (point is None or (isinstance(point, int) and not isinstance(point, bool) and point >= 0)):
        raise InputError(f"certificate.separators.point: {spelled(point)} given; legal: 0, 1, ...")
    return Separator(str(fields["constraint"]), point, pieces)
