"""A folder of images as a camera: each image when it is due."""

from __future__ import annotations

import math
import time
from pathlib import Path

from omniservo.errors import InputError
from omniservo.files import read_bytes
from omniservo.files.image_files import read_grey_image
from omniservo.hardware.camera_sources.frame_reader import EndOfFrames, Frame, StampClock, UnlikeFrame
from omniservo.hardware.camera_sources.opencv_reader import Pace

STAMPS = "stamps.txt"
"""beside the images: a line `NAME SECONDS` for each, later ones later"""

SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".pgm")

_MOST_STAMPS = 2**24


class FolderReader:
    """A `FrameReader` of a folder.

    Args:
        folder: with images, and `stamps.txt` where no rate is given.
        rate: images per second, in the order of their names; None: as `stamps.txt` has it.

    Raises:
        InputError: no such folder, no images, neither stamps nor rate, or a wrong line in the stamps.
    """

    clock = StampClock.OWN
    """see FrameReader"""
    is_live = False
    """see FrameReader"""

    def __init__(self, folder: Path, rate: float | None) -> None:
        if not folder.is_dir():
            raise InputError(f"{folder}: no such folder")
        if rate is None:
            self._images = stamped_images(folder)
        else:
            names = sorted(path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES)
            self._images = [(path, k / rate) for k, path in enumerate(names)]
        if not self._images:
            raise InputError(f"{folder}: no image in it; legal: {', '.join(SUFFIXES)}")
        self._next = 0
        self._pace = Pace()

    def read(self) -> Frame:
        """See FrameReader."""
        if self._next == len(self._images):
            raise EndOfFrames
        path, at = self._images[self._next]
        self._next += 1
        try:
            pixels = read_grey_image(path)
        except InputError as error:
            raise UnlikeFrame(str(error)) from None
        due = self._pace.wait(at)
        return Frame(pixels, due, time.monotonic())

    def hang_up(self) -> None:
        """See FrameReader."""
        self._pace.end()

    def close(self) -> None:
        """See FrameReader."""


def stamped_images(folder: Path) -> list[tuple[Path, float]]:
    """Return the images that a folder's stamps name, with their times [s].

    Raises:
        InputError: there are no stamps, or one is wrong; the message has its line.
    """
    stamps = folder / STAMPS
    if not stamps.is_file():
        raise InputError(
            f"{folder}: no {STAMPS} (lines: NAME SECONDS); or state a rate: folder:{folder}?rate=30"
        )
    images: list[tuple[Path, float]] = []
    text = read_bytes(stamps, max_bytes=_MOST_STAMPS).decode("utf-8-sig", "replace")
    for number, line in enumerate(text.splitlines(), 1):
        name, _, seconds = line.partition("#")[0].strip().rpartition(" ")
        if not (name or seconds):
            continue
        try:
            at = float(seconds)
        except ValueError:
            at = math.nan
        path = folder / name.strip()
        if not name or not math.isfinite(at):
            raise InputError(f"{stamps}:{number}: legal is NAME SECONDS")
        if path.parent != folder or not path.is_file():
            raise InputError(f"{stamps}:{number}: no image of this name in the folder")
        if images and at <= images[-1][1]:
            raise InputError(f"{stamps}:{number}: {at:g} s is no later than the line before")
        images.append((path, at))
    return images
