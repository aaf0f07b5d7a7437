"""Meshes that a problem file names by their file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from scipy.spatial.transform import Rotation

from omniservo.errors import InputError
from omniservo.files import file_inside
from omniservo.planning.checks import bounded_array
from omniservo.planning.obstacles.file_unit import file_unit
from omniservo.planning.obstacles.mesh import Mesh
from omniservo.planning.obstacles.mesh_file import read_mesh
from omniservo.planning.stated_quaternion import stated_quaternion


def meshes_of_file(fields: Mapping[str, Any], folder: Path | None) -> tuple[Mesh, ...]:
    """Return a mesh for every convex part of ``fields["file"]``, at R·s·v + translation.

    R is stated by quaternion or rotation_vector, s by units or scale; without them 1.

    Raises:
        InputError: a field that is not legal, a path outside the folder, or a file without convex parts.
    """
    name = fields["file"]
    if not isinstance(name, str):
        raise InputError(f"file: {name!r:.40} given; a path is needed")
    unit = file_unit(fields)
    scale = 1.0 if unit is None else unit
    turn = Rotation.from_quat(stated_quaternion(fields))
    shift = bounded_array("translation", fields.get("translation", (0.0, 0.0, 0.0)), (3,))
    own = {key: fields.get(key) for key in ("clearance", "motion")}
    path = file_inside("file", name, folder)
    try:
        return tuple(Mesh(turn.apply(scale * part) + shift, **own, file=name) for part in read_mesh(path))
    except InputError as error:
        message = str(error)
        raise InputError(f"file: {message}" if message.startswith(str(path)) else message) from None
