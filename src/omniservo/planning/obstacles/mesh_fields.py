"""Meshes that a problem file names by their file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from scipy.spatial.transform import Rotation

from omniservo.errors import InputError
from omniservo.files import file_inside
from omniservo.geometry.arrays import finite_number
from omniservo.planning.checks import LARGEST, bounded_array, unit_vector
from omniservo.planning.obstacles.mesh import Mesh
from omniservo.planning.obstacles.mesh_file import read_mesh


def meshes_of_file(fields: Mapping[str, Any], folder: Path | None) -> tuple[Mesh, ...]:
    """Return a mesh for every convex part of ``fields["file"]``, at R(quaternion)·scale·v + translation.

    Raises:
        InputError: a field that is not legal, a path outside the folder, or a file without convex parts.
    """
    name = fields["file"]
    if not isinstance(name, str):
        raise InputError(f"file: {name!r:.40} given; a path is needed")
    scale = finite_number("scale", fields.get("scale", 1.0), above=0.0, maximum=LARGEST)
    turn = Rotation.from_quat(unit_vector("quaternion", fields.get("quaternion", (0.0, 0.0, 0.0, 1.0)), 4))
    shift = bounded_array("translation", fields.get("translation", (0.0, 0.0, 0.0)), (3,))
    own = {key: fields.get(key) for key in ("clearance", "motion")}
    path = file_inside("file", name, folder)
    try:
        return tuple(Mesh(turn.apply(scale * part) + shift, **own) for part in read_mesh(path))
    except InputError as error:
        message = str(error)
        raise InputError(f"file: {message}" if message.startswith(str(path)) else message) from None
