"""Image files at the program's edge: read within bounds, written whole or not at all."""

from __future__ import annotations

import hashlib
import io
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image, UnidentifiedImageError

from omniservo.errors import InputError, spelled
from omniservo.files import read_bytes, write_whole
from omniservo.files.own_warnings import own_warnings
from omniservo.geometry.arrays import ByteArray, FloatArray

MOST_PIXELS = 100_000_000
"""Largest image that is read."""

MOST_BYTES = 2**29
"""Largest image file that is read: 10⁸ pixels of three colours, not compressed, fit."""

FORMATS = ("PNG", "JPEG", "TIFF", "BMP", "PPM", "WEBP", "GIF")
"""Formats of images that are read; others may start programs, as EPS does."""

_ORIENTATION = 0x0112
"""the tag of EXIF and TIFF that says how an image is to be turned for show"""

_BACK = {
    2: Image.Transpose.FLIP_LEFT_RIGHT,
    3: Image.Transpose.ROTATE_180,
    4: Image.Transpose.FLIP_TOP_BOTTOM,
    5: Image.Transpose.TRANSPOSE,
    6: Image.Transpose.ROTATE_90,
    7: Image.Transpose.TRANSVERSE,
    8: Image.Transpose.ROTATE_270,
}
"""what undoes how Pillow turns a TIFF, and no other format, by its orientation"""

_VIDEOS = (".mp4", ".mov", ".avi", ".mkv", ".webm", ".m4v")


def copies_of(paths: Sequence[Path]) -> dict[int, Path]:
    """Return the places of files that are copies of earlier ones, and of which these are."""
    first: dict[bytes, int] = {}
    digests = [hashlib.blake2b(read_bytes(path, max_bytes=MOST_BYTES)).digest() for path in paths]
    earliest = [first.setdefault(digest, i) for i, digest in enumerate(digests)]
    return {i: paths[k] for i, k in enumerate(earliest) if k != i}


def read_image(path: str | Path) -> ByteArray:
    """Return an image file's pixels as they are stored: grey (height, width) or colours (height, width, 3).

    Raises:
        InputError: missing, not an image that can be read, or more than 10⁸ pixels.
    """
    with _opened(path) as picture:
        if _has_many_bits(picture):
            return _of_many_bits(picture, path)
        mode = "L" if picture.mode in ("1", "L", "LA") else "RGB"
        return np.asarray(picture if picture.mode == mode else picture.convert(mode), dtype=np.uint8)


def read_grey_image(path: str | Path) -> ByteArray:
    """Return an image file as grey values (height, width), its pixels as they are stored.

    Images of 16 bits are divided by 256, or by what makes their brightest pixel 255 where that is less: a
    sensor of 12 bits does not use all 16.

    Raises:
        InputError: missing, not an image that can be read, or more than 10⁸ pixels.
    """
    with _opened(path) as picture:
        if _has_many_bits(picture):
            return _of_many_bits(picture, path)
        return np.asarray(picture.convert("L"), dtype=np.uint8)


def is_srgb(path: str | Path) -> bool:
    """Return whether an image file itself says that its values are those of sRGB, as a PNG can.

    Raises:
        InputError: missing, not an image that can be read, or more than 10⁸ pixels.
    """
    with _opened(path) as picture:
        return "srgb" in picture.info


def image_size(path: str | Path) -> tuple[int, int]:
    """Return an image file's (width, height) [px]; its pixels are not decoded.

    Raises:
        InputError: missing, not an image that can be read, or more than 10⁸ pixels.
    """
    with _opened(path) as picture:
        width, height = picture.size
        return width, height


def write_png(image: npt.NDArray[np.uint8], path: str | Path, *, force: bool = False) -> None:
    """Write grey values or colours as PNG; see `write_whole`."""
    stream = io.BytesIO()
    Image.fromarray(image).save(stream, "PNG")
    write_whole(path, stream.getvalue(), force=force)


@contextmanager
def _opened(path: str | Path) -> Iterator[Any]:
    if os.path.isdir(path):  # it takes any name
        raise InputError(f"{path}: a folder; legal: images, as in {path}/*.png")
    data = read_bytes(path, max_bytes=MOST_BYTES)
    try:
        with (
            own_warnings("ignore"),
            Image.open(io.BytesIO(data), formats=FORMATS) as picture,
        ):
            width, height = picture.size
            if width * height > MOST_PIXELS:
                raise InputError(f"{path}: {width}×{height} pixels; at most {MOST_PIXELS} are read")
            back = _BACK.get(picture.getexif().get(_ORIENTATION, 1)) if picture.format == "TIFF" else None
            yield picture if back is None else picture.transpose(back)
    except InputError:
        raise
    except UnidentifiedImageError:
        video = Path(path).suffix.lower() in _VIDEOS
        more = "; of a video calibrate takes the images with --camera-source" if video else ""
        raise InputError(f"{path}: not an image; legal: {', '.join(FORMATS)}{more}") from None
    except Exception as error:  # the readers of formats raise whatever they meet
        raise InputError(f"{path}: not an image that can be read: {spelled(str(error))}") from None


def _has_many_bits(picture: Any) -> bool:
    return bool(picture.mode.startswith("I") or picture.mode == "F")


def _of_many_bits(picture: Any, path: str | Path) -> ByteArray:
    """Return grey values of more than 8 bits in 8; band by band, since all in double take gigabytes."""
    brightest = 1.0
    for _, values in _bands(picture):
        if not np.isfinite(values).all():
            raise InputError(f"{path}: grey values that are not finite")
        brightest = max(brightest, float(values.max()))
    scale = 255.0 / min(brightest, 65535.0)
    grey = np.empty(picture.size[::-1], dtype=np.uint8)
    for rows, values in _bands(picture):
        grey[rows] = (values * scale).clip(0, 255)
    return grey


def _bands(picture: Any) -> Iterator[tuple[slice, FloatArray]]:
    """Yield rows of an image and their values, so many that they are about a quarter of a megapixel."""
    width, height = picture.size
    step = max(1, 2**18 // width)
    for top in range(0, height, step):
        bottom = min(top + step, height)
        yield (
            slice(top, bottom),
            np.asarray(picture.crop((0, top, width, bottom)), dtype=np.float64),
        )
