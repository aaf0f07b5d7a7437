"""What the surfaces of any MuJoCo model look like: colours, materials and textures as MuJoCo draws them."""

from __future__ import annotations

from typing import Any, NamedTuple

import mujoco
import numpy as np

from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.simulation.mesh_coordinates import mesh_coordinates

_UNPAINTED = np.array([0.5, 0.5, 0.5, 1.0])
"""MuJoCo's own colour of a geom; any other one stands before its material's"""

_PLAIN = (0.5, 0.5, 0.0)
"""specular, shininess and emission of a geom without a material"""

_ROLE = int(mujoco.mjtTextureRole.mjTEXROLE_RGB)
_2D, _CUBE = int(mujoco.mjtTexture.mjTEXTURE_2D), int(mujoco.mjtTexture.mjTEXTURE_CUBE)
_SKYBOX = int(mujoco.mjtTexture.mjTEXTURE_SKYBOX)
_SRGB = int(mujoco.mjtColorSpace.mjCOLORSPACE_SRGB)
_GREYS = np.arange(256) / 255.0
_OF_SRGB = np.where(_GREYS <= 0.04045, _GREYS / 12.92, ((_GREYS + 0.055) / 1.055) ** 2.4)
"""linear values of 8 bit: IEC 61966-2-1"""
_KINDS = mujoco.mjtGeom
_IN_METRES = (_KINDS.mjGEOM_PLANE, _KINDS.mjGEOM_HFIELD, _KINDS.mjGEOM_MESH)
"""what MuJoCo draws point by point; the others are unit shapes that it stretches"""
_SIDES = 6


class Paint(NamedTuple):
    """What n points of surfaces are painted with."""

    colours: FloatArray
    """(n, 3) in [0, 1], under the texture"""
    texture: FloatArray
    """(n, 3) what of all light it lets through"""
    specular: FloatArray
    """(n,)"""
    shininess: FloatArray
    """(n,) exponent"""
    emission: FloatArray
    """(n,)"""


