"""From light on the sensor to the grey values that a camera delivers."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from omniservo.geometry.arrays import ByteArray, FloatArray
from omniservo.scenes import Sensor
from omniservo.simulation.pixel_edges import sheared_grid

_BLUR_REACH = 4.0  # standard deviations
_LEAST_GAIN = 1e-9  # grey values per electron, below which shot noise is far below a step of 1
_FINE = 16  # points along a side of a pixel by which a disc's share of it is told


def grey_values(image: FloatArray, sensor: Sensor, random: np.random.Generator) -> ByteArray:
    """Return what the camera delivers (height, width).

    The lens's defocus and point spread, its vignetting, shot noise, dark noise, rounding to 0 … 255, JPEG.

    Args:
        image: (height, width) linear intensity; 1 is white, 255.
        sensor: what it does to it.
        random: source of the noise.
    """
    light = (255.0 * image).astype(np.float32)
    if sensor.defocus > 0.0:
        light = cv2.filter2D(light, -1, disc(sensor.defocus), borderType=cv2.BORDER_REPLICATE)
        np.maximum(light, 0.0, out=light)  # large discs pass a Fourier transform, whose rounding goes below
    if sensor.blur > 0.0:
        light = gaussian_filter(light, sensor.blur, mode="nearest", truncate=_BLUR_REACH)
    if sensor.vignetting > 0.0:
        light *= light_left(sensor.vignetting, *light.shape)
    if sensor.gain > _LEAST_GAIN:
        light = (sensor.gain * random.poisson(light / sensor.gain)).astype(np.float32)
    if sensor.noise > 0.0:
        light += np.float32(sensor.noise) * random.standard_normal(light.shape, dtype=np.float32)
    grey: ByteArray = np.clip(np.rint(light, out=light), 0.0, 255.0, out=light).astype(np.uint8)
    return grey if sensor.jpeg is None else compressed(grey, sensor.jpeg)


def disc(radius: float) -> NDArray[np.float32]:
    """Return an even disc of this radius [px], as the shares of it in the pixels round its centre."""
    reach = math.ceil(radius - 0.5) if radius > 0.5 else 0
    row, column = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    at = np.stack([column, row], axis=-1)[..., None, :] + sheared_grid(_FINE)
    shares = (np.hypot(at[..., 0], at[..., 1]) <= radius).mean(axis=-1)
    return np.asarray(shares / shares.sum(), dtype=np.float32)


def light_left(vignetting: float, height: int, width: int) -> NDArray[np.float32]:
    """Return 1 − vignetting · (r / corner's r)² of each pixel (height, width), r from the image's middle."""
    v, u = np.mgrid[:height, :width]
    squares = (u - 0.5 * (width - 1)) ** 2 + (v - 0.5 * (height - 1)) ** 2
    return np.asarray(1.0 - vignetting * squares / (squares.max() or 1.0), dtype=np.float32)


def compressed(image: ByteArray, quality: int) -> ByteArray:
    """Return a grey image (height, width) as JPEG of this quality leaves it."""
    _, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE), dtype=np.uint8)
