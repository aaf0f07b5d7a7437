"""Meshes and clouds that a task names by their files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from omniservo.errors import InputError, spelled
from omniservo.geometry.arrays import FloatArray
from omniservo.planning.obstacles.cloud_file import read_cloud
from omniservo.planning.obstacles.file_unit import UNIT_FIELDS, file_unit
from omniservo.planning.obstacles.mesh_file import read_mesh
from omniservo.tasks.task_files import TaskFiles

_COORDINATES = {"cloud": "points", "mesh": "vertices"}
"""type: the field that a file takes the place of"""


def with_obstacle_files(planning: Any, files: TaskFiles, metres: float) -> tuple[Any, list[int]]:
    """Return the section with coordinates, in units of ``metres``, in the place of meshes' and clouds' files.

    Each closed convex part of a mesh's file is an obstacle of its own; with the section comes which of the
    file's obstacles each is of.

    Raises:
        InputError: a file that cannot be read, or a field beside it; the message names the field.
    """
    given = planning.get("obstacles") if isinstance(planning, dict) else None
    if not isinstance(given, list):
        return planning, []
    found = [(part, i) for i, obstacle in enumerate(given) for part in _parts(obstacle, i, files, metres)]
    return {**planning, "obstacles": [part for part, _ in found]}, [i for _, i in found]


def with_all_parts(moves: Any, stated: Sequence[int], source: str) -> Any:
    """Return the moves of a task's file with all parts of each known obstacle, by their own numbers.

    Args:
        moves: as the file has them.
        stated: which of the file's obstacles each part is of.
        source: stands first in messages.

    Raises:
        InputError: the file has no such obstacle.
    """
    count, found = len(set(stated)), []
    if count == len(stated) or not isinstance(moves, list):
        return moves
    for i, move in enumerate(moves):
        known = move.get("known") if isinstance(move, dict) else None
        if isinstance(known, list) and known and all(type(k) is int and k >= 0 for k in known):
            if max(known) >= count:
                raise InputError(
                    f"{source}: moves.{i}.known: {max(known)} given; there are {count}, counted from 0"
                )
            move = {**move, "known": [n for k in known for n, of in enumerate(stated) if of == k]}
        found.append(move)
    return found


def _parts(obstacle: Any, number: int, files: TaskFiles, metres: float) -> list[Any]:
    kind = obstacle.get("type") if isinstance(obstacle, dict) else None
    if not isinstance(kind, str) or kind not in _COORDINATES or "file" not in obstacle:
        return [obstacle]
    place, name, coordinates = f"planning.obstacles.{number}", obstacle["file"], _COORDINATES[kind]
    own = f"{place}.file"
    field = f"{files.source}: {own}"
    if coordinates in obstacle:
        raise InputError(f"{field}: given beside {coordinates}; legal: one of the two")
    if not isinstance(name, str):
        raise InputError(f"{field}: {spelled(name)} given; a path is needed")
    try:
        path = files.path(own, name)
        parts = _cloud(path, name) if kind == "cloud" else list(read_mesh(path))
    except InputError as error:
        raise InputError(str(error) if str(error).startswith(field) else f"{field}: {error}") from None
    try:
        unit = file_unit(obstacle)
    except InputError as error:
        raise InputError(f"{files.source}: {place}.{error}") from None
    scale = 1.0 if unit is None else unit / metres
    rest = {key: value for key, value in obstacle.items() if key not in UNIT_FIELDS}
    return [{**rest, coordinates: (scale * part).tolist()} for part in parts]


def _cloud(path: Path, name: str) -> list[FloatArray]:
    points = read_cloud(path)
    bad = ~np.isfinite(points).all(axis=1)
    if bad.any():
        raise InputError(
            f"{name}: {int(bad.sum())} of {len(points)} points are not finite, the first is number "
            f"{int(np.argmax(bad))}; leave them out"
        )
    return [points]
