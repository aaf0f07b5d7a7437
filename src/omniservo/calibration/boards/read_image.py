"""Image files as grey values."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from PIL import Image

from omniservo.errors import InputError
from omniservo.geometry.arrays import ByteArray

MOST_PIXELS = 100_000_000
"""Largest image that is read."""


def read_grey_image(path: str | Path) -> ByteArray:
    """Return an image file as grey values (height, width), its pixels as they are stored.

    Images of 16 bits are divided by 256, or by what makes their brightest pixel 255 where that is less: a
    sensor of 12 bits does not use all 16.

    Raises:
        InputError: missing, not an image that can be read, or more than 10⁸ pixels.
    """
    try:
        with Image.open(path) as picture:
            width, height = picture.size
            if width * height > MOST_PIXELS:
                raise InputError(f"{path}: {width}×{height} pixels; at most {MOST_PIXELS} are read")
            if picture.mode.startswith("I") or picture.mode == "F":
                return _of_many_bits(np.asarray(picture, dtype=np.float64), path)
            return np.asarray(picture.convert("L"), dtype=np.uint8)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: not an image that can be read: {error}") from None


def _of_many_bits(values: np.typing.NDArray[np.float64], path: str | Path) -> ByteArray:
    if not np.isfinite(values).all():
        raise InputError(f"{path}: grey values that are not finite")
    brightest = max(float(values.max()), 1.0)
    return np.asarray((values.clip(0.0) * (255.0 / min(brightest, 65535.0))).clip(0, 255), dtype=np.uint8)
