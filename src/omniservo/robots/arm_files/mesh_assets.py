"""The meshes that a robot's file names: found, read within bounds, kept as STL."""

from __future__ import annotations

import os
from functools import lru_cache
from pathlib import Path
from urllib.parse import unquote

import numpy as np

from omniservo.errors import InputError, spelled
from omniservo.files import file_inside, is_file
from omniservo.files.mesh_files import read_triangles
from omniservo.files.ros_packages import RosPackages
from omniservo.geometry.arrays import FloatArray, IntArray, frozen

READABLE = (".stl", ".obj", ".dae")
"""Endings of the meshes that are read."""

MOST_TRIANGLES = 200_000
"""Of one mesh: MuJoCo reads no more."""

_MOST_MESHES = 200
_FLAT = 1e-6
"""extent across over extent along that counts as none"""

_STL = [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")]


class MeshAssets:
    """Reads each mesh once and names it."""

    def __init__(self, file: Path, packages: RosPackages | None = None) -> None:
        """Prepare for the meshes of a robot's file, which paths are relative to."""
        self._folder = file.resolve().parent
        self._packages = packages or RosPackages(file)
        self._names: dict[Path, str] = {}
        self.assets: dict[str, bytes] = {}
        """STL by name"""
        self.vertices: dict[str, FloatArray] = {}
        """(n, 3) of each as the file has them: STL has seven digits"""

    def add(self, place: str, reference: str, folder: str = "") -> str:
        """Return the asset's name of the mesh that ``reference`` means.

        Args:
            place: stands first in messages.
            reference: a path inside the file's folder or the one above, plain or as ``file:///…``, or
                ``package://NAME/path``.
            folder: what a plain path is relative to, as seen from the file's folder.

        Raises:
            InputError: not found, elsewhere, of another format, too large, or flat.
        """
        if Path(reference).suffix.lower() not in READABLE:
            legal = ", ".join(READABLE)
            raise InputError(f"{place}: mesh {spelled(reference)} given; legal: {legal} (convert it)")
        mesh = self._found(place, reference, folder)
        if mesh not in self._names:
            if len(self._names) == _MOST_MESHES:
                raise InputError(f"{place}: more than {_MOST_MESHES} different meshes")
            name = f"mesh{len(self._names)}.stl"
            try:
                self.assets[name], self.vertices[name] = _solid(mesh, _state_of(mesh))
            except InputError as error:
                raise InputError(f"{place}: mesh {error}") from None
            self._names[mesh] = name
        return self._names[mesh]

    def _found(self, place: str, reference: str, folder: str) -> Path:
        scheme, colon, rest = reference.partition("://")
        if not colon:
            return file_near(f"{place}: mesh", str(Path(folder) / reference), self._folder)
        if scheme == "file":
            return self._at(place, reference, unquote(rest))
        if scheme != "package":
            raise InputError(
                f"{place}: mesh {spelled(reference)} given; legal: a path inside the file's folder, or "
                "package://NAME/path"
            )
        return self._packages.find(f"{place}: mesh", *rest.partition("/")[::2])

    def _at(self, place: str, reference: str, path: str) -> Path:
        """Return the file of a ``file://``: where a plain path may lead, too."""
        root = self._folder.parent
        try:
            mesh = file_inside(place, os.path.relpath(path, root) if path.startswith("/") else path, root)
        except InputError:
            raise InputError(
                f"{place}: mesh {spelled(reference)} given; a file:///… is read inside {root}; for one in a "
                "ROS package write package://NAME/path, and say where NAME is with --package NAME=FOLDER"
            ) from None
        if not path.startswith("/") or not is_file(mesh):
            raise InputError(f"{place}: mesh {spelled(reference)}: no such file; legal: file:///FOLDER/FILE")
        return mesh


def file_near(place: str, reference: str, folder: Path) -> Path:
    """Return a file inside a folder, or, by a path that begins with ``../``, inside the one above.

    Packages have their meshes and textures beside the folder of the file that names them.

    Raises:
        InputError: there is none, or it is elsewhere.
    """
    if reference.startswith("../"):
        reference, folder = reference.removeprefix("../"), folder.parent
    found = file_inside(place, reference, folder)
    if not is_file(found):
        raise InputError(f"{place} {spelled(reference)}: no such file in {folder}")
    return found


def _state_of(mesh: Path) -> tuple[int, ...]:
    """Return what changes when a file does."""
    try:
        state = mesh.stat()
    except OSError as error:
        raise InputError(f"{mesh}: {error.strerror or error}") from None
    return state.st_dev, state.st_ino, state.st_size, state.st_mtime_ns


@lru_cache(maxsize=_MOST_MESHES)  # a run reads its arm several times, and some meshes take seconds
def _solid(mesh: Path, state: tuple[int, ...]) -> tuple[bytes, FloatArray]:
    """Return a mesh that spans a volume as STL, and its vertices (n, 3); ``state`` is that of its file."""
    vertices, faces = read_triangles(mesh)
    if len(faces) > MOST_TRIANGLES:
        raise InputError(f"{mesh}: {len(faces)} triangles; legal: at most {MOST_TRIANGLES}")
    used = vertices[np.unique(faces)]
    extents = np.linalg.svd(used - used.mean(axis=0), compute_uv=False) if len(used) > 3 else np.zeros(3)
    if extents[2] <= _FLAT * extents[0]:
        raise InputError(f"{mesh}: flat; legal: a mesh that spans a volume")
    return _as_stl(vertices, faces), frozen(used)


def _as_stl(vertices: FloatArray, faces: IntArray) -> bytes:
    triangles = np.zeros(len(faces), dtype=_STL)
    triangles["corners"] = vertices[faces]
    return bytes(80) + np.uint32(len(faces)).tobytes() + triangles.tobytes()
