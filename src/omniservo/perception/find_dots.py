"""Dark dots on a light ground, found to a few hundredths of a pixel."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from omniservo.cameras.models.central_model import CentralModel
from omniservo.errors import InputError
from omniservo.geometry.arrays import ByteArray, FloatArray
from omniservo.perception.dot_centres import circle_centres
from omniservo.perception.dot_kernels import (
    AREA,
    COLUMNS,
    CONTRAST,
    MEASURED,
    MISFIT,
    NOISE,
    OFF_GROUND,
    ROUGHNESS,
    S_UU,
    S_UV,
    S_VV,
    SKEWNESS,
    U,
    V,
    measure_blobs,
)
from omniservo.perception.dots import DotOptions, FoundDots

SMALL_BLOCK = 41
"""[px] side of the neighbourhood whose mean is the threshold for dots up to half of it"""
MAX_STRAY = 0.4
"""part of the ring that may be something else: an edge that just touches the dot hides up to 0.35 of it"""
MAX_SKEWNESS = 0.09
"""beyond what noise explains; a whole ellipse has none, blurred or not; a half one has 0.24"""
MAX_MISFIT = 0.055
"""rms deviation from an ellipse of one grey, relative to the contrast; 0.4 px² / area may be added"""
MIN_SIGNAL = 5.0
"""contrast over the deviation of the ring from its plane"""


def find_dots(
    image: ByteArray, camera: CentralModel | None = None, options: DotOptions | None = None
) -> FoundDots:
    """Find every whole dark ellipse on a light ground.

    Pixels darker than the mean around them, in two sizes of neighbourhood, give blobs; each blob gets
    grey-weighted moments (`dot_kernels`) and counts as a dot where it is one grey inside an ellipse, is
    symmetric, and a bright ring lies all around it. A dot that is cut by the image's border, by something
    in front of it or by the edge of the image circle is none, nor is one in the camera's dead zone or mask.

    With a camera, ``pixels`` is the image of the circle's centre (`circle_centres`), without it the centroid.

    Args:
        image: (height, width) grey values, uint8.
        camera: the camera that took the image.
        options: limits of size, contrast and shape.

    Raises:
        InputError: not such an image, or not of the camera's size.
    """
    options = options or DotOptions()
    check_image(image, camera)
    if min(image.shape) < 9:
        return FoundDots.none()
    noise = noise_of(image)
    offset = threshold_offset(noise, options)
    masks = [darker_than_mean(image, block, offset) for block in neighbourhoods(options)]
    starts = [blob_moments(mask, (0, 0), options) for mask in masks]
    rows = measure(image, np.concatenate(starts), noise, options)
    return dots_from(rows if camera is None else of_the_scene(rows, camera), camera)


def measure(image: ByteArray, starts: FloatArray, noise: float, options: DotOptions) -> FloatArray:
    """Measure blobs and keep the dots, each once: rows (n, `COLUMNS`) of `measure_blobs`, top to bottom.

    Args:
        image: (height, width) grey values.
        starts: (m, 5) centre and second moments of each blob [px, px²].
        noise: standard deviation of the grey values.
        options: what counts as a dot.
    """
    rows = np.zeros((len(starts), COLUMNS))
    if len(starts):
        measure_blobs(np.ascontiguousarray(image), starts, float(options.max_diameter), rows)
    rows = rows[_is_dot(rows, max(noise, 0.5), options)]
    rows = rows[np.argsort(rows[:, MISFIT], kind="stable")]
    reach, kept = 0.25 * rows[:, AREA], []
    free = np.ones(len(rows), dtype=np.bool_)
    for i, (u, v) in enumerate(rows[:, (U, V)]):
        if free[i]:
            kept.append(i)
            free &= (rows[:, U] - u) ** 2 + (rows[:, V] - v) ** 2 > reach
    rows = rows[kept]
    return np.asarray(rows[np.lexsort((rows[:, U], rows[:, V]))])


def of_the_scene(rows: FloatArray, camera: CentralModel) -> FloatArray:
    """Return the rows whose centre the image shows: its dead zone and mask show the camera itself."""
    return np.asarray(rows[camera.in_image(rows[:, :2])])


def dots_from(rows: FloatArray, camera: CentralModel | None) -> FoundDots:
    """Turn measured rows into dots, in order, with the centre corrected where the camera is known."""
    centroids, covariance = rows[:, :2], covariances(rows)
    pixels = centroids if camera is None else circle_centres(camera, centroids, covariance)
    order = np.lexsort((pixels[:, 0], pixels[:, 1]))
    return FoundDots(pixels[order], rows[order, AREA], covariance[order])


def blob_moments(mask: ByteArray, corner: tuple[int, int], options: DotOptions) -> FloatArray:
    """Return centre and second moments (n, 5) of the connected parts of a mask that may be dots.

    Args:
        mask: (h, w), non-zero where dark.
        corner: (u, v) of the mask's first pixel in the image.
        options: limits of size.
    """
    count, _, stats, centroids = cv2.connectedComponentsWithStats(mask, connectivity=8, ltype=cv2.CV_32S)
    w, h, area = (stats[:, k] for k in (cv2.CC_STAT_WIDTH, cv2.CC_STAT_HEIGHT, cv2.CC_STAT_AREA))
    left, top = stats[:, cv2.CC_STAT_LEFT], stats[:, cv2.CC_STAT_TOP]
    inside = (left > 0) & (top > 0) & (left + w < mask.shape[1]) & (top + h < mask.shape[0])
    size = (area >= 3) & (np.maximum(w, h) <= options.max_diameter + 2) & (area >= 0.15 * w * h)
    good = inside & size & (np.arange(count) > 0)
    u, v = (centroids[good] + corner).T
    return np.stack([u, v, w[good] ** 2 / 16.0, np.zeros_like(u), h[good] ** 2 / 16.0], 1)


def noise_of(image: ByteArray) -> float:
    """Standard deviation of the grey noise, from the median |second difference| along every fourth row."""
    rows = image[::4].astype(np.int16)
    if rows.shape[1] < 3:
        return 0.0
    bend = np.abs(rows[:, 2:] - 2 * rows[:, 1:-1] + rows[:, :-2])
    # the median of |normal| is 0.6745 σ, and a second difference has √6 σ
    return float(np.median(bend) / (0.6745 * np.sqrt(6.0)))


def check_image(image: Any, camera: CentralModel | None) -> None:
    """Raise InputError unless ``image`` is a grey one (height, width) of uint8, of the camera's size."""
    if not isinstance(image, np.ndarray) or image.dtype != np.uint8 or image.ndim != 2 or image.size == 0:
        given = f"{image.dtype} {image.shape}" if isinstance(image, np.ndarray) else type(image).__name__
        raise InputError(f"image: {given} given; legal: a non-empty uint8 array (height, width)")
    if camera is not None and image.shape != (camera.height, camera.width):
        raise InputError(
            f"image: {image.shape[1]}×{image.shape[0]} given; the camera's is {camera.width}×{camera.height}"
        )
    if isinstance(image, np.ma.MaskedArray):
        raise InputError("image: a masked array given; legal: all pixels, and a camera with a mask")


