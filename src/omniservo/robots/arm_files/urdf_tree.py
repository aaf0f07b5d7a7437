"""The tree that a URDF's joints make of its links."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from omniservo.errors import InputError, spelled
from omniservo.files.xml_files import XmlElement
from omniservo.robots.arm_files.arm_row import MovingJoint
from omniservo.robots.arm_files.xml_fields import XmlFields

_TURNING = ("revolute", "continuous")
_LEGAL = ("fixed", *_TURNING, "prismatic")


class UrdfTree(NamedTuple):
    """What hangs on what."""

    moving: tuple[XmlElement, ...]
    """joints that are not fixed, each behind the one that carries it"""
    joints: tuple[MovingJoint, ...]
    """the same, described"""
    carriers: dict[str, int | None]
    """by link: the number of the last of them before it; None: it is fixed to the base"""


def read_tree(links: Sequence[XmlElement], joints: Sequence[XmlElement], fields: XmlFields) -> UrdfTree:
    """Return the tree.

    Raises:
        InputError: a name twice, a link that does not exist, several roots, a loop, or a joint of no kind.
    """
    names = _unique(links, fields)
    _unique(joints, fields)
    joint_of: dict[str, XmlElement] = {}
    parent_of: dict[str, str] = {}
    for joint in joints:
        if joint.get("type", "") not in _LEGAL:
            legal = ", ".join(_LEGAL)
            raise InputError(
                f"{fields.place(joint)}: type {spelled(joint.get('type', ''))} given; legal: {legal}"
            )
        parent, child = (_end(joint, end, names, fields) for end in ("parent", "child"))
        if child in joint_of:
            other = spelled(joint_of[child].get("name"))
            raise InputError(f"{fields.place(joint)}: link {spelled(child)} hangs on joint {other} already")
        joint_of[child], parent_of[child] = joint, parent
    roots = [name for name in names if name not in joint_of]
    if len(roots) != 1:
        found = ", ".join(spelled(name) for name in roots[:6]) or "none: the joints make a loop"
        raise InputError(f"{fields.place(links[0])}: links on no joint: {found}; legal: one, the base")
    rows = {name: _row(name, joint_of, parent_of, fields) for name in names}
    moving = sorted((rows[child] for child in _moved(joint_of)), key=len)
    numbers = {row[-1].get("name"): number for number, row in enumerate(moving)}
    return UrdfTree(
        tuple(row[-1] for row in moving),
        tuple(_described(row, numbers, fields) for row in moving),
        {name: numbers[row[-1].get("name")] if row else None for name, row in rows.items()},
    )


def _moved(joint_of: dict[str, XmlElement]) -> list[str]:
    return [child for child, joint in joint_of.items() if joint.get("type") != "fixed"]


def _described(row: list[XmlElement], numbers: dict[str | None, int], fields: XmlFields) -> MovingJoint:
    joint = row[-1]
    kind, mimic = joint.get("type", ""), fields.only(joint, "mimic")
    return MovingJoint(
        name=fields.text(joint, "name"),
        place=fields.place(joint),
        kind=kind,
        turns=kind in _TURNING,
        follows=None if mimic is None else fields.text(mimic, "joint"),
        before=numbers[row[-2].get("name")] if len(row) > 1 else None,
    )


def _unique(elements: Sequence[XmlElement], fields: XmlFields) -> list[str]:
    names: dict[str, None] = {}
    for element in elements:
        name = fields.text(element, "name")
        if name in names:
            raise InputError(f"{fields.place(element)}: the name is given twice")
        names[name] = None
    return list(names)


def _end(joint: XmlElement, end: str, names: Sequence[str], fields: XmlFields) -> str:
    name = fields.text(fields.needed(joint, end, f"<{end} link=…>"), "link")
    if name not in names:
        raise InputError(f"{fields.place(joint)}: {end} {spelled(name)}: no such link")
    return name


def _row(
    link: str, joint_of: dict[str, XmlElement], parent_of: dict[str, str], fields: XmlFields
) -> list[XmlElement]:
    """Return the moving joints between base and link."""
    row: list[XmlElement] = []
    steps = 0
    while link in joint_of:
        joint, steps = joint_of[link], steps + 1
        if steps > len(joint_of):
            raise InputError(f"{fields.place(joint)}: part of a loop; legal: a tree of links")
        if joint.get("type") != "fixed":
            row.insert(0, joint)
        link = parent_of[link]
    return row
