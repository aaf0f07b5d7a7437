"""Every figure of a run, drawn and written."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from pathlib import Path

from omniservo.files import write_whole
from omniservo.reporting.margins import arm_gap, clearance, visibility
from omniservo.reporting.path_3d import path_3d
from omniservo.reporting.robot_motion import rotation, translation
from omniservo.reporting.signals import camera_twist, image_error, joint_velocities
from omniservo.reporting.style import Drawing, styled
from omniservo.reporting.trajectories import image_trajectories, plane_trajectories
from omniservo.reporting.views import outside, views
from omniservo.simulation.run_result import RunResult

_FIGURES: tuple[Callable[[RunResult], Drawing | None], ...] = (
    views,
    outside,
    path_3d,
    plane_trajectories,
    image_trajectories,
    translation,
    rotation,
    clearance,
    arm_gap,
    visibility,
    image_error,
    camera_twist,
    joint_velocities,
)

_DPI = 170


def write_figures(result: RunResult, folder: Path) -> list[Path]:
    """Draw every figure that the run has the data for, each as PNG and as SVG; return the files written.

    Existing files are replaced.

    Raises:
        InputError: the folder cannot be written.
    """
    written = []
    for drawing in drawings(result):
        for ending in ("png", "svg"):
            path = folder / f"{drawing.name}.{ending}"
            write_whole(path, image_bytes(drawing, ending), force=True)
            written.append(path)
    return written


def drawings(result: RunResult) -> Iterator[Drawing]:
    """Yield the run's figures one by one, in the order in which they are read."""
    for draw in _FIGURES:
        with styled():
            drawing = draw(result)
        if drawing is not None:
            yield drawing


def image_bytes(drawing: Drawing, ending: str) -> bytes:
    """Return a figure as the bytes of a ``png`` or ``svg`` file; equal figures give equal bytes."""
    stream = io.BytesIO()
    with styled():
        drawing.figure.savefig(
            stream,
            format=ending,
            dpi=_DPI,
            metadata={"Date": None} if ending == "svg" else {"Software": None},
        )
    return stream.getvalue()
