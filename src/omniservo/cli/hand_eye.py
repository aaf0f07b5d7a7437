"""``omniservo robot calibrate-hand-eye``."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from omniservo.cli.camera_options import (
    CameraErrorOption,
    MaxAngleOption,
    ModelOption,
    SizeOption,
    open_model,
)
from omniservo.cli.output import CameraNameOption, ForceOption, JsonOption, Output, QuietOption
from omniservo.errors import InputError, NoSolutionError

if TYPE_CHECKING:
    from scipy.spatial.transform import RigidTransform

    from omniservo.calibration.hand_eye import ImageHandEye

_BOARD = "checkerboard:9x6:0.0236 (inner corners, square in m), charuco:…, aprilgrid:…, circles:…"
_POSES = "The robot's poses base_T_flange (YAML, JSON, CSV), or ViSP's files with %d for the number."


def calibrate_hand_eye(
    images: Annotated[list[Path], typer.Argument(help="One image at each pose of the robot.")],
    poses: Annotated[str, typer.Option("--poses", help=_POSES)],
    camera: Annotated[str, typer.Option("--camera", help="The camera's calibration, or a preset.")],
    camera_name: CameraNameOption = None,
    size: SizeOption = None,
    model: ModelOption = None,
    max_angle: MaxAngleOption = None,
    camera_error: CameraErrorOption = None,
    board: Annotated[str | None, typer.Option("--board", help=_BOARD)] = None,
    target: Annotated[
        Path | None, typer.Option("--target", help="Target file: tags of known size and place.")
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", help="Write flange_T_camera here (JSON).")] = None,
    report: Annotated[Path | None, typer.Option("--report", help="Write a report here (HTML).")] = None,
    force: ForceOption = False,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Eye-in-hand calibration: the camera's pose on the flange, from images of a fixed board."""
    from omniservo.calibration import board_from_text
    from omniservo.calibration.hand_eye import calibrate_hand_eye_images, load_robot_poses
    from omniservo.files import writable
    from omniservo.reporting import write_hand_eye_report
    from omniservo.targets import Target

    for path in (out, report):
        if path is not None:
            writable(path, force=force)
    if (board is None) == (target is None):
        raise InputError("calibrate-hand-eye: give --board or --target, one of them")
    looked_for = Target.load(target) if target is not None else board_from_text(board or "")
    base_T_flange = load_robot_poses(poses).of_images(images)
    output = Output(as_json, quiet)
    with output.working("looking for the board") as say:
        opened = open_model(camera, camera_name, size, model, max_angle, camera_error)
        found = calibrate_hand_eye_images(opened, base_T_flange, images, looked_for, progress=say)
    if report is not None:
        write_hand_eye_report(found, report, force=force)
        output.written(report)
    result = found.result
    if result.flange_T_camera is None:
        raise NoSolutionError(f"hand-eye calibration: {result.status}: {result.message}")
    if out is not None:
        result.save(out, force=force)
        output.written(out)
    for line in _lines(found, result.flange_T_camera):
        output.line(line)
    output.result(_fields(found))


def _lines(found: ImageHandEye, flange_T_camera: RigidTransform) -> Iterator[str]:
    """Yield what a person wants to know."""
    result = found.result
    sigma = np.sqrt(np.diag(result.covariance))
    yield f"translation {_spelled(1e3 * flange_T_camera.translation)} ± {_spelled(1e3 * sigma[:3])} mm"
    turn = flange_T_camera.rotation.as_rotvec(degrees=True)
    yield f"rotation vector {_spelled(turn)} ± {_spelled(np.degrees(sigma[3:]))} deg (of the camera)"
    rms, worst = ((1e3 * m, math.degrees(rad)) for m, rad in (result.scatter_rms, result.scatter_worst))
    yield (
        f"the board by each view alone: {rms[0]:.2f} mm, {rms[1]:.3f} deg rms;"
        f" worst {worst[0]:.2f} mm, {worst[1]:.3f} deg"
    )
    yield (
        f"the robot's poses are off by {1e3 * result.robot_position_m:.2f} mm and"
        f" {math.degrees(result.robot_rotation_rad):.3f} deg per axis; corners by {result.noise_px:.3f} px"
    )
    if result.board_size_disputed:
        yield (
            f"the board seems {result.board_scale:.4f} ± {result.board_scale_sigma:.4f} times as large as"
            " stated: measure its squares"
        )
    yield f"{len(result.used)} of {len(found.images)} images used"
    for image, view in zip(found.images, result.views, strict=True):
        if not view.used:
            yield f"{image}: not used: {view.reason}"


def _fields(found: ImageHandEye) -> dict[str, Any]:
    result = found.result
    return {
        "status": result.status,
        **result.to_dict(),
        "board_size_disputed": result.board_size_disputed,
        "scatter_rms_m": result.scatter_rms[0],
        "scatter_rms_rad": result.scatter_rms[1],
        "scatter_worst_m": result.scatter_worst[0],
        "scatter_worst_rad": result.scatter_worst[1],
        "images": [
            {
                "image": str(image),
                "used": view.used,
                "reason": view.reason,
                "corners": view.corners,
                "position_m": view.position_m,
                "rotation_rad": view.rotation_rad,
                "own_rms_px": view.own_rms_px,
                "loop_rms_px": view.loop_rms_px,
            }
            for image, view in zip(found.images, result.views, strict=True)
        ],
        "seconds": result.seconds,
    }


def _spelled(numbers: np.ndarray[Any, Any]) -> str:
    return np.array2string(numbers, precision=3, suppress_small=True)
