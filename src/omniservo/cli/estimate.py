"""``omniservo estimate``."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, NamedTuple

import typer

from omniservo.cli.camera_options import (
    CameraErrorOption,
    CameraOptions,
    LargestOption,
    MaxAngleOption,
    ModelOption,
    SizeOption,
)
from omniservo.cli.completion import camera_names, task_names
from omniservo.cli.estimate_views import (
    EdgeOption,
    LengthOption,
    Lengths,
    MountOption,
    PosesOption,
    estimate_views_of,
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
    from omniservo.runs.estimate_images import EstimatedImages

WhatArgument = Annotated[
    list[str] | None,
    typer.Argument(
        help="A shipped task or a YAML file; or images of a target that stands still, in any order.",
        autocompletion=task_names,
    ),
]
FeaturesOption = Annotated[
    Literal["dots", "tags", "natural"], typer.Option("--features", help="What to look for in the images.")
]
DictionaryOption = Annotated[
    str | None, typer.Option("--dictionary", help="Of the tags, as tag36h11, 4x4_50 or tagStandard41h12.")
]
CameraOption = Annotated[
    str | None,
    typer.Option(
        "--camera",
        help="Calibration of the two images, or replaces the task's.",
        autocompletion=camera_names,
    ),
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
"""A camera that moved farther than this [m] was probably stated in mm."""


def estimate(
    what: WhatArgument = None,
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
    asked = CameraOptions(camera, camera_name, size, model, max_angle, largest_px, camera_error)
    lengths = Lengths(length, tag_edge, poses, mount)
    _say_far(output, displacement)
    if what and len(what) > 1 and (len(what) > TWO or lengths.any):
        if planar or report is not None or initial is not None or goal is not None:
            raise InputError("estimate: --initial, --goal, --planar and --report are for two images")
        scale = lengths.scale(displacement, target)
        estimate_views_of(output, asked.opened(), what, (features, dictionary), scale, out, force)
        return
    task, pair = _task_or_pair(what, (initial, goal), lengths)
    kind = _Kind(features, dictionary, target, displacement, planar)
    _check_files(task, camera, *pair)
    found = _estimated(output, asked, task, pair, kind, (package, allow_outside, seed))
    if report is not None:
        with output.working("writing the report"):
            from omniservo.reporting import write_estimate_report

            write_estimate_report(found.seen, found.estimate, report, force=force)
        output.written(report)
    if out is not None:
        found.estimate.save(out, force=force)
        output.written(out)
    _say(output, found.estimate, "" if report else "--report FILE.html shows the matches")


class _Kind(NamedTuple):
    """What is said of two images."""

    features: Literal["dots", "tags", "natural"]
    dictionary: str | None
    target: Path | None
    displacement: float | None
    planar: bool

    @property
    def is_said(self) -> bool:
        """Whether anything is."""
        rest = (self.dictionary, self.target, self.displacement)
        return self.features != "dots" or any(x is not None for x in rest) or self.planar


_Pair = tuple[Path | None, Path | None]


def _task_or_pair(what: list[str] | None, pair: _Pair, lengths: Lengths) -> tuple[str | None, _Pair]:
    """Return the task, or the two images, that the arguments and options name."""
    if lengths.any:
        raise InputError("estimate: --length, --tag-edge, --poses and --mount need images: IMAGE IMAGE …")
    if what is None or len(what) < TWO:
        return what[0] if what else None, pair
    if pair != (None, None):
        raise InputError("estimate: two images and --initial or --goal given; give one pair")
    return None, (Path(what[0]), Path(what[1]))


def _estimated(
    output: Output,
    asked: CameraOptions,
    task: str | None,
    pair: _Pair,
    kind: _Kind,
    said: tuple[list[str] | None, bool, int],
) -> EstimatedImages:
    """Return what a task's own images, or two files, say; ``said``: packages, outside files, seed."""
    initial, goal = pair
    with output.working("loading") as progress:
        from omniservo.runs import estimate_images, estimate_in_cell
        from omniservo.simulation import SimulatedCell
        from omniservo.tasks import load_task

        progress("estimating")
        camera, (package, allow_outside, seed) = asked.opened(), said
        if task is not None and pair == (None, None) and not kind.is_said:
            known = packages_of(package)
            loaded = load_task(task, camera=camera, packages=known, allow_outside=allow_outside)
            return estimate_in_cell(loaded, SimulatedCell, seed=seed)
        if task is None and camera is not None and initial is not None and goal is not None:
            return estimate_images(camera, initial, goal, **kind._asdict())
    raise InputError(_NEEDED)


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


def _say(output: Output, result: TwoViewEstimate, next_step: str) -> None:
    output.result(result.to_dict())
    if result.initial_T_goal is None:
        reason = f"motion and structure cannot be estimated: {result.status}: {result.message}"
        raise answer_is_no(reason, next_step)
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
