"""From images of a board to a camera: find the board in each, calibrate, look again with the camera."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from omniservo.calibration.adjustment import Calibration, calibrate_camera
from omniservo.calibration.boards import Board, BoardView, CircleGrid, find_board
from omniservo.cameras import UnifiedCamera
from omniservo.errors import InputError, NoSolutionError
from omniservo.field_docs import with_field_docs
from omniservo.files.image_files import copies_of, image_size, read_grey_image

MOST_IMAGES = 2000

Progress = Callable[[str, float], object]
"""Called with what is being done, and about what share of the job is behind."""

_FIRST_LOOK, _LOOKS, _AGAIN, _LAST = 0.8, 0.4, 0.5, 0.9
"""Shares of the job: looking takes most of it, and circles are all looked for twice."""


@with_field_docs
@dataclass(frozen=True, eq=False)
class ImageCalibration:
    """A calibration and what was seen in each image."""

    board: Board
    images: tuple[Path, ...]
    size: tuple[int, int]
    """(width, height) of every image [px]"""
    views: tuple[BoardView, ...]
    """what was found in each image"""
    calibrated: tuple[int, ...]
    """places in ``images`` of the views that the calibration was given, in its order"""
    calibration: Calibration
    mirrored: bool
    """whether the camera looks into a mirror; then one focal length is negative"""

    @property
    def camera(self) -> UnifiedCamera | None:
        """The camera, of the mirror image where ``mirrored``; None where there is none."""
        if self.calibration.camera is None:
            return None
        return self.calibration.mirrored() if self.mirrored else self.calibration.camera

    def not_used(self) -> dict[int, str]:
        """Return image → why it is not used, for every image that is not."""
        reasons = {i: view.reason for i, view in enumerate(self.views) if not view.found}
        dropped = self.calibration.views_dropped
        return reasons | {self.calibrated[k]: reason for k, reason in dropped.items()}


def calibrate_images(
    images: Sequence[str | Path],
    board: Board,
    *,
    distortion: Literal["auto", "none", "radtan"] = "auto",
    mirrored: bool | None = None,
    progress: Progress = lambda stage, done: None,
) -> ImageCalibration:
    """Return the camera that took these images of a board.

    Circles, whose centres a first camera corrects, and images in which nothing was found are checked once
    more with that camera. A file that is the copy of an earlier one is not used: it says nothing more, and
    counted twice it would make the result look surer than it is.

    Args:
        images: files, all of one size.
        board: what they show.
        distortion: see `calibrate_camera`.
        mirrored: whether the camera looks into a mirror; None: what the boards say, which checkerboards and
            circles cannot.
        progress: called with what is being done, and about what share of the job is behind.

    Raises:
        InputError: a file that is no image, images of different sizes, none or too many.
        NoSolutionError: the board is in none of the images.
    """
    paths = tuple(Path(image) for image in images)
    if not 1 <= len(paths) <= MOST_IMAGES:
        raise InputError(f"images: {len(paths)} given; legal: 1 to {MOST_IMAGES}")
    size = _common_size(paths)
    first = _LOOKS if isinstance(board, CircleGrid) else _FIRST_LOOK
    views = _look(paths, board, (), None, lambda stage, done: progress(stage, first * done))
    found = _calibrated(views, size, distortion, lambda stage: progress(stage, first))
    if found.camera is not None and (isinstance(board, CircleGrid) or any(not v.found for v in views)):
        rest = _LAST - max(first, _AGAIN)
        again = _look(
            paths,
            board,
            views,
            found.camera,
            lambda stage, done: progress(stage, _LAST - rest * (1.0 - done)),
        )
        better = _calibrated(again, size, distortion, lambda stage: progress(stage, _LAST))
        if better.camera is not None:
            views, found = again, better
    reflected = _mirrored(views) if mirrored is None else mirrored
    calibrated = tuple(i for i, view in enumerate(views) if view.found)
    return ImageCalibration(board, paths, size, tuple(views), calibrated, found, reflected)


def _common_size(paths: Sequence[Path]) -> tuple[int, int]:
    """Return the images' (width, height).

    Raises:
        InputError: they differ: it names the first that is not of the most frequent size.
    """
    sizes = [image_size(path) for path in paths]
    size, _ = Counter(sizes).most_common(1)[0]
    for path, other in zip(paths, sizes, strict=True):
        if other != size:
            raise InputError(f"{path}: {other[0]}×{other[1]} px; the other images have {size[0]}×{size[1]}")
    return size


def _look(
    paths: Sequence[Path],
    board: Board,
    known: Sequence[BoardView],
    camera: UnifiedCamera | None,
    progress: Progress,
) -> list[BoardView]:
    views = []
    copied = copies_of(paths)
    for i, path in enumerate(paths):
        progress(f"looking for the board: {i + 1} of {len(paths)}", i / len(paths))
        if i in copied:
            views.append(BoardView.nothing(f"a copy of {copied[i]}"))
        elif known and known[i].found and not isinstance(board, CircleGrid):
            views.append(known[i])
        else:
            views.append(find_board(read_grey_image(path), board, camera))
    return views


def _calibrated(
    views: Sequence[BoardView],
    size: tuple[int, int],
    distortion: Literal["auto", "none", "radtan"],
    progress: Callable[[str], object],
) -> Calibration:
    found = [view for view in views if view.found]
    if not found:
        reason, count = Counter(view.reason for view in views).most_common(1)[0]
        raise NoSolutionError(
            f"the board is in none of the {len(views)} images; in {count} of them: {reason}"
        )
    progress(f"calibrating from {len(found)} views")
    return calibrate_camera(
        [np.asarray(view.pixels) for view in found],
        [np.asarray(view.object_points) for view in found],
        size,
        distortion=distortion,
    )


def _mirrored(views: Sequence[BoardView]) -> bool:
    """Tell whether most of the boards that can tell show their mirror image."""
    said = [view.mirrored for view in views if view.found and view.mirrored is not None]
    return sum(said) > len(said) / 2
