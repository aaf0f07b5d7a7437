"""What a run left of its motion, to be shown beside the plan."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.errors import InputError
from omniservo.files import read_document, read_text
from omniservo.geometry.arrays import FloatArray
from omniservo.planning import Plan
from omniservo.results import RunResult
from omniservo.scenes import Scene

_LARGEST_LOG = 2**28
"""[bytes]"""


@dataclass(frozen=True, eq=False)
class ExecutedRun:
    """The steps of a run, as joints and images had them."""

    times: FloatArray
    """(s,) since the servo's start [s]"""
    w: FloatArray
    """(s,) path parameter; NaN where another path than the plan's was followed"""
    joints: FloatArray
    """(s, n) as read [rad]"""
    world_T_initial: RigidTransform
    """where the camera was when the path was planned"""
    world_T_camera: RigidTransform
    """(s,) by the joints"""
    errors: FloatArray
    """(s,) rms of the points to their reference [px]"""
    ended: str
    """how it did, in words"""
    plan: Plan | None
    """that was followed"""

    def step_at(self, time: float) -> int:
        """Return the step that is the newest at a time [s]."""
        return int(np.clip(np.searchsorted(self.times, time, side="right") - 1, 0, len(self.times) - 1))

    def world_T_planned(self, step: int) -> RigidTransform | None:
        """Return where the plan has the camera at a step; None where it says nothing."""
        w = float(self.w[step])
        if self.plan is None or self.plan.path is None or not np.isfinite(w):
            return None
        return self.world_T_initial * self.plan.path(w)


def read_executed(folder: Path, scene: Scene, plan: Plan | None) -> ExecutedRun | None:
    """Return what log.csv and metrics.json of a run's folder say; None: it was stopped before a step.

    Raises:
        InputError: a file is missing, or is not what a run writes.
    """
    text = read_text(folder / "log.csv", max_bytes=_LARGEST_LOG)
    lines = text.splitlines()
    if not any(lines[1:]):
        return None
    header = lines[0].split(",")
    try:
        table = np.loadtxt(lines[1:], delimiter=",", comments=None, ndmin=2)
        if table.shape[1] != len(header):
            raise ValueError(f"{table.shape[1]} numbers in a row, {len(header)} names")
        joints = [i for i, name in enumerate(header) if name.startswith("joints_")]
        place = [header.index(f"measured_position_{k}") for k in range(3)]
        turn = [header.index(f"measured_rotation_{k}") for k in range(3)]
        time, w, leg, error = (header.index(name) for name in ("time", "w", "leg", "error_px"))
    except ValueError as wrong:
        raise InputError(f"{folder / 'log.csv'}: not the log of a run: {wrong}") from None
    if len(joints) != scene.arm.dof:
        raise InputError(f"{folder / 'log.csv'}: {len(joints)} joints; the task's arm has another number")
    used = table[:, [time, *joints, *place, *turn]]
    if not np.isfinite(used).all():
        raise InputError(f"{folder / 'log.csv'}: a number that is not finite")
    poses = RigidTransform.from_components(table[:, place], Rotation.from_rotvec(table[:, turn]))
    world_T_initial = scene.world_T_camera(table[0, joints]) * poses[0].inv()
    return ExecutedRun(
        table[:, time],
        np.where(table[:, leg] == 0.0, table[:, w], np.nan),
        table[:, joints],
        world_T_initial,
        world_T_initial * poses,
        table[:, error],
        _ended(_metrics(folder / "metrics.json")),
        plan,
    )


def executed_of(result: RunResult, world_T_initial: RigidTransform) -> ExecutedRun | None:
    """Return the motion of a run that was just done; None: it was stopped before a step."""
    log = result.log
    if not log.rows:
        return None
    turns = Rotation.from_rotvec(log.column("measured_rotation"))
    poses = RigidTransform.from_components(log.column("measured_position"), turns)
    return ExecutedRun(
        log.column("time"), np.where(log.column("leg") == 0.0, log.column("w"), np.nan), log.column("joints"),
        world_T_initial, world_T_initial * poses, log.column("error_px"),
        _ended(result.metrics), result.plan,
    )  # fmt: skip


def _metrics(path: Path) -> dict[str, Any]:
    metrics: Any = read_document(path) if path.is_file() else {}
    return metrics if isinstance(metrics, dict) else {}


def _ended(metrics: Mapping[str, Any]) -> str:
    reason = metrics.get("reason")
    return f"{metrics.get('status', 'unknown')}{f': {reason}' if reason else ''}"
