"""Motion and structure from two images: files, or those of a task's own cell."""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from scipy.spatial.transform import RigidTransform

from omniservo.camera_files import named_model
from omniservo.cameras.models import CentralModel
from omniservo.errors import InputError
from omniservo.estimation import TwoViewEstimate, estimate_two_view
from omniservo.files.image_files import read_grey_image
from omniservo.geometry.arrays import ByteArray
from omniservo.results.run_result import Seen
from omniservo.robots import next_image
from omniservo.runs.estimate_task import estimate_on_target, estimate_task
from omniservo.runs.feature_kind_of import KindName, feature_kind, feature_kind_of
from omniservo.runs.in_view import require_in_view
from omniservo.runs.robot_cell import OpenCell
from omniservo.runs.see import see
from omniservo.runs.teach_goal import teach_goal
from omniservo.targets import Target
from omniservo.tasks import Task, load_task


@dataclass(frozen=True, eq=False)
class EstimatedImages:
    """Two images with what was seen in both and what follows from it."""

    seen: Seen
    estimate: TwoViewEstimate


def estimate_images(
    camera: str | CentralModel,
    initial: Path,
    goal: Path,
    *,
    features: KindName = "dots",
    dictionary: str | None = None,
    target: Path | None = None,
    displacement: float | None = None,
    planar: bool = False,
) -> EstimatedImages:
    """Return what two image files say.

    Args:
        camera: a calibration file, a preset's name, or a camera, of any model.
        initial: the initial image.
        goal: the goal image.
        features: what is looked for.
        dictionary: of the tags.
        target: a target file: tags whose sizes and places are known make the estimate metric.
        displacement: distance between the two camera centres [m].
        planar: the target is a plane: motion from its homography.

    Raises:
        InputError: a file that is not what it should be, or too few features.
        NoSolutionError: the features cannot be matched.
    """
    model = named_model(camera) if isinstance(camera, str) else camera
    known = None if target is None else Target.load(target)
    if known is not None and displacement is not None:
        raise InputError("displacement, target: both given; one of them gives the scale")
    if known is not None and planar:
        raise InputError("planar, target: both given; a known target need not be told to be flat")
    kind = feature_kind(features, dictionary, known)
    seen = see(kind, model, read_image(initial, model), read_image(goal, model))
    if known is not None:
        metric = estimate_on_target(model, seen.matched, known, dictionary)
        return EstimatedImages(seen, replace(metric, camera=model))
    matched = seen.matched
    method: Literal["pixel", "homography"] = "homography" if planar else "pixel"
    found = estimate_two_view(
        model,
        matched.initial,
        matched.goal,
        scale=displacement,
        noise=matched.noise,
        method=method,
        squares=matched.squares,
        windows=matched.window,
    )
    return EstimatedImages(seen, replace(found, camera=model))


def estimate_in_cell(
    task: str | Task, open_cell: OpenCell, *, camera: str | CentralModel | None = None, seed: int = 0
) -> EstimatedImages:
    """Return what a task's own two images say, taken in its cell; ``camera`` as `load_task` has it.

    Raises:
        InputError, NoSolutionError: as `run_task`.
    """
    loaded = task if isinstance(task, Task) else load_task(task, camera=camera)
    require_in_view(loaded, RigidTransform.identity(), "the initial image")
    with closing(open_cell(loaded, seed + 1)) as cell:
        goal = teach_goal(loaded, cell)
    with closing(open_cell(loaded, seed)) as cell:
        image, joints = next_image(cell.camera, cell.wait), cell.driver.read().joint_positions
    seen = see(feature_kind_of(loaded), loaded.camera, image.pixels, goal.image)
    found = estimate_task(loaded, cell.scene, seen, goal, joints)
    return EstimatedImages(seen, found)


def read_image(path: Path, camera: CentralModel) -> ByteArray:
    """Return an image file as grey values (height, width).

    Raises:
        InputError: not an image, or not of the camera's size.
    """
    image = read_grey_image(path)
    if image.shape != (camera.height, camera.width):
        raise InputError(
            f"{path}: {image.shape[1]}×{image.shape[0]} px; the camera has {camera.width}×{camera.height}"
        )
    return image
