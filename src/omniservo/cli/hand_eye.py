"""``omniservo robot calibrate-hand-eye``."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from omniservo.cli.camera_options import LensOptions
from omniservo.cli.completion import camera_names
from omniservo.cli.grouped import grouped
from omniservo.cli.hand_eye_live import POSES, take_views
from omniservo.cli.live_views import LiveImages
from omniservo.cli.output import ForceOption, Output
from omniservo.cli.robot_file import RobotParts
from omniservo.cli.robot_options import AllowOutsideOption
from omniservo.errors import InputError, NoSolutionError
from omniservo.files import writable

if TYPE_CHECKING:
    from scipy.spatial.transform import RigidTransform

    from omniservo.calibration.boards import Board
    from omniservo.calibration.hand_eye import ImageHandEye
    from omniservo.cameras.models import CentralModel
    from omniservo.targets import Target

_BOARD = "checkerboard:9x6:0.0236 (inner corners, square in m), charuco:…, aprilgrid:…, circles:…"
_POSES = "The robot's poses base_T_flange (YAML, JSON, CSV), or ViSP's files with %d for the number."

_ON = "A robot file (YAML): take the views live, while you move the arm by hand or pendant."


@grouped
def calibrate_hand_eye(
    images: Annotated[
        list[Path] | None, typer.Argument(help="One image at each pose of the robot; or --on.")
    ] = None,
    *,
    poses: Annotated[str | None, typer.Option("--poses", help=_POSES)] = None,
    camera: Annotated[
        str | None,
        typer.Option("--camera", help="The camera's calibration, or a preset.", autocompletion=camera_names),
    ] = None,
    lens: LensOptions,
    board: Annotated[str | None, typer.Option("--board", help=_BOARD)] = None,
    target: Annotated[
        Path | None, typer.Option("--target", help="Target file: tags of known size and place.")
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", help="Write flange_T_camera here (JSON).")] = None,
    report: Annotated[Path | None, typer.Option("--report", help="Write a report here (HTML).")] = None,
    on: Annotated[Path | None, typer.Option("--on", help=_ON)] = None,
    parts: RobotParts,
    allow_outside: AllowOutsideOption = False,
    live: LiveImages,
    force: ForceOption = False,
    output: Output,
) -> None:
    """Eye-in-hand calibration: the camera's pose on the flange, from images of a fixed board.

    With --on the images are taken live and the joints read with each; nothing is commanded.
    """
    for path in (out, report):
        if path is not None:
            writable(path, force=force)
    with output.working("loading"):
        from omniservo.calibration.hand_eye import calibrate_hand_eye_images, load_robot_poses
        from omniservo.targets import Target

        looked_for = _looked_for(board, target)
        given = lens.opened_if_named(camera)
    if on is None:
        parts.refuse()
        files, opened, poses = _given(images, given, poses, live.save)
    else:
        if images or poses or given or isinstance(looked_for, Target):
            raise InputError("--on: goes without images, --poses, --camera and --target; it has its own")
        robot = parts.load(on, allow_outside=allow_outside)
        folder, driver = live.folder(out), parts.driver
        opened, files = take_views(
            robot, driver, looked_for, folder, output, seconds=live.seconds, force=force
        )
        poses = str(files[0].parent / POSES)
    base_T_flange = load_robot_poses(poses).of_images(files)
    with output.working("looking for the board") as say:
        found = calibrate_hand_eye_images(opened, base_T_flange, files, looked_for, progress=say)
    _deliver(found, out, report, output, force=force)


def _looked_for(board: str | None, target: Path | None) -> Board | Target:
    """Return what the images show.

    Raises:
        InputError: none of both is given, or both, or one is wrong.
    """
    from omniservo.calibration import board_from_text
    from omniservo.targets import Target

    if (board is None) == (target is None):
        raise InputError("calibrate-hand-eye: give --board or --target, one of them")
    return Target.load(target) if target is not None else board_from_text(board or "")


def _deliver(
    found: ImageHandEye, out: Path | None, report: Path | None, output: Output, *, force: bool
) -> None:
    """Write what was found, and say it.

    Raises:
        NoSolutionError: nothing was.
    """
    from omniservo.reporting import write_hand_eye_report

    if report is not None:
        with output.working("writing the report"):
            write_hand_eye_report(found, report, force=force)
        output.written(report)
    result = found.result
    if result.flange_T_camera is None:
        seen = "" if report else "; next: --report FILE.html shows every view"
        raise NoSolutionError(f"hand-eye calibration: {result.status}: {result.message}{seen}")
    if out is not None:
        result.save(out, force=force)
        output.written(out)
    for line in _lines(found, result.flange_T_camera):
        output.line(line)
    output.result(_fields(found))


def _given(
    images: list[Path] | None, lens: CentralModel | None, poses: str | None, save: Path | None
) -> tuple[list[Path], CentralModel, str]:
    """Return image files, the camera and the file of poses.

    Raises:
        InputError: one is not given, or what goes with a robot is.
    """
    if not images or lens is None or poses is None:
        raise InputError("calibrate-hand-eye: give images, --poses and --camera, or --on ROBOT.yaml")
    if save is not None:
        raise InputError("--save: goes with --on ROBOT.yaml")
    return images, lens, poses


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
