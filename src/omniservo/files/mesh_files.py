"""Mesh files at the program's edge: STL, OBJ and COLLADA read within bounds."""

from __future__ import annotations

import io
import logging
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from omniservo.errors import InputError
from omniservo.files import read_bytes
from omniservo.files.collada_text import collada_triangles
from omniservo.geometry.arrays import FloatArray, IntArray

MOST_BYTES = 16 * 2**20
"""A larger file is not read."""


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
    content = io.BytesIO(read_bytes(path, max_bytes=MOST_BYTES))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # NumPy warns where it stops in the middle of a text
            loaded = _LOADERS[kind](content)
        pieces = list(loaded["geometry"].values()) if "geometry" in loaded else [loaded]
        vertices = [np.asarray(p["vertices"], dtype=np.float64).reshape(-1, 3) for p in pieces]
        faces = [np.asarray(p.get("faces", np.zeros((0, 3))), dtype=np.int64).reshape(-1, 3) for p in pieces]
    except Exception as error:
        raise InputError(f"{path}: not {kind[1:].upper()} as far as can be read: {error!s:.80}") from None
    first = np.cumsum([0] + [len(v) for v in vertices])
    joined = np.concatenate([np.zeros((0, 3)), *vertices])
    shifted = [f + before for f, before in zip(faces, first[:-1], strict=True)]
    triangles = np.concatenate([np.zeros((0, 3), np.int64), *shifted])
    if len(triangles) == 0:
        raise InputError(f"{path}: no triangles in it")
    if not np.isfinite(joined).all():
        row = int(np.argwhere(~np.isfinite(joined).all(axis=1))[0, 0])
        raise InputError(f"{path}: vertex {row} is {joined[row].tolist()}; every number must be finite")
    if triangles.min() < 0 or triangles.max() >= len(joined):
        raise InputError(f"{path}: a triangle of vertex {triangles.max()}, but only {len(joined)} vertices")
    return joined, triangles


_SILENT = logging.NullHandler()
"""Without a handler, what trimesh says of a broken file goes to standard error, with a traceback."""


def _load_stl(content: io.BytesIO) -> dict[str, Any]:
    from trimesh.exchange.stl import load_stl  # loads slowly, and few callers have meshes

    logging.getLogger("trimesh").addHandler(_SILENT)
    loaded: dict[str, Any] = load_stl(content)
    return loaded


def _load_obj(content: io.BytesIO) -> dict[str, Any]:
    from trimesh.exchange.obj import load_obj

    loaded: dict[str, Any] = load_obj(content, resolver=None, skip_materials=True)
    return loaded


def _load_dae(content: io.BytesIO) -> dict[str, Any]:
    vertices, triangles = collada_triangles(content.read().decode("utf-8"))
    return {"vertices": vertices, "faces": triangles}


_LOADERS = {".stl": _load_stl, ".obj": _load_obj, ".dae": _load_dae}
