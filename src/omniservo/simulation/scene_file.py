"""MJCF files of whole scenes, which no one need trust, as MuJoCo models to look at.

Kept is what can be seen: bodies, joints, shapes, sites, lights, cameras, materials, textures, meshes and
height fields. What moves or measures (actuators, sensors, tendons, equalities, key frames), options and
plugins are left out; what makes a model of another file, or many parts of one element, is refused.
"""

from __future__ import annotations

import io
import math
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import mujoco
from PIL import Image, PngImagePlugin

from omniservo.errors import InputError, spelled
from omniservo.files import read_text
from omniservo.files.image_files import is_srgb, read_image
from omniservo.files.xml_files import XmlElement, parse_elements
from omniservo.robots.arm_files.includes import MOST_BYTES, expand_includes
from omniservo.robots.arm_files.mesh_assets import MeshAssets, file_near
from omniservo.robots.arm_files.xml_fields import XmlFields

_SECTIONS = frozenset({"compiler", "default", "asset", "worldbody", "visual", "statistic"})
_LEFT_OUT = frozenset(
    {"option", "size", "keyframe", "sensor", "tendon", "contact", "custom", "actuator", "equality"}
)
_OF_BODIES = frozenset({"body", "joint", "freejoint", "geom", "site", "frame", "inertial", "light", "camera"})
_OF_ASSETS = frozenset({"mesh", "texture", "material", "hfield"})
_OF_JOINTS = frozenset({"name", "class", "type", "group", "pos", "axis", "ref", "limited", "range"})
"""what says where things are; the rest says how they move"""
_NOT_OF_COMPILER = (
    "assetdir", "meshdir", "texturedir", "strippath", "discardvisual", "fusestatic", "settotalmass",
)  # fmt: skip
_OF_MESHES = frozenset({
    "name", "class", "file", "vertex", "normal", "texcoord", "face", "scale", "refpos", "refquat", "inertia",
})  # fmt: skip
_SIDES = ("fileright", "fileleft", "fileup", "filedown", "filefront", "fileback")
_LEAST_MASS = 1e-6
"""[kg], [kg m²] of a body that states none: nothing moves here"""
_LARGEST_SIDE = 4096
"""[px] of a texture, and rows and columns of a height field"""

_MOST_PIXELS = 2**25
"""of all textures together"""


def load_scene_model(path: str | Path) -> Any:
    """Return the ``mujoco.MjModel`` of an MJCF file.

    The file and those that it includes are bounded in size, hold no document types, and name only files
    inside its folder: meshes (STL, OBJ, COLLADA; their texture coordinates are not read) and PNG images.

    Raises:
        InputError: anything else; the message names file, element and what is legal.
    """
    file = Path(path)
    root = parse_elements(read_text(file, max_bytes=MOST_BYTES), str(file))
    if root.tag != "mujoco":
        raise InputError(f"{file}: root element {spelled(root.tag)} given; legal: <mujoco> (MJCF)")
    scene = _SceneFile(root, file)
    text = scene.text()
    try:
        spec = mujoco.MjSpec.from_string(text, assets=scene.assets)
        spec.compiler.boundmass = max(spec.compiler.boundmass, _LEAST_MASS)
        spec.compiler.boundinertia = max(spec.compiler.boundinertia, _LEAST_MASS)
        for mesh in spec.meshes:
            mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX  # open surfaces have one too
        return spec.compile()
    except ValueError as error:
        raise InputError(f"{file}: MuJoCo cannot read it: {' '.join(str(error).split())[:300]}") from None