def neighbourhoods(options: DotOptions) -> tuple[int, int]:
    """Sides [px] of the squares whose mean is the threshold: for small dots, and for the largest."""
    return SMALL_BLOCK, max(SMALL_BLOCK, 2 * int(options.max_diameter) + 1)


def threshold_offset(noise: float, options: DotOptions) -> float:
    """By how many grey values a pixel must be darker than the mean around it."""
    return min(max(0.5 * options.min_contrast, 3.5 * noise), 255.0)


def darker_than_mean(image: ByteArray, block: int, offset: float) -> ByteArray:
    """Mask (h, w) of the pixels darker by ``offset`` than the mean of ``block``×``block`` pixels around."""
    method, kind = cv2.ADAPTIVE_THRESH_MEAN_C, cv2.THRESH_BINARY_INV
    return np.asarray(cv2.adaptiveThreshold(image, 255, method, kind, block, float(np.ceil(offset))))


def covariances(rows: FloatArray) -> FloatArray:
    """Second central moments (n, 2, 2) [px²] of measured rows."""
    return np.asarray(rows[:, [S_UU, S_UV, S_UV, S_VV]].reshape(-1, 2, 2))


def _is_dot(rows: FloatArray, noise: float, options: DotOptions) -> Any:
    suu, suv, svv = rows[:, S_UU], rows[:, S_UV], rows[:, S_VV]
    half_sum, spread = 0.5 * (suu + svv), np.hypot(0.5 * (suu - svv), suv)
    contrast = rows[:, CONTRAST]
    shape = half_sum - spread >= options.min_aspect**2 * (half_sum + spread)
    size = (rows[:, AREA] >= options.min_area) & (16 * (half_sum + spread) <= options.max_diameter**2)
    grey = (contrast >= options.min_contrast) & (contrast >= MIN_SIGNAL * rows[:, ROUGHNESS])
    whole = (
        (rows[:, OFF_GROUND] <= MAX_STRAY)
        & (rows[:, SKEWNESS] <= np.minimum(MAX_SKEWNESS + 2.5 * noise * rows[:, NOISE], 0.35))
        & (rows[:, MISFIT] <= MAX_MISFIT + 0.4 / np.maximum(rows[:, AREA], 1.0))
    )
    return (rows[:, MEASURED] > 0) & shape & size & grey & whole
