"""MJCF files: checked, put together from their includes, and freed of what is not the arm.

Kept are bodies with joints, shapes and sites, defaults, meshes, colours, excluded contacts, and drives if
they are position servos. Options, sensors, key frames, lights, cameras, textures, the shapes of the world
itself and mocap bodies, which no arm carries and nothing touches, are left out; whatever could make a model
large or read more files is refused.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from omniservo.errors import InputError
from omniservo.files.xml_files import XmlElement
from omniservo.robots.arm_files.description import LEGAL_COUNTS, Description
from omniservo.robots.arm_files.includes import expand_includes
from omniservo.robots.arm_files.mesh_assets import MeshAssets
from omniservo.robots.arm_files.xml_fields import XmlFields

SPEED = "joint_speed_deg_s"
"""Custom numeric: nominal joint speeds."""

ACCELERATION = "joint_acceleration_deg_s2"
"""Custom numeric: joint accelerations."""

_DROPPED = frozenset({"option", "size", "visual", "statistic", "keyframe", "sensor", "tendon"})
_KEPT = frozenset({"compiler", "default", "asset", "worldbody", "contact", "custom", "actuator", "equality"})
_OF_BODIES = frozenset({"body", "joint", "geom", "site", "frame", "inertial"})
_UNSEEN = frozenset({"light", "camera"})
_ENDS = ("body1", "body2", "site1", "site2")
"""What a constraint or an excluded contact is between"""

_OF_MESHES = frozenset(
    {"name", "class", "file", "vertex", "face", "scale", "refpos", "refquat", "maxhullvert"}
)
_FOLDERS = ("assetdir", "meshdir", "texturedir", "strippath", "discardvisual", "fusestatic")


def read_mjcf(root: XmlElement, file: Path) -> Description:
    """Return the arm that an MJCF file describes.

    Args:
        root: the file's element <mujoco>.
        file: where it lies; includes and meshes are looked for from there.

    Raises:
        InputError: a part that is refused, or a file that cannot be had.
    """
    return _Mjcf(root, file).description()


class _Mjcf:
    """One pass over one file and its includes."""

    def __init__(self, root: XmlElement, file: Path) -> None:
        self._file = file
        self._fields = XmlFields()
        self._meshes = MeshAssets(file)
        expand_includes(root, file)
        self._root = root
        self._rates: dict[str, tuple[float, ...]] = {}
        self._left_out = 0
        self._mocap = [body for body in root.iter("body") if body.get("mocap") == "true"]

    def description(self) -> Description:
        self._fields.sober(self._root)
        fields, clean = self._fields, ET.Element("mujoco", model=self._root.get("model", "arm"))
        folder = self._mesh_folder()
        for section in fields.children(self._root):
            if section.tag in _DROPPED:
                continue
            if section.tag not in _KEPT:
                raise InputError(
                    f"{fields.place(section)}: <{section.tag}> in <mujoco>; legal: "
                    f"{', '.join(sorted(_KEPT | _DROPPED))}"
                )
            kept = ET.SubElement(clean, section.tag, section.attrib)
            self._section(section, kept, folder)
        acceleration = self._rates.get(ACCELERATION)
        return Description(
            ET.tostring(clean, encoding="unicode"),
            self._meshes.assets,
            self._rates.get(SPEED),
            acceleration,
            tuple(self._notices()),
            self._meshes.vertices,
        )

    def _notices(self) -> Iterator[str]:
        if self._left_out:
            yield f"shapes of the world itself left out: {self._left_out}; they do not belong to the arm"
        if self._mocap:
            names = ", ".join(body.get("name", "without a name") for body in self._mocap)
            yield f"mocap bodies left out: {names}; they do not belong to the arm"

    def _section(self, section: XmlElement, kept: ET.Element, folder: str) -> None:
        children = self._fields.children(section)
        if section.tag == "compiler":
            for name in _FOLDERS:
                kept.attrib.pop(name, None)
        elif section.tag == "asset":
            self._assets(children, kept, folder)
        elif section.tag == "worldbody":
            self._bodies(children, kept, of_world=True)
        elif section.tag == "custom":
            for child in children:
                if child.get("name") in (SPEED, ACCELERATION):
                    self._rates[child.get("name", "")] = self._rate(child)
        elif section.tag == "contact":
            kept.extend(
                child for child in children if child.tag == "exclude" and not self._is_of_mocap(child)
            )
        elif section.tag == "equality":
            kept.extend(child for child in children if not self._is_of_mocap(child))
        elif section.tag == "default":
            kept.extend(children)
            for material in kept.iter("material"):
                material.attrib.pop("texture", None)
        elif {child.tag for child in children} == {"position"}:
            kept.extend(children)

    def _is_of_mocap(self, pair: XmlElement) -> bool:
        """Tell whether a constraint or an excluded contact has an end in a mocap body."""
        names = {part.get("name") for body in self._mocap for part in body.iter() if part.get("name")}
        return any(pair.get(end) in names for end in _ENDS)

    def _rate(self, numeric: XmlElement) -> tuple[float, ...]:
        values = self._fields.positive(numeric, "data", None)
        if len(values) not in LEGAL_COUNTS:
            raise InputError(
                f"{self._fields.place(numeric)}: {len(values)} numbers; legal: 6 or 7, one a joint"
            )
        return tuple(np.deg2rad(values).tolist())

    def _mesh_folder(self) -> str:
        folder = ""
        for compiler in self._root.iter("compiler"):
            folder = compiler.get("meshdir", compiler.get("assetdir", folder))
        return folder

    def _assets(self, children: list[XmlElement], kept: ET.Element, folder: str) -> None:
        for child in children:
            if child.tag == "material":
                child.attrib.pop("texture", None)
                kept.append(ET.Element("material", child.attrib))
            elif child.tag == "mesh":
                kept.append(self._mesh(child, folder))
            elif child.tag not in ("texture", "skin"):
                raise InputError(
                    f"{self._fields.place(child)}: <{child.tag}> in <asset>; legal: mesh, material"
                )

    def _mesh(self, mesh: XmlElement, folder: str) -> ET.Element:
        attributes = {name: value for name, value in mesh.attrib.items() if name in _OF_MESHES}
        if "file" not in attributes:
            name, vertices = self._fields.text(mesh, "name"), self._fields.numbers(mesh, "vertex", None)
            if len(vertices) % 3:
                place = self._fields.place(mesh)
                raise InputError(f"{place}: vertex: {len(vertices)} numbers; legal: 3 a vertex")
            self._meshes.vertices[name] = vertices.reshape(-1, 3)
            return ET.Element("mesh", attributes)
        place, reference = self._fields.place(mesh), self._fields.text(mesh, "file")
        attributes.setdefault("name", Path(reference).stem)
        attributes["file"] = self._meshes.add(place, reference, folder)
        return ET.Element("mesh", attributes)

    def _bodies(self, children: list[XmlElement], kept: ET.Element, *, of_world: bool) -> None:
        for child in children:
            if child.tag == "geom" and of_world:
                self._left_out += 1
                continue
            if child.tag in _UNSEEN or child in self._mocap:
                continue
            if child.tag == "freejoint":  # the same as a joint of this type, but that it takes no defaults
                ET.SubElement(kept, "joint", {"name": child.get("name", ""), "type": "free"})
                continue
            if child.tag not in _OF_BODIES:
                raise InputError(
                    f"{self._fields.place(child)}: <{child.tag}> in the tree of bodies; legal: "
                    f"{', '.join(sorted(_OF_BODIES))}"
                )
            copy = ET.SubElement(kept, child.tag, child.attrib)
            self._bodies(self._fields.children(child), copy, of_world=of_world and child.tag == "frame")
