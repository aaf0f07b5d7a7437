"""Mesh files at the program's edge: STL, OBJ and COLLADA read within bounds."""

from __future__ import annotations

import io
import logging
import re
from pathlib import Path
from typing import Any

import numpy as np

from omniservo.errors import InputError
from omniservo.files import read_bytes
from omniservo.files.collada_text import collada_triangles
from omniservo.files.obj_text import obj_triangles
from omniservo.files.own_warnings import own_warnings
from omniservo.geometry.arrays import FloatArray, IntArray

MOST_BYTES = 16 * 2**20
"""A larger file is not read."""

_HEADER, _RECORD = 84, 50
"""[bytes] of a binary STL, and of each triangle in it"""

_NAME = re.compile(rb"^([ \t]*(?:end)?solid\b)[^\r\n]*", re.IGNORECASE | re.MULTILINE)
"""A solid's name, in which trimesh would take "vertex" and "solid" for what they say elsewhere"""

_STOPPED = "string or file could not be read to its end"
"""NumPy's warning where it stops in the middle of a text"""


def read_triangles(path: Path) -> tuple[FloatArray, IntArray]:
    """Return vertices (v, 3) and triangles (f, 3) of an STL (text or binary), OBJ or COLLADA (DAE) file.

    STL and OBJ as they have them, COLLADA in metres, see `collada_triangles`. Materials, textures and
    whatever else the file names are not read.

    Raises:
        InputError: not readable, above 16 MiB, not of these formats, not finite, or without a triangle.
    """
    kind = path.suffix.lower()
    if kind not in _LOADERS:
        raise InputError(f"{path}: {kind!r} given; legal: {', '.join(map(repr, _LOADERS))}")
    content = read_bytes(path, max_bytes=MOST_BYTES)
    try:
        vertices, triangles = _LOADERS[kind](content)
    except Exception as error:
        raise InputError(f"{path}: not {kind[1:].upper()} as far as can be read: {error!s:.80}") from None
    if len(triangles) == 0:
        raise InputError(f"{path}: no triangles in it")
    if not np.isfinite(vertices).all():
        row = int(np.argwhere(~np.isfinite(vertices).all(axis=1))[0, 0])
        raise InputError(f"{path}: vertex {row} is {vertices[row].tolist()}; every number must be finite")
    odd = triangles[(triangles < 0) | (triangles >= len(vertices))]
    if len(odd):
        raise InputError(
            f"{path}: a triangle of vertex {odd[0]}, counted from 0; there are {len(vertices)} vertices"
        )
    return vertices, triangles


_SILENT = logging.NullHandler()
"""Without a handler, what trimesh says of a broken file goes to standard error, with a traceback."""


def _load_stl(content: bytes) -> tuple[FloatArray, IntArray]:
    from trimesh.exchange.stl import load_stl  # loads slowly, and few callers have meshes

    logging.getLogger("trimesh").addHandler(_SILENT)
    is_binary = len(content) == _HEADER + _RECORD * int.from_bytes(content[_HEADER - 4 : _HEADER], "little")
    if not is_binary:
        content = _NAME.sub(rb"\1", content)
    with own_warnings("error", _STOPPED):
        loaded: dict[str, Any] = load_stl(io.BytesIO(content))
    solids = list(loaded["geometry"].values()) if "geometry" in loaded else [loaded]
    corners = [np.asarray(solid["vertices"], dtype=np.float64).reshape(-1, 3) for solid in solids]
    vertices = np.concatenate([np.zeros((0, 3)), *corners])  # three of each triangle, in their order
    if not is_binary and content.lower().count(b"vertex") > len(vertices):
        raise ValueError("a solid does not end")  # such ones are passed over
    return vertices, np.arange(len(vertices)).reshape(-1, 3)


def _load_obj(content: bytes) -> tuple[FloatArray, IntArray]:
    return obj_triangles(content.decode("utf-8-sig", "replace"))


def _load_dae(content: bytes) -> tuple[FloatArray, IntArray]:
    return collada_triangles(content.decode("utf-8"))


_LOADERS = {".stl": _load_stl, ".obj": _load_obj, ".dae": _load_dae}
