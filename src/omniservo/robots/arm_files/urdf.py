"""URDF files: checked, and what an arm needs of them rewritten so that MuJoCo reads it as it is meant.

Links with inertia, colour, boxes, cylinders, spheres and meshes; the arm's joints, the others held still.
Everything else in the file (transmissions, plugins, textures, MuJoCo's own settings) is not checked.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np

from omniservo.errors import InputError
from omniservo.files.ros_packages import RosPackages
from omniservo.files.xml_files import XmlElement
from omniservo.geometry.arrays import FloatArray
from omniservo.robots.arm_files.arm_row import arm_row
from omniservo.robots.arm_files.description import ENDLESS, Description, endless_notice, held_notice
from omniservo.robots.arm_files.held_joints import axis_of, held_positions, moved_origin, spelled_positions
from omniservo.robots.arm_files.mesh_assets import MeshAssets
from omniservo.robots.arm_files.urdf_tree import read_tree
from omniservo.robots.arm_files.xml_fields import XmlFields

MOST_LINKS = 500
"""Links of one file, fixed ones too."""

_SETTINGS = {
    "fusestatic": "false",  # fixed frames stay: the flange is one of them
    "discardvisual": "false",
    "strippath": "false",
    "balanceinertia": "true",
}

_NOT_WORLD = "world link"
"""the name of a link that is called ``world``"""

_LEAST_MOMENT = 1e-12
"""[kg m²] no body has less, and MuJoCo takes none of less than 10⁻¹⁴"""

_MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")

_SHAPES = {"box": {"size": 3}, "cylinder": {"radius": 1, "length": 1}, "sphere": {"radius": 1}}


def read_urdf(
    root: XmlElement, file: Path, flange: str | None, packages: RosPackages | None = None
) -> Description:
    """Return the arm that a URDF file describes.

    Args:
        root: the file's element <robot>.
        file: where it lies; meshes are looked for from there.
        flange: the link that carries the camera; None: not said.
        packages: where the packages of its meshes are; None: near the file, or as ROS is set up.

    Raises:
        InputError: not a serial arm of 6 or 7 joints with limits, or a mesh that cannot be had.
    """
    return _Urdf(root, file, flange, packages).description()


class _Urdf:
    """One pass over one file."""

    def __init__(
        self, root: XmlElement, file: Path, flange: str | None, packages: RosPackages | None
    ) -> None:
        self._root = root
        self._flange = flange
        self._file = file
        self._fields = XmlFields()
        self._meshes = MeshAssets(file, packages)
        self._undrawn: dict[str, str] = {}
        """why a mesh that is only for the eye is left out, by its name"""
        self._colours: dict[str, str] = {}
        self._narrowed: list[str] = []
        """joints whose soft limits are narrower than the others"""

    def description(self) -> Description:
        fields, root = self._fields, self._root
        links, joints = fields.children(root, "link"), fields.children(root, "joint")
        if not links:
            raise InputError(f"{self._file}: no <link> in <robot>")
        if max(len(links), len(joints)) > MOST_LINKS:
            raise InputError(
                f"{self._file}: {len(links)} links, {len(joints)} joints; legal: at most {MOST_LINKS}"
            )
        self._rename_world(links, joints)
        tree = read_tree(links, joints, fields)
        row = arm_row(tree.joints, tree.carriers, self._flange, str(self._file))
        moving = [tree.moving[number] for number in row]
        rest = [joint for joint in tree.moving if joint not in moving]
        held = held_positions(rest, fields)
        clean = ET.Element("robot", name=root.get("name", "arm"))
        ET.SubElement(ET.SubElement(clean, "mujoco"), "compiler", _SETTINGS)
        for material in fields.children(root, "material"):
            self._learn_colour(material)
        for link in links:
            clean.append(self._link(link))
        for joint in joints:
            clean.append(self._joint(joint, held))
        return Description(
            ET.tostring(clean, encoding="unicode"),
            self._meshes.assets,
            tuple(self._speed(joint) for joint in moving),
            None,
            self._notices(moving, rest, held),
            self._meshes.vertices,
            frozenset(fields.text(fields.needed(joint, "child", "<child link=…>"), "link") for joint in rest),
        )

    def _rename_world(self, links: list[XmlElement], joints: list[XmlElement]) -> None:
        """Call a link ``world`` otherwise: MuJoCo makes it the world, whose shapes are no part of an arm."""
        names = [(link, "name") for link in links]
        names += [(end, "link") for joint in joints for end in self._fields.children(joint)]
        for element, attribute in names:
            if element.get(attribute, "").strip() == "world":
                element.set(attribute, _NOT_WORLD)

    def _notices(
        self, moving: list[XmlElement], rest: list[XmlElement], held: dict[str, float]
    ) -> tuple[str, ...]:
        notices = []
        if rest:
            notices.append(held_notice(spelled_positions(rest, held)))
        endless = [joint.get("name", "") for joint in moving if joint.get("type") == "continuous"]
        if endless:
            notices.append(endless_notice(endless))
        if self._narrowed:
            notices.append(
                f"ranges narrowed to the soft limits of <safety_controller>: {', '.join(self._narrowed)}"
            )
        if self._undrawn:
            why = ", ".join(dict.fromkeys(self._undrawn.values()))
            notices.append(f"pictures of links left out: {', '.join(self._undrawn)} ({why})")
        return tuple(notices)

    def _speed(self, joint: XmlElement) -> float:
        return float(self._fields.positive(self._limit(joint), "velocity", 1)[0])

    def _limit(self, joint: XmlElement) -> XmlElement:
        limit = self._fields.needed(joint, "limit", "<limit lower=… upper=… velocity=…> [rad, rad/s]")
        endless = joint.get("type") == "continuous"
        for attribute in ("velocity",) if endless else ("lower", "upper", "velocity"):
            if not limit.get(attribute, "").strip():
                raise InputError(
                    f"{self._fields.place(joint)}: limit: {attribute}: missing; legal: lower and upper "
                    "[rad], velocity [rad/s]"
                )
        return limit

    def _joint(self, joint: XmlElement, held: dict[str, float]) -> ET.Element:
        fields, name = self._fields, self._fields.text(joint, "name")
        still = joint.get("type") == "fixed" or name in held
        clean = ET.Element("joint", name=name, type="fixed" if still else "revolute")
        for end in ("parent", "child"):
            ends = fields.needed(joint, end, f"<{end} link=…>")
            ET.SubElement(clean, end, link=fields.text(ends, "link"))
        if name in held:
            xyz, rpy = moved_origin(joint, held[name], fields)
            ET.SubElement(clean, "origin", xyz=_words(xyz), rpy=_words(rpy))
            return clean
        self._origin(joint, clean)
        if not still:
            ET.SubElement(clean, "axis", xyz=_words(axis_of(joint, fields)))
            ET.SubElement(clean, "limit", self._range(joint))
        return clean

    def _range(self, joint: XmlElement) -> dict[str, str]:
        fields, limit = self._fields, self._limit(joint)
        lower, upper = -ENDLESS, ENDLESS
        if joint.get("type") != "continuous":
            lower, upper = (float(fields.numbers(limit, name, 1)[0]) for name in ("lower", "upper"))
        if lower >= upper:
            raise InputError(
                f"{fields.place(joint)}: limit: lower {lower:g}, upper {upper:g}; legal: lower < upper"
            )
        lower, upper = self._soft_range(joint, lower, upper)
        stated = {"lower": repr(lower), "upper": repr(upper)}
        if limit.get("effort") is not None and (effort := float(fields.numbers(limit, "effort", 1)[0])) > 0.0:
            stated["effort"] = repr(effort)
        return stated

    def _soft_range(self, joint: XmlElement, lower: float, upper: float) -> tuple[float, float]:
        """Return what the soft limits of a <safety_controller>, where they are stated, leave of a range."""
        fields, safety = self._fields, self._fields.only(joint, "safety_controller")
        if safety is None:
            return lower, upper
        low, high = (
            float(fields.numbers(safety, name, 1)[0]) if safety.get(name) is not None else hard
            for name, hard in (("soft_lower_limit", lower), ("soft_upper_limit", upper))
        )
        if max(low, lower) >= min(high, upper):
            raise InputError(
                f"{fields.place(safety)}: soft_lower_limit {low:g}, soft_upper_limit {high:g} given; legal: "
                f"lower < upper, and a part of {lower:g} … {upper:g}, or neither of the two"
            )
        if low > lower or high < upper:
            self._narrowed.append(fields.text(joint, "name"))
        return max(low, lower), min(high, upper)

    def _link(self, link: XmlElement) -> ET.Element:
        clean = ET.Element("link", name=self._fields.text(link, "name"))
        inertial = self._fields.only(link, "inertial")
        if inertial is not None:
            self._inertial(inertial, clean)
        for visual in self._fields.children(link, "visual"):
            self._shape(link, visual, clean)
        for collision in self._fields.children(link, "collision"):
            self._shape(link, collision, clean)
        return clean

    def _inertial(self, inertial: XmlElement, clean: ET.Element) -> None:
        fields = self._fields
        mass, inertia = fields.only(inertial, "mass"), fields.only(inertial, "inertia")
        if mass is None or inertia is None:
            return  # MuJoCo infers it from the link's shapes
        kilograms = fields.numbers(mass, "value", 1)
        stated = {part: fields.numbers(inertia, part, 1) for part in _MOMENTS}
        xx, xy, xz, yy, yz, zz = (float(values[0]) for values in stated.values())
        least = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])[0]
        if kilograms[0] <= 0.0 or least <= _LEAST_MOMENT:
            return  # no body is so
        kept = ET.SubElement(clean, "inertial")
        self._origin(inertial, kept)
        ET.SubElement(kept, "mass", value=_words(kilograms))
        ET.SubElement(kept, "inertia", {part: _words(values) for part, values in stated.items()})

    def _shape(self, link: XmlElement, shape: XmlElement, clean: ET.Element) -> None:
        fields, place = self._fields, f"{self._fields.place(link)}: {shape.tag}"
        geometry = fields.only(shape, "geometry")
        held = [] if geometry is None else fields.children(geometry)
        if len(held) != 1:
            raise InputError(f"{place}: {len(held)} shapes in <geometry>; legal: one")
        shown = self._solid(link, shape, held[0])
        if shown is None:
            return
        kept = ET.SubElement(clean, shape.tag)
        self._origin(shape, kept)
        ET.SubElement(kept, "geometry").append(shown)
        for material in fields.children(shape, "material")[:1] if shape.tag == "visual" else ():
            self._learn_colour(material)
            name = material.get("name", "")
            if name in self._colours:
                painted = ET.SubElement(kept, "material", name=name)
                ET.SubElement(painted, "color", rgba=self._colours[name])

    def _solid(self, link: XmlElement, shape: XmlElement, solid: XmlElement) -> ET.Element | None:
        """Return the shape's own element; None: a box of no size, or for the eye alone and not to be had."""
        fields, place = self._fields, f"{self._fields.place(link)}: {shape.tag}"
        if solid.tag == "box" and not fields.numbers(solid, "size", 3).any():
            return None
        if solid.tag in _SHAPES:
            sizes = {name: fields.positive(solid, name, count) for name, count in _SHAPES[solid.tag].items()}
            return ET.Element(solid.tag, {name: _words(values) for name, values in sizes.items()})
        if solid.tag != "mesh":
            raise InputError(f"{place}: <{solid.tag}> given; legal: {', '.join([*_SHAPES, 'mesh'])}")
        reference = fields.text(solid, "filename")
        try:
            mesh = {"filename": self._meshes.add(place, reference)}
        except InputError as error:
            if shape.tag == "collision" or link.find("collision") is None:
                raise
            self._undrawn[reference.rsplit("/", 1)[-1]] = str(error).removeprefix(f"{place}: ")
            return None
        if solid.get("scale") is not None:
            scale = fields.numbers(solid, "scale", 3)
            if not scale.all():
                raise InputError(f"{place}: scale {_words(scale)} given; no part of it may be 0")
            mesh["scale"] = _words(scale)
        return ET.Element("mesh", mesh)

    def _learn_colour(self, material: XmlElement) -> None:
        colour = self._fields.only(material, "color")
        if colour is not None:
            values = self._fields.numbers(colour, "rgba", 4).clip(0.0, 1.0)
            self._colours[material.get("name", "")] = _words(values)

    def _origin(self, element: XmlElement, clean: ET.Element) -> None:
        origin = self._fields.only(element, "origin")
        if origin is None:
            return
        given = {name: self._fields.numbers(origin, name, 3) for name in ("xyz", "rpy") if origin.get(name)}
        ET.SubElement(clean, "origin", {name: _words(values) for name, values in given.items()})


def _words(values: FloatArray) -> str:
    return " ".join(map(repr, values.tolist()))
