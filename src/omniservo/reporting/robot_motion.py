"""Translation and rotation of the robot over time (figures 4 and 7)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.spatial.transform import RigidTransform

from omniservo.geometry.arrays import FloatArray
from omniservo.reporting.curves import executed_curve
from omniservo.reporting.style import THREE, Drawing, legend_below, new_axes
from omniservo.results.run_result import RunResult

_LEAST_SPAN = 0.2
"""of the rotation's axis [deg]: less is noise"""


def translation(result: RunResult) -> Drawing | None:
    """Draw the flange's position over time, in the paper's robot axes; None for a run without a step."""
    executed = executed_curve(result)
    if not len(executed):
        return None
    planned = _planned_poses(result, executed.w)
    figure, _ = _three(
        executed.time,
        1000.0 * robot_position(result, executed.poses),
        None if planned is None else 1000.0 * robot_position(result, planned),
        ("x", "y", "z"),
        "position of the flange [mm]",
    )
    return Drawing(
        "translation",
        "Translation of the robot",
        "The flange's position from the world's origin, along the axes of the initial camera; the paper "
        "calls these q1, q2, q3. Dashed: the plan.",
        figure,
    )


def rotation(result: RunResult) -> Drawing | None:
    """Draw the camera's rotation over time; None for a run without a step."""
    executed = executed_curve(result)
    if not len(executed):
        return None
    planned = _planned_poses(result, executed.w)
    figure, axes = _three(
        executed.time,
        np.rad2deg(continuous(executed.rotations)),
        None if planned is None else np.rad2deg(continuous(planned.rotation.as_rotvec())),
        ("about x", "about y", "about z"),
        "rotation vector [deg]",
    )
    _at_least(axes, _LEAST_SPAN)
    return Drawing(
        "rotation",
        "Rotation of the robot",
        "The rotation vector (axis times angle) of the end-effector since the start, about the axes of the "
        f"initial camera; the paper calls these q4, q5, q6. Dashed: the plan. {_most(executed.rotations)}",
        figure,
    )


def continuous(rotations: FloatArray) -> FloatArray:
    """Return the same rotations by vectors (k, 3) [rad] without a jump where they pass half a turn."""
    found = rotations.copy()
    for before, vector in pairwise(found):
        angle = float(np.linalg.norm(vector))
        if angle > 0.0:
            turns = round((float(before @ vector) / angle - angle) / (2.0 * np.pi))
            vector *= 1.0 + 2.0 * np.pi * turns / angle
    return found


def robot_position(result: RunResult, initial_T_camera: RigidTransform) -> FloatArray:
    """Return the flange's position (k, 3) [m] from the world's origin, in the initial camera's axes."""
    world_T_initial = result.task.start.world_T_camera.transform
    camera_T_flange = result.task.arm.flange_T_camera.transform.inv()
    in_world = (world_T_initial * initial_T_camera * camera_T_flange).translation
    return np.asarray(world_T_initial.rotation.inv().apply(in_world), dtype=np.float64)


def _planned_poses(result: RunResult, w: FloatArray) -> RigidTransform | None:
    if result.way is None or not np.isfinite(w).all():
        return None
    return result.way.poses(np.clip(w, 0.0, 1.0))


def _three(
    time: FloatArray, executed: FloatArray, planned: FloatArray | None, names: Sequence[str], what: str
) -> tuple[Figure, Axes]:
    """Draw three components (k, 3) over time: executed thick, planned dashed."""
    figure, axes = new_axes(5.8, 3.6)
    dot = "." if len(time) == 1 else ""
    for name, colour, values in zip(names, THREE, executed.T, strict=True):
        axes.plot(time, values, color=colour, lw=2.2, marker=dot, label=name)
    if planned is not None:
        axes.plot(time, planned, color="black", lw=1.0, ls=(0, (4, 3)), label=["planned", None, None])
    axes.set_xlabel("time [s]")
    axes.set_ylabel(what)
    legend_below(figure, axes, 4)
    return figure, axes


def _most(rotations: FloatArray) -> str:
    """Say how far the flange turned (k, 3) [rad]: on a small scale noise looks like motion."""
    most = np.rad2deg(np.linalg.norm(rotations, axis=1)).max()
    hardly = "hardly turned, by" if most < 1.0 else "turned by"
    return f"It {hardly} at most {most:.2g}°."


def _at_least(axes: Axes, span: float) -> None:
    """Widen the vertical range to ``span``, so that noise does not look like motion."""
    low, high = axes.get_ylim()
    if high - low < span:
        middle = 0.5 * (low + high)
        axes.set_ylim(middle - 0.5 * span, middle + 0.5 * span)
