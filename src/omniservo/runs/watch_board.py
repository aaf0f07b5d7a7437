"""Watches a camera's images for a board, and keeps those that a calibration needs."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from omniservo.calibration import find_board
from omniservo.calibration.boards import Board
from omniservo.calibration.view_choice import MOST_KEPT, Judgement, ViewChoice
from omniservo.errors import InvalidData, ServoStop
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import ByteArray
from omniservo.hardware.camera_sources import NewestFrame
from omniservo.robots import CameraSource

PATIENCE = 10.0
"""Without a new image for so long, watching ends [s]."""

_TICK = 2e-3
_NO_SIZE = (3, 3)
"""until there is a first image"""


@with_field_docs
@dataclass
class Watch:
    """What was seen so far."""

    choice: ViewChoice
    images: list[ByteArray] = field(default_factory=list)
    """those kept, (height, width) each"""
    looked_at: int = 0
    """images in which the board was looked for"""
    last: Judgement = field(default_factory=lambda: Judgement(False, "no image"))
    """what became of the newest image"""
    ended: str = ""
    """why watching ended"""


def watch_board(
    camera: CameraSource,
    board: Board,
    *,
    tell: Callable[[Watch], None] = lambda _: None,
    stopped: Callable[[], bool] = lambda: False,
    seconds: float | None = None,
) -> Watch:
    """Look for a board in a camera's images until nothing is missing; images meanwhile are passed over.

    Args:
        camera: its images, all of one size.
        board: what to look for.
        tell: called after each image.
        stopped: called between images; True ends it.
        seconds: at most so long [s].

    Returns:
        What was kept, and why it ended: also a camera that is lost ends it, and no more.
    """
    watch, newest = Watch(ViewChoice(_NO_SIZE)), -math.inf
    begin = heard = time.monotonic()
    while not watch.ended:
        now = time.monotonic()
        if stopped():
            watch.ended = "stopped"
        elif seconds is not None and now - begin >= seconds:
            watch.ended = f"{seconds:g} s are over"
        elif now - heard > PATIENCE:
            watch.ended = f"no image for {PATIENCE:g} s"
        if watch.ended:
            break
        try:
            over = isinstance(camera, NewestFrame) and camera.over
            image = camera.image()
            if image is not None and image.time > newest:
                newest = image.time
                _look(watch, np.asarray(image.pixels), board)
                heard = time.monotonic()
                tell(watch)
                watch.ended = _enough(watch)
            elif over:
                watch.ended = "the source has no more images"
            else:
                time.sleep(_TICK)
        except ServoStop as error:
            watch.ended = str(error)
    return watch


def _enough(watch: Watch) -> str:
    """Say why no more images are needed; empty: they are."""
    if not watch.choice.missing():
        return "nothing is missing"
    return f"{MOST_KEPT} images are kept" if len(watch.images) == MOST_KEPT else ""


def _look(watch: Watch, pixels: ByteArray, board: Board) -> None:
    """Look for the board in one image.

    Raises:
        InvalidData: it has another size than those before.
    """
    size = pixels.shape[1], pixels.shape[0]
    if not watch.looked_at:
        watch.choice = ViewChoice(size)
    elif size != watch.choice.size:
        raise InvalidData(f"image of {size[0]}×{size[1]} px; before: {watch.choice.size}")
    watch.looked_at += 1
    watch.choice.light(pixels)
    watch.last = watch.choice.judge(find_board(pixels, board))
    if watch.last.kept:
        watch.images.append(pixels.copy())