class _SceneFile:
    """One pass over one file and its includes."""

    def __init__(self, root: XmlElement, file: Path) -> None:
        self._root, self._file, self._fields = root, file, XmlFields()
        self._meshes, self._pixels = MeshAssets(file), 0
        self._pictures: dict[str, bytes] = {}
        expand_includes(root, file)
        for joint in root.iter("joint"):
            for name in joint.attrib.keys() - _OF_JOINTS:
                del joint.attrib[name]
        self._fields.sober(root)

    @property
    def assets(self) -> dict[str, bytes]:
        """Files that the text names."""
        return self._meshes.assets | self._pictures

    def text(self) -> str:
        """Return the scene's MJCF without what is left out."""
        clean = ET.Element("mujoco", model=self._root.get("model", "scene"))
        folders = {name: self._folder(name) for name in ("meshdir", "texturedir")}
        for section in self._fields.children(self._root):
            if section.tag in _LEFT_OUT:
                continue
            if section.tag not in _SECTIONS:
                raise self._illegal(section, "in <mujoco>", _SECTIONS | _LEFT_OUT)
            kept = ET.SubElement(clean, section.tag, section.attrib)
            if section.tag == "compiler":
                for name in _NOT_OF_COMPILER:
                    kept.attrib.pop(name, None)
            elif section.tag == "asset":
                for child in self._fields.children(section):
                    if child.tag != "skin":  # is not drawn
                        kept.append(self._asset(child, folders))
            elif section.tag == "worldbody":
                self._bodies(section, kept)
            elif section.tag == "visual":
                kept.extend(child for child in section if child.tag == "headlight")
            else:
                kept.extend(section)
        return ET.tostring(clean, encoding="unicode")

    def _folder(self, name: str) -> str:
        folder = ""
        for compiler in self._root.iter("compiler"):
            folder = compiler.get(name, compiler.get("assetdir", folder))
        return folder

    def _asset(self, child: XmlElement, folders: dict[str, str]) -> ET.Element:
        if child.tag not in _OF_ASSETS:
            raise self._illegal(child, "in <asset>", _OF_ASSETS)
        attributes = dict(child.attrib)
        if child.tag == "mesh":
            return self._mesh(child, folders["meshdir"])
        if child.tag in ("texture", "hfield") and "file" in attributes:
            attributes.setdefault("name", Path(attributes["file"]).stem)  # as MuJoCo does
        if child.tag == "texture":
            for name in ("file", *_SIDES):
                if name in attributes:
                    attributes[name] = self._image(child, name, folders["texturedir"])
            width, height = (self._side(child, name) for name in ("width", "height"))
            if "builtin" in attributes and attributes.get("type") != "2d":
                self._count(child, width, width, sides=6)  # MuJoCo makes a cube of it, whatever its height
            else:
                self._count(child, height, width)
            attributes.pop("content_type", None)
        if child.tag == "hfield":
            if "file" in attributes:
                attributes["file"] = self._image(child, "file", folders["meshdir"])
            self._count(child, *(self._side(child, name) for name in ("nrow", "ncol")))
            attributes.pop("content_type", None)
        kept = ET.Element(child.tag, attributes)
        if child.tag == "material":
            kept.extend(layer for layer in child if layer.tag == "layer")
        return kept

    def _mesh(self, mesh: XmlElement, folder: str) -> ET.Element:
        attributes = {name: value for name, value in mesh.attrib.items() if name in _OF_MESHES}
        if "file" not in attributes:
            self._fields.text(mesh, "vertex")
            return ET.Element("mesh", attributes)
        place, reference = self._fields.place(mesh), self._fields.text(mesh, "file")
        attributes.setdefault("name", Path(reference).stem)
        attributes["file"] = self._meshes.add(place, reference, folder)
        return ET.Element("mesh", attributes)

    def _image(self, element: XmlElement, attribute: str, folder: str) -> str:
        """Read an image within bounds and hand it on as PNG; return its name."""
        place = f"{self._fields.place(element)}: {attribute}"
        reference = str(Path(folder) / self._fields.text(element, attribute))
        file = file_near(place, reference, self._file.resolve().parent)
        image, said = read_image(file), PngImagePlugin.PngInfo()
        if is_srgb(file):  # MuJoCo makes its values linear
            said.add(b"sRGB", b"\0")
        self._count(element, *image.shape[:2])
        stream, name = io.BytesIO(), f"image{len(self._pictures)}.png"
        Image.fromarray(image).save(stream, "PNG", pnginfo=said)
        self._pictures[name] = stream.getvalue()
        return name

    def _side(self, element: XmlElement, attribute: str) -> int:
        """Return a number of pixels or rows, 0 where none is stated, or one below 0, which MuJoCo refuses."""
        if attribute not in element.attrib:
            return 0
        return max(0, math.ceil(float(self._fields.numbers(element, attribute, 1)[0])))

    def _count(self, element: XmlElement, height: int, width: int, sides: int = 1) -> None:
        """Refuse what takes too much memory."""
        self._pixels += sides * height * width
        if max(height, width) > _LARGEST_SIDE or self._pixels > _MOST_PIXELS:
            raise InputError(
                f"{self._fields.place(element)}: {width} × {height} given; legal: at most {_LARGEST_SIDE} a"
                f" side, and {_MOST_PIXELS} in all textures and height fields"
            )

    def _bodies(self, element: XmlElement, kept: ET.Element) -> None:
        for child in self._fields.children(element):
            if child.tag not in _OF_BODIES:
                raise self._illegal(child, "in the tree of bodies", _OF_BODIES)
            self._bodies(child, ET.SubElement(kept, child.tag, child.attrib))

    def _illegal(self, element: XmlElement, where: str, legal: frozenset[str]) -> InputError:
        names = ", ".join(sorted(legal))
        return InputError(f"{self._fields.place(element)}: <{element.tag}> {where}; legal: {names}")
