"""``omniservo estimate``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from omniservo.cli.output import (
    CameraNameOption,
    ForceOption,
    JsonOption,
    Output,
    QuietOption,
    SeedOption,
    answer_is_no,
)
from omniservo.errors import InputError


def estimate(
    task: Annotated[str | None, typer.Argument(help="A shipped task or a YAML file.")] = None,
    camera: Annotated[
        str | None, typer.Option("--camera", help="Calibration of the two images, or replaces the task's.")
    ] = None,
    camera_name: CameraNameOption = None,
    initial: Annotated[Path | None, typer.Option("--initial", help="The initial image.")] = None,
    goal: Annotated[Path | None, typer.Option("--goal", help="The goal image.")] = None,
    displacement: Annotated[
        float | None, typer.Option("--displacement", help="Between the two camera centres [m].")
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", help="Write the estimate here (JSON).")] = None,
    seed: SeedOption = 0,
    force: ForceOption = False,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Estimate the camera's motion and the target's structure from two images."""
    from omniservo.files import writable
    from omniservo.runs import estimate_images, estimate_simulated

    output = Output(as_json, quiet)
    if out is not None:
        writable(out, force=force)
    with output.working("estimating"):
        if task is not None and initial is None and goal is None and displacement is None:
            result = estimate_simulated(task, camera=camera, camera_name=camera_name, seed=seed)
        elif task is None and camera is not None and initial is not None and goal is not None:
            result = estimate_images(
                camera, initial, goal, camera_name=camera_name, displacement=displacement
            )
        else:
            raise InputError("estimate: give a TASK, or --camera, --initial and --goal")
    if out is not None:
        result.save(out, force=force)
    output.result(result.to_dict())
    if result.initial_T_goal is None:
        raise answer_is_no(f"motion and structure cannot be estimated: {result.status}")
    unit = "m" if result.is_metric else "(length 1: no scale was given)"
    turn = result.initial_T_goal.rotation.as_rotvec(degrees=True)
    output.line(f"translation {np.array2string(result.initial_T_goal.translation, precision=5)} {unit}")
    output.line(f"rotation vector {np.array2string(turn, precision=4)} deg")
    output.line(f"{int(result.inliers.sum())} of {len(result.inliers)} points, rms {result.rms_px:.3f} px")
