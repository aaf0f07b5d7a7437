"""A short animation: what the camera sees, and the arm from outside."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib import get_data_path
from PIL import Image, ImageDraw, ImageFont

from omniservo.files import write_whole
from omniservo.geometry.arrays import ByteArray, FloatArray
from omniservo.reporting.style import GOAL
from omniservo.results.run_result import RunResult

_FOOTER = 40
_TEXT = 24
"""[px]: half as large, where a page shows the film at half its width, is still read"""
_GAP = 6
_HEIGHT = 480
"""of the camera's image where there is none from outside [px]"""
_FINE = 2
"""Marks are drawn at this multiple of the size and averaged down."""

_STILL = 7
"""Grey values: a pixel that changes by less keeps its value, so that noise costs no bytes."""

_COLOURS = 240
_END = 1500
"""How long the last image stays [ms]."""

_WAY = "#ff9d1c"

_SWATCH = 12
"""Height of a mark's colour in the sheet that the palette is made from, so that thin lines keep theirs."""

_NEARLY_WHITE = 247
"""Pillow tells no colours apart whose parts differ by less than 8."""


def write_animation(result: RunResult, path: Path) -> None:
    """Write the run as an endless animated GIF, in its own time; an existing file is replaced.

    Left: the camera's images with the feature trajectories so far, blue rings where the goal image has them.
    Right: robot and obstacle. A run that was stopped before its first step gives one image.

    Raises:
        InputError: the file cannot be written.
    """
    write_whole(path, animation_bytes(result), force=True)


def animation_bytes(result: RunResult) -> bytes:
    """Return the animation of `write_animation` as the bytes of a GIF file."""
    pictures = list(_pictures(result))
    palette = _shared_palette(pictures)
    frames = [picture.quantize(palette=palette, dither=Image.Dither.NONE) for picture in pictures]
    stream = io.BytesIO()
    frames[0].save(
        stream,
        format="GIF",
        save_all=True,
        append_images=frames[1:],
        duration=_durations(result.film.times),
        loop=0,
        optimize=True,
    )
    return stream.getvalue()


def _durations(times: Sequence[float]) -> list[int]:
    """Return how long each image stays [ms]; GIF counts in hundredths of a second."""
    steps = [max(20, 10 * round(100 * (b - a))) for a, b in pairwise(times)]
    return [*steps, _END]


def _pictures(result: RunResult) -> Iterator[Image.Image]:
    """Yield the composed images in the order of time."""
    film = result.film
    if not film.times:
        outside = None if result.outside is None else result.outside[0]
        yield _composed(result, result.seen.initial_image, outside, 0, last=True)
        return
    times = result.log.column("time")
    camera = _stilled(film.camera)
    outsides = _stilled(film.outside) if film.outside else [None] * len(camera)
    for k, time in enumerate(film.times):
        steps = int(np.searchsorted(times, time, side="right"))
        yield _composed(result, camera[k], outsides[k], steps, last=k == len(film.times) - 1)


def _stilled(images: Sequence[ByteArray]) -> list[ByteArray]:
    """Return the images with changes below `_STILL` left out: noise neither flickers nor costs bytes."""
    shown, still = images[0], []
    for image in images:
        change = np.abs(image.astype(np.int16) - shown)
        moved = change > _STILL if change.ndim == 2 else (change > _STILL).any(axis=-1, keepdims=True)
        shown = np.where(moved, image, shown)
        still.append(shown)
    return still


def _composed(
    result: RunResult, camera: ByteArray, outside: ByteArray | None, steps: int, *, last: bool
) -> Image.Image:
    """Put the image, and beside it that from outside, over a line of words, after ``steps`` control steps."""
    height = _HEIGHT if outside is None else outside.shape[0]
    left = _scaled(camera, height)
    ways = result.log.column("pixels")[:steps] if steps else np.empty((0, 0, 2))
    _mark(left, ways, result.goal_pixels, left.height / camera.shape[0])
    left = left.reduce(_FINE)
    right = None if outside is None else Image.fromarray(outside)
    width = left.width if right is None else left.width + _GAP + right.width
    page = Image.new("RGB", (width, height + _FOOTER), "white")
    page.paste(left, (0, 0))
    if right is not None:
        page.paste(right, (left.width + _GAP, 0))
    font = ImageFont.truetype(Path(get_data_path(), "fonts", "ttf", "DejaVuSans.ttf"), _TEXT)
    words = _words(result, steps, last=last)
    ImageDraw.Draw(page).text((4, height + 6), words, fill="#1c1f24", font=font)
    return page


def _scaled(image: ByteArray, height: int) -> Image.Image:
    """Return an image as RGB at the fine multiple of the height."""
    picture = Image.fromarray(image)
    width = _FINE * round(height * picture.width / picture.height)
    return picture.resize((width, _FINE * height), Image.Resampling.BILINEAR).convert("RGB")


def _mark(picture: Image.Image, ways: FloatArray, goal: FloatArray, scale: float) -> None:
    """Draw the trajectories (k, n, 2) [px] so far and rings at the goal (n, 2) [px]."""
    draw = ImageDraw.Draw(picture)
    for j in range(ways.shape[1]):
        way = ways[:, j][np.isfinite(ways[:, j]).all(axis=1)]
        if len(way) > 1:
            draw.line([tuple(p) for p in (way + 0.5) * scale], fill=_WAY, width=4, joint="curve")
    for u, v in (goal + 0.5) * scale:
        draw.ellipse((u - 9, v - 9, u + 9, v + 9), outline="white", width=5)
        draw.ellipse((u - 8, v - 8, u + 8, v + 8), outline=GOAL, width=3)


def _words(result: RunResult, steps: int, *, last: bool) -> str:
    """Return the line under the images."""
    if steps == 0:
        return f"{result.method}   stopped before the first step: {result.log.stop_reason}"
    row = result.log.rows[steps - 1]
    words = f"{result.method}   {row.time:5.2f} s   {row.goal_error_px:6.2f} px from the goal image"
    if last and result.log.stop_reason:
        return f"{words}   stopped: {result.log.stop_reason.replace('_', ' ')}"
    return words


def _shared_palette(pictures: Sequence[Image.Image]) -> Image.Image:
    """Return one palette for all images, from the first, middle and last and the colours of the marks."""
    chosen = [pictures[0], pictures[len(pictures) // 2], pictures[-1]]
    width, height = chosen[0].size
    sheet = Image.new("RGB", (width, (height + 2 * _SWATCH) * len(chosen)))
    for i, picture in enumerate(chosen):
        top = i * (height + 2 * _SWATCH)
        sheet.paste(picture, (0, top))
        sheet.paste(_WAY, (0, top + height, width, top + height + _SWATCH))
        sheet.paste(GOAL, (0, top + height + _SWATCH, width, top + height + 2 * _SWATCH))
    palette = sheet.quantize(_COLOURS, method=Image.Quantize.MEDIANCUT)
    colours = np.array(palette.getpalette()).reshape(-1, 3)
    colours[(colours > _NEARLY_WHITE).all(axis=1)] = 255  # what is as good as the page's white is that
    palette.putpalette(colours.ravel().tolist())
    return palette
