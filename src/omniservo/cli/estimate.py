"""``omniservo estimate``."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from mimetypes import guess_type
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from omniservo.cli.camera_options import LargestOption, LensOptions
from omniservo.cli.completion import camera_names, task_names
from omniservo.cli.estimate_views import Features, Lengths, estimate_views_of
from omniservo.cli.grouped import grouped
from omniservo.cli.output import ForceOption, Output, SeedOption, answer_is_no
from omniservo.cli.robot_options import TaskOptions
from omniservo.errors import InputError
from omniservo.files import require_file, writable
from omniservo.shipped_tasks import task_file

if TYPE_CHECKING:
    from scipy.spatial.transform import RigidTransform

    from omniservo.estimation import TwoViewEstimate
    from omniservo.estimation.uncertainty.joint_uncertainty import JointUncertainty
    from omniservo.geometry.arrays import FloatArray
    from omniservo.runs import EstimatedViews
    from omniservo.runs.estimate_images import EstimatedImages

WhatArgument = Annotated[
    list[str] | None,
    typer.Argument(
        help="A shipped task or a YAML file; or images of a target that stands still, in any order.",
        autocompletion=task_names,
    ),
]
CameraOption = Annotated[
    str | None,
    typer.Option(
        "--camera",
        help="Calibration of the two images, or replaces the task's.",
        autocompletion=camera_names,
    ),
]
_NEEDED = "estimate: give a TASK alone, or --camera, --initial and --goal, or --camera and IMAGE IMAGE …"


TWO = 2
_FAR = 20.0
"""A camera that moved farther than this [m] was probably stated in mm."""


@dataclass(frozen=True)
class _Kind:
    """What is said of two images."""

    features: Annotated[Features, typer.Option("--features", help="What to look for in the images.")] = "dots"
    dictionary: Annotated[
        str | None,
        typer.Option("--dictionary", help="Of the tags, as tag36h11, 4x4_50 or tagStandard41h12."),
    ] = None
    target: Annotated[
        Path | None, typer.Option("--target", help="Target file: tags of known size and place.")
    ] = None
    displacement: Annotated[
        float | None, typer.Option("--displacement", help="Between the two camera centres, in metres.")
    ] = None
    planar: Annotated[bool, typer.Option("--planar", help="The target is a plane.")] = False


@dataclass(frozen=True)
class _Results:
    """What is written."""

    report: Annotated[Path | None, typer.Option("--report", help="Write an HTML report here.")] = None
    out: Annotated[Path | None, typer.Option("--out", help="Write the estimate here (JSON).")] = None
    force: ForceOption = False

    def __post_init__(self) -> None:
        for path in filter(None, (self.out, self.report)):
            writable(path, force=self.force)


@grouped
def estimate(
    what: WhatArgument = None,
    *,
    camera: CameraOption = None,
    lens: LensOptions,
    largest_px: LargestOption = None,
    initial: Annotated[Path | None, typer.Option("--initial", help="The initial image.")] = None,
    goal: Annotated[Path | None, typer.Option("--goal", help="The goal image.")] = None,
    kind: _Kind,
    lengths: Lengths,
    results: _Results,
    files: TaskOptions,
    seed: SeedOption = 0,
    output: Output,
) -> None:
    """Estimate the camera's motion and the target's structure from two images, or from more."""
    _say_far(output, kind.displacement)
    if what and len(what) > 1 and (len(what) > TWO or lengths.any):
        if kind.planar or results.report is not None or initial is not None or goal is not None:
            raise InputError("estimate: --initial, --goal, --planar and --report are for two images")
        scale = lengths.scale(kind.displacement, kind.target)
        found = estimate_views_of(
            lens.opened_if_named(camera, largest_px), what, (kind.features, kind.dictionary), scale, output
        )
        if results.out is not None:
            _save_motion(found, results.out, output, force=results.force)
        return
    task, (first, second) = _task_or_pair(what, (initial, goal), lengths)
    _check_files(task, camera, first, second)
    with output.working("loading") as progress:
        progress("estimating")
        opened = lens.opened_if_named(camera, largest_px)
        if task is not None and first is None and second is None and kind == _Kind():
            from omniservo.runs import estimate_in_cell
            from omniservo.simulation import SimulatedCell

            seen = estimate_in_cell(files.load(task, opened), SimulatedCell, seed=seed)
        elif task is None and opened is not None and first is not None and second is not None:
            from omniservo.runs import estimate_images

            seen = estimate_images(opened, first, second, **asdict(kind))
        else:
            raise InputError(_NEEDED)
    _deliver(seen, results, output)


def _save_motion(found: EstimatedViews, out: Path, output: Output, *, force: bool) -> None:
    """Write the motion from the first to the last image; refuse where one of them is not joined."""
    for view in (0, -1):
        if found.estimate.initial_T_views[view] is None:
            status, reason = found.statuses()[view]
            raise answer_is_no(f"{out} is not written: {found.images[view]} has no pose: {status}: {reason}")
    found.two_view().save(out, force=force)
    output.written(out, ": the motion from the first to the last image")


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


def _deliver(found: EstimatedImages, results: _Results, output: Output) -> None:
    """Write what was found, and say it."""
    if results.report is not None:
        with output.working("writing the report"):
            from omniservo.reporting import write_estimate_report

            write_estimate_report(found.seen, found.estimate, results.report, force=results.force)
        output.written(results.report)
    if results.out is not None:
        found.estimate.save(results.out, force=results.force)
        output.written(results.out)
    _say(output, found.estimate, "" if results.report else "--report FILE.html shows the matches")


def _check_files(task: str | None, camera: str | None, *images: Path | None) -> None:
    """Raise InputError where one of these is not there, before anything is loaded."""
    if task is None and None in (camera, *images):
        raise InputError(_NEEDED)
    if task is not None:
        if (guess_type(task)[0] or "").startswith("image/"):
            raise InputError(f"{task}: a single image; {_NEEDED}")
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
