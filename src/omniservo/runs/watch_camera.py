"""Watches a camera's images for a board, and keeps those that a calibration needs."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from omniservo.calibration import find_board
from omniservo.calibration.boards import Board
from omniservo.calibration.hand_eye.pose_choice import PoseChoice
from omniservo.calibration.view_choice import MOST_KEPT, Judgement, ViewChoice
from omniservo.cameras.models import CentralModel
from omniservo.errors import InvalidData, ServoStop
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import ByteArray
from omniservo.hardware import ArmConnection
from omniservo.hardware.camera_sources import NewestFrame
from omniservo.robots import CameraImage, CameraSource

PATIENCE = 10.0
"""Without a new image for so long, watching ends [s]."""

_TICK = 2e-3
_NO_SIZE = (3, 3)
"""until there is a first image"""


class Choice(Protocol):
    """Which images are kept."""

    def look(self, image: CameraImage) -> Judgement:
        """Keep the next image, or not.

        Raises:
            ServoStop: there will be no more.
        """

    def missing(self) -> tuple[str, ...]:
        """Say what is still missing, each in words; nothing: empty."""

    def summary(self) -> tuple[str, ...]:
        """Say what is kept, a line each."""


@with_field_docs
@dataclass
class Watch:
    """What was seen so far."""

    choice: Choice
    images: list[ByteArray] = field(default_factory=list)
    """those kept, (height, width) each"""
    looked_at: int = 0
    """images in which the board was looked for"""
    last: Judgement = field(default_factory=lambda: Judgement(False, "no image"))
    """what became of the newest image"""
    ended: str = ""
    """why watching ended"""


def watch_camera(
    camera: CameraSource,
    choice: Choice,
    *,
    tell: Callable[[Watch], None] = lambda _: None,
    stopped: Callable[[], bool] = lambda: False,
    seconds: float | None = None,
) -> Watch:
    """Look at a camera's newest images until nothing is missing; those that come meanwhile are passed over.

    Args:
        camera: its images, all of one size.
        choice: which are kept.
        tell: called after each image.
        stopped: called between images; True ends it.
        seconds: at most so long [s].

    Returns:
        What was kept, and why it ended: also a camera that is lost ends it, and no more.
    """
    watch, newest = Watch(choice), -math.inf
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
                _look(watch, image)
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


def _look(watch: Watch, image: CameraImage) -> None:
    watch.last = watch.choice.look(image)
    watch.looked_at += 1
    if watch.last.kept:
        watch.images.append(np.array(image.pixels))


class BoardViews:
    """A `Choice` of a board's views, by what the image shows alone.

    Args:
        board: what is looked for.
    """

    def __init__(self, board: Board) -> None:
        self._board, self._size = board, _NO_SIZE
        self._views = ViewChoice(_NO_SIZE)

    def look(self, image: CameraImage) -> Judgement:
        """See Choice.

        Raises:
            InvalidData: it has another size than those before.
        """
        rows, columns = image.pixels.shape
        if self._size == _NO_SIZE:
            self._size = columns, rows
            self._views = ViewChoice(self._size)
        elif (columns, rows) != self._size:
            width, height = self._size
            raise InvalidData(f"image of {columns}×{rows} px; before: {width}×{height}")
        self._views.light(image.pixels)
        return self._views.judge(find_board(image.pixels, self._board))

    def missing(self) -> tuple[str, ...]:
        """See Choice."""
        return self._views.missing()

    def summary(self) -> tuple[str, ...]:
        """See Choice."""
        return self._views.summary()


class ArmViewsOfBoard:
    """A `Choice` of a board's views from an arm, whose joints are read after each image.

    Args:
        arm: its joints; nothing is commanded.
        lens: of the camera.
        board: what stands still in front of the arm.
    """

    def __init__(self, arm: ArmConnection, lens: CentralModel, board: Board) -> None:
        self._arm, self._lens, self._board = arm, lens, board
        self.poses = PoseChoice(lens, board)
        """what is kept"""

    def look(self, image: CameraImage) -> Judgement:
        """See Choice.

        Raises:
            ConnectionLost: of the arm.
        """
        view = find_board(image.pixels, self._board, self._lens)
        state = self._arm.read()
        if state.time < image.time:
            return Judgement(False, "no joint state since the image was taken")
        return self.poses.judge(view, np.array(state.joint_positions))

    def missing(self) -> tuple[str, ...]:
        """See Choice."""
        return self.poses.missing()

    def summary(self) -> tuple[str, ...]:
        """See Choice."""
        return self.poses.summary()