class ModelSurfaces:
    """Paints points on a model's geoms.

    Textures lie as MuJoCo's renderer lays them: on a plane, box, sphere, ellipsoid, cylinder and capsule as
    on its own shapes, on a mesh by its texture coordinates, where it has some.
    """

    def __init__(self, model: Any) -> None:
        """Prepare for a model."""
        self._model = model
        own, materials = model.geom_rgba.astype(np.float64), model.geom_matid
        has = materials >= 0
        painted = (own != _UNPAINTED).any(axis=1)
        self._rgba = np.where((has & ~painted)[:, None], _of(model.mat_rgba, materials, _UNPAINTED), own)
        self._gloss = np.stack(
            [
                np.where(has, _of(values, materials, plain), plain)
                for values, plain in zip(
                    (model.mat_specular, model.mat_shininess, model.mat_emission), _PLAIN, strict=True
                )
            ]
        )
        no_texture = np.full(int(mujoco.mjtTextureRole.mjNTEXROLE), -1)
        self._texture = np.where(has, _of(model.mat_texid, materials, no_texture)[:, _ROLE], -1)
        skies = np.flatnonzero(model.tex_type == _SKYBOX)
        self._sky = int(skies[0]) if len(skies) else -1

    def paint(self, data: Any, geoms: IntArray, points: FloatArray, normals: FloatArray) -> Paint:
        """Return what points (n, 3) of the geoms (n,) are painted with; normals (n, 3); all in the world."""
        texture = np.ones(points.shape)
        for geom in np.unique(geoms[self._texture[geoms] >= 0]):
            here = np.flatnonzero(geoms == geom)
            axes = data.geom_xmat[geom].reshape(3, 3)
            local, outward = (points[here] - data.geom_xpos[geom]) @ axes, normals[here] @ axes
            texture[here] = self._textured(int(geom), local, outward)
        specular, shininess, emission = self._gloss[:, geoms]
        return Paint(self._rgba[geoms, :3], texture, specular, 128.0 * shininess, emission)

    def sky(self, directions: FloatArray) -> FloatArray:
        """Return the colours (n, 3) of what is behind everything along directions (n, 3); black: no sky."""
        if self._sky < 0:
            return np.zeros(directions.shape)
        x, y, z = directions.T
        return self._on_cube(self._sky, np.stack([x, z, -y], axis=-1))

    def _textured(self, geom: int, local: FloatArray, outward: FloatArray) -> FloatArray:
        """Return the texture's colours (n, 3) at points (n, 3) of a geom, in its own frame."""
        model, texture = self._model, int(self._texture[geom])
        material, kind = int(model.geom_matid[geom]), int(model.geom_type[geom])
        size, uniform = _drawn_size(kind, model.geom_size[geom]), bool(model.mat_texuniform[material])
        if model.tex_type[texture] != _2D:
            place = local if kind in _IN_METRES else _on_unit_shape(kind, local, size)
            return self._on_cube(texture, place * size if uniform else place)
        repeat = model.mat_texrepeat[material].astype(np.float64)
        repeat = np.where(repeat > 0.0, repeat, 1.0)
        sides = np.where(size[:2] > 0.0, size[:2], 1.0)
        stretched = repeat * sides if uniform else repeat
        if kind == _KINDS.mjGEOM_PLANE:
            endless = size[:2] <= 0.0
            flat = (0.5 * local[:, :2] / sides * [1.0, -1.0] + 0.5 * ~endless) * stretched
            return self._on_plane(texture, flat - 0.5 * endless.any())
        is_mesh = kind == _KINDS.mjGEOM_MESH
        known = mesh_coordinates(model, int(model.geom_dataid[geom]), local) if is_mesh else None
        if kind in _IN_METRES and known is None:
            return self._on_plane(texture, 0.5 * local[:, :2] * [1.0, -1.0] * stretched / sides - 0.5)
        flat = _coordinates(kind, local, size, outward) if known is None else known
        return self._on_plane(texture, flat * stretched)

    def _on_plane(self, texture: int, at: FloatArray) -> FloatArray:
        """Return the colours (n, 3) of a texture that repeats, at (n, 2): across and down, 1 its side."""
        image = self._image(texture)
        height, width = image.shape[:2]
        return _between(image, at * [width, height] - 0.5, repeats=True)

    def _on_cube(self, texture: int, directions: FloatArray) -> FloatArray:
        """Return the colours (n, 3) of a cube's texture in directions (n, 3)."""
        image = self._image(texture)
        side = image.shape[1]
        faces = image.reshape(-1, side, side, 3)
        across, down, face = _on_cube_face(directions)
        colours = np.empty(directions.shape)
        for number in range(_SIDES):
            here = face == number
            at = 0.5 * side * (np.stack([across[here], down[here]], axis=-1) + 1.0) - 0.5
            colours[here] = _between(faces[number % len(faces)], at, repeats=False)
        return colours

    def _image(self, texture: int) -> FloatArray:
        """Return a texture (height, width, 3) in [0, 1]; one with grey alone has it three times.

        A flat one of sRGB is made linear, as MuJoCo does, which takes those of cubes as they are.
        """
        model = self._model
        height, width = int(model.tex_height[texture]), int(model.tex_width[texture])
        parts, begin = int(model.tex_nchannel[texture]), int(model.tex_adr[texture])
        values = model.tex_data[begin : begin + height * width * parts].reshape(height, width, parts)
        is_srgb = model.tex_type[texture] == _2D and model.tex_colorspace[texture] == _SRGB
        image: FloatArray = (_OF_SRGB if is_srgb else _GREYS)[values[..., :3]]
        return image if parts >= 3 else np.repeat(image[..., :1], 3, axis=-1)


def _of(values: Any, materials: IntArray, otherwise: Any) -> Any:
    """Return the materials' values, by geom; where there is no material, what stands for it."""
    if not len(values):
        return np.broadcast_to(np.asarray(otherwise), (len(materials), *np.shape(otherwise)))
    return values.reshape(len(values), *np.shape(otherwise))[np.maximum(materials, 0)]


