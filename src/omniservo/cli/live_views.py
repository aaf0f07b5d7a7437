"""Images of a board from a live camera: kept where they show something new, with a preview."""

from __future__ import annotations

import math
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager
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
    from omniservo.runs.watch_board import Watch

LiveSourceOption = Annotated[
    str | None,
    typer.Option(
        "--camera-source",
        help="Take images live: v4l2:0, rtsp://…, http://… (MJPEG), folder:PATH?rate=30, ros2:TOPIC.",
    ),
]
SaveOption = Annotated[
    Path | None,
    typer.Option("--save", help="Folder for the live images that are kept; as a rule beside --out."),
]
SecondsOption = Annotated[
    float | None, typer.Option("--seconds", min=0.0, help="Take live images for so long at most.")
]


def folder_of_images(
    images: list[Path] | None, source: str | None, save: Path | None, out: Path | None
) -> Path | None:
    """Return the folder into which live images go; None: image files are given.

    Raises:
        InputError: both are given, neither, or no place for live images.
    """
    if bool(images) == (source is not None):
        raise InputError("calibrate: give image files or --camera-source, one of them")
    if source is None:
        if save is not None:
            raise InputError("--save: goes with --camera-source")
        return None
    if save is None and out is None:
        raise InputError("--camera-source: give --out or --save, where the images that are kept go, too")
    return save if save is not None or out is None else out.with_name(f"{out.stem}-images")


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
    from omniservo.files import whole_folder, writable
    from omniservo.files.image_files import write_png
    from omniservo.runs.open_hardware import camera_at
    from omniservo.runs.watch_board import watch_board

    writable(folder, force=force)
    with output.working(f"connecting to {source}"):
        camera = camera_at(source)
    with closing(camera), _until_interrupt() as stopped, Preview(output) as preview:
        watch = watch_board(camera, board, tell=preview, stopped=stopped, seconds=seconds)
    missing = "; ".join(watch.choice.missing())
    ended = f"{watch.ended}: {len(watch.images)} of {watch.looked_at} images kept"
    if len(watch.images) < FEWEST:
        last = "" if watch.last.kept else f"; the last image: {watch.last.words}"
        raise NoSolutionError(
            f"{ended}, at least {FEWEST} are needed; nothing was written; missing: {missing}{last}"
        )
    output.line(ended + (f"; still missing: {missing}" if missing else ""))
    names = [f"{number:03d}.png" for number in range(len(watch.images))]
    with whole_folder(folder, force=force) as unfinished:
        for name, image in zip(names, watch.images, strict=True):
            write_png(image, unfinished / name)
    output.written(folder)
    return [folder / name for name in names]


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
    choice = watch.choice
    rows = [" ".join(_share(share) for share in row) for row in choice.covered_thirds]
    least, most = (f"{100 * size:.0f}%" for size in choice.sizes)
    vertical, horizontal = (f"{math.degrees(tilt):.0f}°" for tilt in choice.tilts)
    missing = choice.missing()
    return [
        f"image {watch.looked_at}: {watch.last.words}",
        f"  {len(choice.kept)} kept; the board {least} to {most} of the image's longer side, tilted by up to"
        f" {vertical} about the vertical and {horizontal} about the horizontal",
        *(f"  {name:<14}{row}" for name, row in zip(("covered", "by thirds", ""), rows, strict=True)),
        f"  missing: {missing[0]}" if missing else "  nothing is missing",
        *(f"           {words}" for words in missing[1:]),
    ]


def _share(share: float) -> str:
    return "dark" if math.isnan(share) else f"{100 * share:3.0f}%"


@contextmanager
def _until_interrupt() -> Iterator[Callable[[], bool]]:
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
