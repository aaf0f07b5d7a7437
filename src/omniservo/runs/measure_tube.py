"""A tracking tube from the logs of an arm's own runs."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from omniservo.errors import InputError
from omniservo.files import read_text
from omniservo.geometry.arrays import FloatArray
from omniservo.robots import CAMERA_HOUSING, ArmBodies, TrackingTube, load_arm, strayed
from omniservo.tasks import Task


def measure_tube(task: Task, logs: Sequence[Path]) -> TrackingTube:
    """Return how far the arm of a task deviated from its plans in the runs logged.

    Of ``log.csv`` the columns ``joints_i``, ``planned_joints_i``, and of points that were found
    ``pixels_j_k`` and ``reference_pixels_j_k`` are read, so a log written by another program will do. What
    points deviate in the image includes the noise with which they were found.

    Args:
        task: names the arm and its camera's mount.
        logs: one file a run.

    Raises:
        InputError: fewer than two logs, or one without these columns, without a plan, or of another arm.
    """
    arm, mount = (
        load_arm(task.arm.model, flange=task.arm.flange, packages=task.arm.packages),
        task.arm.flange_T_camera.transform,
    )
    bodies = ArmBodies(arm, mounted=[solid.moved(mount) for solid in CAMERA_HOUSING])
    most, regular = [], []
    for path in logs:
        columns = _columns(path)
        planned, executed = (_stacked(columns, name, arm.dof, path) for name in ("planned_joints", "joints"))
        if not np.isfinite(planned).all():
            raise InputError(f"{path}: planned_joints: not finite; runs that follow a plan are needed")
        jacobians = [arm.scaled_camera_jacobian(q, mount) for q in planned]
        regular.append(float(np.linalg.svd(jacobians, compute_uv=False)[:, -1].min()))
        most.append(strayed(bodies, mount, planned, executed, _image(columns, path)))
    if len(logs) < 2:
        raise InputError(
            f"runs: {len(logs)} given; at least 2 are needed, and for a risk of 1% about three hundred"
        )
    return TrackingTube.of(arm.name, bodies.tube_parts, most, min(regular), f"{len(logs)} logged runs")


def _columns(path: Path) -> dict[str, FloatArray]:
    rows = list(csv.reader(io.StringIO(read_text(path))))
    if len(rows) < 3 or any(len(row) != len(rows[0]) for row in rows):
        raise InputError(f"{path}: no log: a header and at least two rows of as many columns are needed")
    try:
        numbers = np.array(rows[1:], dtype=np.float64)
    except ValueError:
        raise InputError(f"{path}: no log: something is no number") from None
    return dict(zip(rows[0], numbers.T, strict=True))


def _stacked(columns: dict[str, FloatArray], name: str, count: int, path: Path) -> FloatArray:
    found = [columns.get(f"{name}_{i}") for i in range(count)]
    there = [column for column in found if column is not None]
    if len(there) < count or f"{name}_{count}" in columns:
        raise InputError(f"{path}: {name}_0 … {name}_{count - 1} are needed, of {count} joints")
    return np.stack(there, axis=1)


def _image(columns: dict[str, FloatArray], path: Path) -> float:
    """Return the farthest that a point was found from its reference [px]."""
    points = sorted({name[:-2] for name in columns if re.fullmatch(r"pixels_\d+_[01]", name)})
    try:
        gaps = [
            [columns[f"{point}_{k}"] - columns[f"reference_{point}_{k}"] for k in (0, 1)] for point in points
        ]
    except KeyError as missing:
        raise InputError(
            f"{path}: {missing.args[0]} is needed, as pixels_j_k and reference_pixels_j_k"
        ) from None
    if not gaps:
        raise InputError(f"{path}: pixels_j_k and reference_pixels_j_k are needed")
    return float(np.nanmax(np.linalg.norm(gaps, axis=1)))