def _drawn_size(kind: int, size: FloatArray) -> FloatArray:
    """Return half of the sides (3,) of a geom as MuJoCo draws it: its unit shape is stretched by them."""
    if kind == _KINDS.mjGEOM_SPHERE:
        return np.full(3, size[0])
    if kind in (_KINDS.mjGEOM_CYLINDER, _KINDS.mjGEOM_CAPSULE):
        return np.array([size[0], size[0], size[1]])
    return np.array(size)


def _on_unit_shape(kind: int, local: FloatArray, size: FloatArray) -> FloatArray:
    """Return where points (n, 3) of a geom lie on its unit shape; of a capsule's ends, on a unit ball."""
    place: FloatArray = local / size
    if kind == _KINDS.mjGEOM_CAPSULE:
        beyond = np.abs(local[:, 2]) - size[2]
        place[:, 2] = np.where(beyond > 0.0, np.copysign(1.0 + beyond / size[0], local[:, 2]), place[:, 2])
    return place


def _coordinates(kind: int, local: FloatArray, size: FloatArray, outward: FloatArray) -> FloatArray:
    """Return where in a texture points (n, 3) of MuJoCo's own shapes lie, (n, 2): across and down."""
    x, y, z = (local / size).T
    turn = np.arctan2(y, x) / (2.0 * np.pi) % 1.0
    if kind == _KINDS.mjGEOM_BOX:
        face = np.abs(outward).argmax(axis=1)
        across, up = np.where(face == 0, y, x), np.where(face == 2, y, z)
        return np.stack([0.5 + 0.5 * across, 0.5 - 0.5 * up], axis=-1)
    if kind == _KINDS.mjGEOM_CYLINDER:
        is_end = np.abs(outward[:, 2]) > 0.5
        down = np.where(is_end, 0.5 + 0.5 * y, 0.5 - 0.5 * z)
        return np.stack([np.where(is_end, 0.5 + 0.5 * x, turn), down], axis=-1)
    if kind == _KINDS.mjGEOM_CAPSULE:
        beyond = np.arcsin(np.clip((np.abs(local[:, 2]) - size[2]) / size[0], 0.0, 1.0)) / (np.pi / 2.0)
        ends = np.where(z > 0.0, 1.0 - beyond, beyond)
        return np.stack([turn, np.where(np.abs(z) > 1.0, ends, 0.5 - 0.5 * z)], axis=-1)
    lengths = np.sqrt(x**2 + y**2 + z**2)
    return np.stack([turn, 0.5 - np.arcsin(np.clip(z / lengths, -1.0, 1.0)) / np.pi], axis=-1)


def _on_cube_face(directions: FloatArray) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return across and down (n,) in [−1, 1] on a cube's face, and which (n,): +x, −x, +y, −y, +z, −z."""
    x, y, z = directions.T
    axis = np.abs(directions).argmax(axis=1)
    along = directions[np.arange(len(axis)), axis]
    ahead = np.where(along >= 0.0, 1.0, -1.0)
    size = np.maximum(np.abs(along), 1e-300)
    across = np.choose(axis, [-ahead * z, x, ahead * x])
    down = np.choose(axis, [-y, ahead * z, -y])
    return across / size, down / size, 2 * axis + (along < 0.0)


def _between(image: FloatArray, at: FloatArray, *, repeats: bool) -> FloatArray:
    """Return an image's colours (n, 3) at (n, 2) [px], linear between pixels' centres."""
    height, width = image.shape[:2]
    first = np.floor(at).astype(np.int64)
    right, down = (at - first).T[..., None]

    def pixel(du: int, dv: int) -> FloatArray:
        u, v = first[:, 0] + du, first[:, 1] + dv
        rows, columns = (v % height, u % width) if repeats else (v.clip(0, height - 1), u.clip(0, width - 1))
        colours: FloatArray = image[rows, columns]
        return colours

    above = (1.0 - right) * pixel(0, 0) + right * pixel(1, 0)
    below = (1.0 - right) * pixel(0, 1) + right * pixel(1, 1)
    mixed: FloatArray = (1.0 - down) * above + down * below
    return mixed
