"""The tree that a URDF's joints make of its links."""

from __future__ import annotations

from collections.abc import Sequence

from omniservo.errors import InputError, spelled
from omniservo.robots.arm_files.xml_fields import XmlFields
from omniservo.xml_files import XmlElement


def in_order(
    links: Sequence[XmlElement], joints: Sequence[XmlElement], fields: XmlFields
) -> list[XmlElement]:
    """Return the joints that are not fixed, from the base outwards.

    Raises:
        InputError: a name twice, a link that does not exist, several roots, a loop, or moving joints that
            are not all in one row.
    """
    names = _unique(links, fields)
    _unique(joints, fields)
    joint_of: dict[str, XmlElement] = {}
    parent_of: dict[str, str] = {}
    for joint in joints:
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
    longest = max(rows.values(), key=len)
    for row in rows.values():
        if row != longest[: len(row)]:
            fork = next(i for i, joint in enumerate(row) if joint is not longest[i])
            raise InputError(
                f"{fields.place(row[fork])}: moves beside joint {spelled(longest[fork].get('name'))}; legal: "
                'one joint after the other. A second arm or a gripper can be made type="fixed"'
            )
    return longest


def _unique(elements: Sequence[XmlElement], fields: XmlFields) -> list[str]:
    names: list[str] = []
    for element in elements:
        name = fields.text(element, "name")
        if name in names:
            raise InputError(f"{fields.place(element)}: the name is given twice")
        names.append(name)
    return names


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
