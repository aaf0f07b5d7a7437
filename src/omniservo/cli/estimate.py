"""``omniservo estimate``."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from omniservo.cli.camera_options import (
    CameraAsked,
    CameraErrorOption,
    LargestOption,
    MaxAngleOption,
    ModelOption,
    SizeOption,
)
from omniservo.cli.estimate_views import (
    EdgeOption,
    LengthOption,
    MountOption,
    PosesOption,
    estimate_views_of,
    scale_of,
)
from omniservo.cli.output import (
    CameraNameOption,
    ForceOption,
    JsonOption,
    Output,
    QuietOption,
    SeedOption,
    answer_is_no,
)
from omniservo.cli.robot_options import AllowOutsideOption, PackageOption, packages_of
from omniservo.errors import InputError
from omniservo.files import require_file, writable
from omniservo.shipped_tasks import task_file

if TYPE_CHECKING:
    from scipy.spatial.transform import RigidTransform

    from omniservo.estimation import TwoViewEstimate
    from omniservo.estimation.uncertainty.joint_uncertainty import JointUncertainty
    from omniservo.geometry.arrays import FloatArray

FeaturesOption = Annotated[
    Literal["dots", "tags", "natural"], typer.Option("--features", help="What to look for in the images.")
]
DictionaryOption = Annotated[
    str | None, typer.Option("--dictionary", help="Of the tags, as tag36h11, 4x4_50 or tagStandard41h12.")
]
CameraOption = Annotated[
    str | None, typer.Option("--camera", help="Calibration of the two images, or replaces the task's.")
]
TargetOption = Annotated[
    Path | None, typer.Option("--target", help="Target file: tags of known size and place.")
]
DisplacementOption = Annotated[
    float | None, typer.Option("--displacement", help="Between the two camera centres, in metres.")
]
_NEEDED = "estimate: give a TASK alone, or --camera, --initial and --goal, or --camera and IMAGE IMAGE …"


TWO = 2
_FAR = 20.0
"""A camera that moved farther than this [m] was probably told of in mm."""


def estimate(
    what: Annotated[
        list[str] | None,
        typer.Argument(
            help="A shipped task or a YAML file; or images of a target that stands still, in any order."
        ),
    ] = None,
    camera: CameraOption = None,
    camera_name: CameraNameOption = None,
    size: SizeOption = None,
    model: ModelOption = None,
    max_angle: MaxAngleOption = None,
    largest_px: LargestOption = None,
    camera_error: CameraErrorOption = None,
    initial: Annotated[Path | None, typer.Option("--initial", help="The initial image.")] = None,
    goal: Annotated[Path | None, typer.Option("--goal", help="The goal image.")] = None,
    features: FeaturesOption = "dots",
    dictionary: DictionaryOption = None,
    target: TargetOption = None,
    displacement: DisplacementOption = None,
    length: LengthOption = None,
    tag_edge: EdgeOption = None,
    poses: PosesOption = None,
    mount: MountOption = None,
    planar: Annotated[bool, typer.Option("--planar", help="The target is a plane.")] = False,
    report: Annotated[Path | None, typer.Option("--report", help="Write an HTML report here.")] = None,
    out: Annotated[Path | None, typer.Option("--out", help="Write the estimate here (JSON).")] = None,
    package: PackageOption = None,
    allow_outside: AllowOutsideOption = False,
    seed: SeedOption = 0,
    force: ForceOption = False,
    as_json: JsonOption = False,
    quiet: QuietOption = False,
) -> None:
    """Estimate the camera's motion and the target's structure from two images, or from more."""
    output = Output(as_json, quiet)
    for path in filter(None, (out, report)):
        writable(path, force=force)
    asked = CameraAsked(camera, camera_name, size, model, max_angle, largest_px, camera_error)
    task = what[0] if what and len(what) == 1 else None
    more = length is not None or tag_edge is not None or poses is not None or mount is not None
    if what and len(what) > 1 and (len(what) > TWO or more):
        if planar or report is not None or initial is not None or goal is not None:
            raise InputError("estimate: --initial, --goal, --planar and --report are for two images")
        replacement = asked.opened()
        if replacement is None:
            raise InputError("camera: missing; images need --camera")
        _say_far(output, displacement)
        estimate_views_of(
            output,
            replacement,
            [Path(image) for image in what],
            (features, dictionary),
            scale_of(displacement, length, tag_edge, target, poses, mount),
            out,
            force,
        )
        return
    if more:
        raise InputError("estimate: --length, --tag-edge, --poses and --mount need images: IMAGE IMAGE …")
    if what and len(what) == TWO:
        if initial is not None or goal is not None:
            raise InputError("estimate: two images and --initial or --goal given; give one pair")
        initial, goal = (Path(image) for image in what)
    images = initial is not None or goal is not None
    of_images = features != "dots" or any(x is not None for x in (dictionary, target, displacement)) or planar
    _check_files(task, camera, initial, goal)
    with output.working("loading") as progress:
        from omniservo.reporting import write_estimate_report
        from omniservo.runs import estimate_images, estimate_in_cell
        from omniservo.simulation import SimulatedCell
        from omniservo.tasks import load_task

        progress("estimating")
        replacement, known = asked.opened(), packages_of(package)
        if task is not None and not images and not of_images:
            loaded = load_task(task, camera=replacement, packages=known, allow_outside=allow_outside)
            found = estimate_in_cell(loaded, SimulatedCell, seed=seed)
        elif task is None and replacement is not None and initial is not None and goal is not None:
            found = estimate_images(
                replacement, initial, goal, features=features, dictionary=dictionary, target=target,
                displacement=displacement, planar=planar,
            )  # fmt: skip
        else:
            raise InputError(_NEEDED)
    if report is not None:
        write_estimate_report(found.seen, found.estimate, report, force=force)
        output.written(report)
    if out is not None:
        found.estimate.save(out, force=force)
        output.written(out)
    _say_far(output, displacement)
    _say(output, found.estimate)


def _check_files(task: str | None, camera: str | None, *images: Path | None) -> None:
    """Raise InputError where one of these is not there, before anything is loaded."""
    if task is None and None in (camera, *images):
        raise InputError(_NEEDED)
    if task is not None:
        task_file(task)
    for image in filter(None, images):
        require_file(image)


def _say_far(output: Output, displacement: float | None) -> None:
    """Ask back where millimetres may have been meant."""
    if displacement is not None and displacement > _FAR:
        output.line(
            f"notice: a displacement of {displacement:g} m; {displacement:g} mm are {displacement / 1000:g}"
        )


def _say(output: Output, result: TwoViewEstimate) -> None:
    output.result(result.to_dict())
    if result.initial_T_goal is None:
        raise answer_is_no(f"motion and structure cannot be estimated: {result.status}: {result.message}")
    for line in _lines(result, result.initial_T_goal):
        output.line(line)


def _lines(result: TwoViewEstimate, initial_T_goal: RigidTransform) -> Iterator[str]:
    """Yield what a person wants to know of an estimate with a pose."""
    import numpy as np

    unit = "m" if result.is_metric else "(length 1: no scale was given)"
    turn = initial_T_goal.rotation.as_rotvec(degrees=True)
    yield f"translation {np.array2string(initial_T_goal.translation, precision=5)} {unit}"
    yield f"rotation vector {np.array2string(turn, precision=4)} deg"
    if result.uncertainty is not None:
        yield _parts(result.uncertainty, initial_T_goal)
    if result.message:
        yield f"notice: {result.message}"
    yield f"{int(result.inliers.sum())} of {len(result.inliers)} points, rms {result.rms_px:.3f} px"


def _parts(law: JointUncertainty, initial_T_goal: RigidTransform) -> str:
    """Say how uncertain rotation and direction are, and how much of it pixels and camera bring."""
    import numpy as np

    across = np.linalg.svd(initial_T_goal.translation[None])[2][1:].T
    length = float(np.linalg.norm(initial_T_goal.translation))

    def degrees(rows: FloatArray) -> tuple[float, float]:
        turn, swing = np.square(rows[:, 3:6]).sum() / 3.0, np.square(rows[:, :3] @ across).sum() / 2.0
        return math.degrees(math.sqrt(turn)), math.degrees(math.sqrt(swing) / length)

    pixels, camera = math.sqrt(law.inflation) * law.noise, law.calibration
    whole = degrees(np.concatenate((pixels, camera)))
    of_pixels, of_camera = degrees(pixels), degrees(camera)
    rotation, direction = (
        f"{whole[k]:.2g} deg (pixels {of_pixels[k]:.2g}, camera {of_camera[k]:.2g})" for k in range(2)
    )
    return f"1 sigma an axis: rotation {rotation}, direction {direction}"
