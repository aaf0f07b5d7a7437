"""From images and robot poses to the camera's place on the flange."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.calibration.boards import Board, find_board
from omniservo.calibration.hand_eye.calibrate_hand_eye import calibrate_hand_eye
from omniservo.calibration.hand_eye.hand_eye import HandEye
from omniservo.calibration.hand_eye.robot_poses import checked_poses
from omniservo.cameras.models import CentralModel
from omniservo.errors import InputError
from omniservo.field_docs import with_field_docs
from omniservo.files.image_files import copies_of, read_grey_image
from omniservo.geometry.arrays import ByteArray, FloatArray
from omniservo.perception import find_tags
from omniservo.renamed import renamed_arguments
from omniservo.targets import Target

_LOOKS = 0.9
"""share of the job that looking for the boards takes"""

_SAME = 1e-6
"""of the board's extent: how near a turned board's points are to its own"""


@with_field_docs
@dataclass(frozen=True, eq=False)
class ImageHandEye:
    """A hand-eye calibration and the images that it is from."""

    camera: CentralModel
    images: tuple[Path, ...]
    corners: tuple[FloatArray, ...]
    """of each image (k, 2) [px] what was found"""
    result: HandEye


@dataclass(frozen=True, eq=False)
class _Found:
    pixels: FloatArray
    points: FloatArray
    reason: str = ""
    turnable: bool = False


@renamed_arguments(base_T_tool="base_T_flange")
def calibrate_hand_eye_images(
    camera: CentralModel,
    base_T_flange: RigidTransform | Sequence[RigidTransform] | npt.ArrayLike,
    images: Sequence[str | Path],
    target: Board | Target,
    *,
    progress: Callable[[str, float], object] = lambda stage, done: None,
) -> ImageHandEye:
    """Return where the camera sits on the flange, from one image at each pose; see `calibrate_hand_eye`.

    A file that is the copy of an earlier one is not used, as in `omniservo.calibration.calibrate_images`.

    Args:
        camera: took the images.
        base_T_flange: n poses as the robot reports them.
        images: n files, in the same order.
        target: what stands still in front of the arm: a board, or tags of known size and place.
        progress: called with what is being done, and about what share of the job is behind.

    Raises:
        InputError: other numbers of poses and images, no image, another size than the camera's, no target.
    """
    poses = checked_poses(base_T_flange)
    if len(images) != len(poses):
        raise InputError(f"images: {len(images)} given for {len(poses)} poses; one each is needed")
    paths = tuple(Path(image) for image in images)
    found, copied = [], copies_of(paths)
    for i, path in enumerate(paths):
        progress(f"looking for the board: {i + 1} of {len(paths)}", _LOOKS * i / len(paths))
        if i in copied:
            found.append(_Found(np.empty((0, 2)), np.empty((0, 3)), f"a copy of {copied[i]}"))
            continue
        try:
            found.append(_look(read_grey_image(path), camera, target))
        except InputError as error:
            raise InputError(str(error) if str(error).startswith(str(path)) else f"{path}: {error}") from None
    turns = turns_of(target) if isinstance(target, Board) and any(seen.turnable for seen in found) else ()
    progress(f"calibrating from {sum(len(seen.pixels) > 0 for seen in found)} views", _LOOKS)
    result = calibrate_hand_eye(
        camera, poses, [seen.pixels for seen in found], [seen.points for seen in found], turns=turns
    )
    views = tuple(
        replace(view, reason=seen.reason) if seen.reason else view
        for view, seen in zip(result.views, found, strict=True)
    )
    message, said = result.message, Counter(seen.reason for seen in found if seen.reason).most_common(1)
    if result.status == "too_few_views" and said:
        message += f"; in {said[0][1]} of the images: {said[0][0]}"
    result = replace(result, views=views, message=message)
    return ImageHandEye(camera, paths, tuple(seen.pixels for seen in found), result)


def _look(image: ByteArray, camera: CentralModel, target: Board | Target) -> _Found:
    if isinstance(target, Board):
        view = find_board(image, target, camera)
        return _Found(view.pixels, view.object_points, view.reason, view.turnable)
    if not target.tags:
        raise InputError("target: no tags; a board, or a target with tags is needed")
    pixels, points = [np.empty((0, 2))], [np.empty((0, 3))]
    for dictionary in target.dictionaries:
        tags = find_tags(image, camera, dictionary)
        places, known = target.corners_of((4 * tags.ids[:, None] + np.arange(4)).ravel(), dictionary)
        pixels.append(tags.corners.reshape(-1, 2)[known])
        points.append(places[known])
    together = _Found(np.concatenate(pixels), np.concatenate(points))
    return (
        together if len(together.pixels) else replace(together, reason="none of the target's tags was found")
    )


def turns_of(board: Board) -> tuple[RigidTransform, ...]:
    """Return the quarter and half turns that bring a board's points onto themselves."""
    middle = 0.5 * (board.points.min(axis=0) + board.points.max(axis=0))
    turns = []
    for quarters in (1, 2, 3):
        rotation = Rotation.from_rotvec([0.0, 0.0, 0.5 * np.pi * quarters])
        turn = RigidTransform.from_components(middle - rotation.apply(middle), rotation)
        away = np.linalg.norm(turn.apply(board.points)[:, None] - board.points, axis=2).min(axis=1)
        if away.max() < _SAME * np.ptp(board.points):
            turns.append(turn)
    return tuple(turns)
