"""MJCF files put together from those that they include."""

from __future__ import annotations

from pathlib import Path

from omniservo.errors import InputError, spelled
from omniservo.files import read_text
from omniservo.files.xml_files import XmlElement, parse_elements
from omniservo.robots.arm_files.mesh_assets import file_near
from omniservo.robots.arm_files.xml_fields import XmlFields

MOST_BYTES = 4 * 2**20
"""Of a robot's or scene's file, and of each file that it includes."""

_MOST_INCLUDES = 16


def expand_includes(root: XmlElement, file: Path) -> None:
    """Put what the includes name in their places.

    Args:
        root: the file's element <mujoco>; it is changed.
        file: where it lies; includes are looked for from there, inside its folder or, by ``../``, the one
            above.

    Raises:
        InputError: a file that cannot be had, one twice, or more than 16.
    """
    _expand(root, XmlFields(), file, {file.resolve()})


def _expand(element: XmlElement, fields: XmlFields, file: Path, included: set[Path]) -> None:
    for index in reversed(range(len(element))):
        child = element[index]
        if not isinstance(child, XmlElement):
            continue
        if child.tag != "include":
            _expand(child, fields, file, included)
            continue
        held = _include(child, fields, file, included)
        _expand(held, fields, file, included)
        element[index : index + 1] = list(held)


def _include(include: XmlElement, fields: XmlFields, file: Path, included: set[Path]) -> XmlElement:
    place, reference = fields.place(include), fields.text(include, "file")
    path = file_near(f"{place}: file", reference, file.resolve().parent)
    if path in included:
        raise InputError(f"{place}: {spelled(reference)} is included twice; once is legal")
    included.add(path)
    if len(included) > _MOST_INCLUDES + 1:
        raise InputError(f"{place}: more than {_MOST_INCLUDES} includes")
    held = parse_elements(read_text(path, max_bytes=MOST_BYTES), str(path))
    if held.tag not in ("mujoco", "mujocoinclude"):
        raise InputError(f"{place}: {spelled(reference)} holds <{held.tag}>; legal: <mujocoinclude>")
    return held
