"""Every figure of a run, drawn and written."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

from omniservo.reporting.figure_files import write_drawings
from omniservo.reporting.joint_figures import joint_positions, joint_speeds
from omniservo.reporting.link_clearance import link_clearance
from omniservo.reporting.margins import arm_gap, clearance, visibility
from omniservo.reporting.path_3d import path_3d
from omniservo.reporting.replanning import replanning
from omniservo.reporting.robot_motion import rotation, translation
from omniservo.reporting.signals import camera_twist, image_error, joint_velocities
from omniservo.reporting.style import Drawing, styled
from omniservo.reporting.trajectories import image_trajectories, plane_trajectories
from omniservo.reporting.views import outside, views
from omniservo.results.run_result import RunResult

_FIGURES: tuple[Callable[[RunResult], Drawing | None], ...] = (
    views,
    outside,
    path_3d,
    replanning,
    plane_trajectories,
    image_trajectories,
    translation,
    rotation,
    clearance,
    link_clearance,
    arm_gap,
    visibility,
    image_error,
    camera_twist,
    joint_velocities,
    joint_positions,
    joint_speeds,
)


def write_figures(result: RunResult, folder: Path) -> list[Path]:
    """Draw every figure that the run has the data for, each as PNG and as SVG; return the files written.

    Existing files are replaced.

    Raises:
        InputError: the folder cannot be written.
    """
    return write_drawings(drawings(result), folder)


def drawings(result: RunResult) -> Iterator[Drawing]:
    """Yield the run's figures one by one, in the order in which they are read."""
    for draw in _FIGURES:
        with styled():
            drawing = draw(result)
        if drawing is not None:
            yield drawing
