"""Images of a board from a live camera: kept where they show something new, with a preview."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Annotated, Self

import typer
from rich.console import Console
from rich.live import Live
from rich.text import Text

from omniservo.cli.output import Output
from omniservo.errors import InputError, NoSolutionError

if TYPE_CHECKING:
    from omniservo.calibration.boards import Board
    from omniservo.robots import CameraSource
    from omniservo.runs.watch_camera import Choice, Watch

_IMAGE = "{:03d}.png"

FIRST_IMAGE = _IMAGE.format(0)
"""in every folder of `write_images`"""

LiveSourceOption = Annotated[
    str | None,
    typer.Option(
        "--camera-source",
        help="Take images live: v4l2:0, rtsp://…, http://… (MJPEG), folder:PATH?rate=30, ros2:TOPIC.",
    ),
]


@dataclass(frozen=True)
class LiveImages:
    """Where images go that are taken live, and how long they are taken."""

    save: Annotated[
        Path | None,
        typer.Option("--save", help="Folder for the live images that are kept; as a rule beside --out."),
    ] = None
    seconds: Annotated[
        float | None, typer.Option("--seconds", min=0.0, help="Take live images for so long at most.")
    ] = None

    def folder_for(self, images: list[Path] | None, source: str | None, out: Path | None) -> Path | None:
        """Return the folder into which live images go; None: image files are given.

        Raises:
            InputError: both are given, neither, or no place for live images.
        """
        if bool(images) == (source is not None):
            raise InputError("calibrate: give image files or --camera-source, one of them")
        if source is None:
            if self.save is not None:
                raise InputError("--save: goes with --camera-source")
            return None
        return self.folder(out)

    def folder(self, out: Path | None) -> Path:
        """Return the folder for live images: ``--save``, or one beside the result.

        Raises:
            InputError: neither is given.
        """
        if self.save is not None:
            return self.save
        if out is None:
            raise InputError("live images: give --out or --save, where those that are kept go, too")
        return out.with_name(f"{out.stem}-images")


def take_images(
    source: str, board: Board, folder: Path, output: Output, *, seconds: float | None, force: bool
) -> list[Path]:
    """Watch a camera until nothing is missing or Ctrl-C, and write the images that are kept.

    Returns:
        Their files, in the order in which they were taken.

    Raises:
        InputError: no such camera, or the folder cannot be written.
        NoSolutionError: too few were kept for a calibration; nothing is written.
    """
    from omniservo.calibration.view_choice import FEWEST
    from omniservo.files import whole_folder, writable_folder
    from omniservo.runs.open_hardware import camera_at
    from omniservo.runs.watch_camera import BoardViews

    writable_folder(folder, FIRST_IMAGE, force=force)
    with output.working(f"connecting to {source}"):
        camera = camera_at(source)
    with closing(camera):
        watch = watched(camera, BoardViews(board), output, seconds, FEWEST)
    with whole_folder(folder, FIRST_IMAGE, force=force) as unfinished:
        names = write_images(watch, unfinished)
    output.written(folder)
    return [folder / name for name in names]


def watched(
    camera: CameraSource, choice: Choice, output: Output, seconds: float | None, fewest: int
) -> Watch:
    """Watch a camera until nothing is missing or Ctrl-C, and say how it ended.

    Raises:
        NoSolutionError: fewer images were kept than a calibration needs.
    """
    from omniservo.runs.watch_camera import watch_camera

    with until_interrupt() as stopped, Preview(output) as preview:
        watch = watch_camera(camera, choice, tell=preview, stopped=stopped, seconds=seconds)
    missing = "; ".join(choice.missing())
    ended = f"{watch.ended}: {len(watch.images)} of {watch.looked_at} images kept"
    if len(watch.images) < fewest:
        last = "" if watch.last.kept else f"; the last image: {watch.last.words}"
        raise NoSolutionError(
            f"{ended}, at least {fewest} are needed; nothing was written; missing: {missing}{last}"
        )
    output.line(ended + (f"; still missing: {missing}" if missing else ""))
    return watch


def write_images(watch: Watch, folder: Path) -> list[str]:
    """Write the images that were kept, and return their names, which sort as they were taken."""
    from omniservo.files.image_files import write_png

    names = [_IMAGE.format(number) for number in range(len(watch.images))]
    for name, image in zip(names, watch.images, strict=True):
        write_png(image, folder / name)
    return names


class Preview:
    """Shows what is seen and what is missing: a block that changes on a terminal, else lines of what is new.

    Args:
        output: where the command's words go; the preview goes to standard error.
    """

    def __init__(self, output: Output) -> None:
        self._silent = output.quiet or output.as_json
        self._said = ""
        self._live: Live | None = None
        self._entered = ExitStack()

    def __enter__(self) -> Self:
        if not self._silent and sys.stderr.isatty():
            console = Console(stderr=True, highlight=False)
            self._live = self._entered.enter_context(Live(Text("waiting for images"), console=console))
        return self

    def __exit__(self, *raised: object) -> None:
        self._entered.close()

    def __call__(self, watch: Watch) -> None:
        """Show the newest image's fate."""
        if self._silent:
            return
        if self._live is not None:
            self._live.update(Text("\n".join(preview_lines(watch))), refresh=True)
            return
        # what moves is said in other pixels each time: one line is enough
        words = watch.last.words.partition(" (")[0]
        if watch.last.kept:
            lines = preview_lines(watch)
        else:
            lines = [] if words == self._said else preview_lines(watch)[:1]
        self._said = words
        for line in lines:
            print(line, file=sys.stderr, flush=True)


def preview_lines(watch: Watch) -> list[str]:
    """Return the newest image's fate, what is kept, and what is missing."""
    missing = watch.choice.missing()
    return [
        f"image {watch.looked_at}: {watch.last.words}",
        *(f"  {line}" for line in watch.choice.summary()),
        f"  missing: {missing[0]}" if missing else "  nothing is missing",
        *(f"           {words}" for words in missing[1:]),
    ]


@contextmanager
def until_interrupt() -> Iterator[Callable[[], bool]]:
    """Have a first Ctrl-C end the watching alone; a second one ends the command."""
    ended = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield ended.is_set
        return
    usual = signal.getsignal(signal.SIGINT)

    def end(number: int, frame: FrameType | None) -> None:
        ended.set()
        signal.signal(signal.SIGINT, usual)

    signal.signal(signal.SIGINT, end)
    try:
        yield ended.is_set
    finally:
        signal.signal(signal.SIGINT, usual)
