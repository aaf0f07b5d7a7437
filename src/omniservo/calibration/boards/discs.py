"""Dark discs on a bright ground as ellipses: grey-weighted centres and shapes."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from omniservo.geometry.arrays import BoolArray, ByteArray, FloatArray, IntArray

_BLOCKS = (25, 61, 151)  # [px] sides of the neighbourhoods whose mean is the threshold
_LARGEST_BLOCK = 0.25  # of the image's longer side: larger images have some of twice the size, and so on
_DARKER = 7  # grey values below that mean
_LEAST_CONTRAST = 15.0
_LEAST_AREA, _LARGEST_PART = 12.0, 0.1  # [px²]; of the image
_MOST = 1500  # parts that are looked at for each threshold: noise has tens of thousands
_ASPECT = 0.12  # shortest over longest axis
_ROUND = (0.85, 1.12)  # area over that of the ellipse with the same moments
_BLUR_SQUARE, _LEAST_SHARPNESS = 2.0, 0.5  # [px²] what blur may add to the moments; part that must be left
_HALF_PIXEL_SQUARE = 1.0 / 12.0  # a pixel adds its own variance to a shape


@dataclass(frozen=True)
class Discs:
    """The images of discs."""

    pixels: FloatArray
    """(n, 2) [px] centroids"""
    shape: FloatArray
    """(n, 2, 2) [px²] second central moments: an ellipse with half axes p, q has p²/4 and q²/4"""


def find_discs(image: ByteArray) -> Discs:
    """Find whole dark ellipses; whatever lies on a lattice of them is decided later."""
    centres, shapes = [np.zeros((0, 2))], [np.zeros((0, 2, 2))]
    grey = image.astype(np.float64)
    for block in _blocks(max(image.shape)):
        method = cv2.ADAPTIVE_THRESH_MEAN_C
        mask = cv2.adaptiveThreshold(image, 255, method, cv2.THRESH_BINARY_INV, block, _DARKER)
        count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=4, ltype=cv2.CV_32S)
        for k in _candidates(stats[:count], image):
            u, v, w, h, _ = (int(x) for x in stats[k])
            inside = labels[v : v + h, u : u + w] == k
            measured = _measured(grey, inside, (u, v))
            if measured is not None:
                centres.append(measured[0][None])
                shapes.append(measured[1][None])
    pixels, shape = np.concatenate(centres), np.concatenate(shapes)
    kept: list[int] = []
    for k in range(len(pixels)):
        reach = np.sqrt(np.linalg.det(shape[k])) ** 0.5
        if all(np.hypot(*(pixels[k] - pixels[j])) > reach for j in kept):
            kept.append(k)
    return Discs(pixels[kept], shape[kept])


def _blocks(longer_side: int) -> list[int]:
    """Return the sides of neighbourhoods for all discs of an image [px], odd."""
    blocks = list(_BLOCKS)
    while (larger := 2 * blocks[-1] + 1) <= _LARGEST_BLOCK * longer_side:
        blocks.append(larger)
    return blocks


def _candidates(stats: IntArray, image: ByteArray) -> IntArray:
    """Return the parts, but the ground (0), that are whole and of a disc's size: the largest `_MOST`."""
    u, v, w, h, area = stats.T.astype(np.int64)
    fits = (u > 0) & (v > 0) & (u + w < image.shape[1]) & (v + h < image.shape[0])
    fits &= (area >= _LEAST_AREA) & (area <= _LARGEST_PART * image.size) & (area >= 0.25 * w * h)
    fits[0] = False
    found = np.flatnonzero(fits)
    return np.sort(found[np.argsort(-area[found], kind="stable")[:_MOST]])


def _measured(
    grey: FloatArray, inside: BoolArray, corner: tuple[int, int]
) -> tuple[FloatArray, FloatArray] | None:
    """Centroid and moments of one blob from its darkness below the ground around it; None for no ellipse."""
    row, column = np.nonzero(inside)
    points = np.stack([column + corner[0], row + corner[1]], axis=1).astype(np.float64)
    centre, total = points.mean(axis=0), float(len(points))
    shape = np.cov(points.T, bias=True) + _HALF_PIXEL_SQUARE * np.eye(2)
    if not _is_ellipse(shape, total):
        return None
    for _ in range(3):
        window = _window(grey, centre, shape)
        if window is None:
            return None
        u, v, values, distance = window
        ring = (distance > 1.2) & (distance < 2.4)  # [px] outside
        core = distance < -1.0 if (distance < -1.0).sum() >= 4 else distance < -0.3
        if ring.sum() < 8 or core.sum() < 2:
            return None
        ground, dark = float(np.median(values[ring])), float(np.median(values[core]))
        if ground - dark < _LEAST_CONTRAST:
            return None
        weight = ((ground - values) / (ground - dark)).clip(-0.2, 1.2) * (distance < 1.7)
        total = float(weight.sum())
        if total < 0.5 * _LEAST_AREA:
            return None
        centre = np.array([(weight * u).sum(), (weight * v).sum()]) / total
        du, dv = u - centre[0], v - centre[1]
        cross = (weight * du * dv).sum()
        shape = np.array([[(weight * du * du).sum(), cross], [cross, (weight * dv * dv).sum()]]) / total
        if not _is_ellipse(shape, total):
            return None
    # blur widens the moments and leaves the area: the neighbours are looked for in steps of the true size
    return centre, shape * (total / _area_of(shape))


def _window(
    grey: FloatArray, centre: FloatArray, shape: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray] | None:
    """Pixels around an ellipse: u, v, grey value, and about how far [px] outside of it each lies."""
    reach = 2.0 * np.sqrt(np.diag(shape)) + 4.0
    low, high = np.floor(centre - reach).astype(int), np.ceil(centre + reach).astype(int)
    height, width = grey.shape
    if low[0] < 0 or low[1] < 0 or high[0] >= width or high[1] >= height:
        low = np.maximum(low, 0)
        high = np.minimum(high, [width - 1, height - 1])
        if (centre - 2.0 * np.sqrt(np.diag(shape)) < low).any() or (
            centre + 2.0 * np.sqrt(np.diag(shape)) > high
        ).any():
            return None
    v, u = np.mgrid[low[1] : high[1] + 1, low[0] : high[0] + 1].astype(np.float64)
    du, dv = u - centre[0], v - centre[1]
    inverse = np.linalg.inv(4.0 * shape)
    x, y = inverse[0, 0] * du + inverse[0, 1] * dv, inverse[0, 1] * du + inverse[1, 1] * dv
    square = du * x + dv * y
    distance = (np.sqrt(square) - 1.0) * np.sqrt(square) / np.maximum(np.hypot(x, y), 1e-9)
    distance = np.where(square < 1e-6, -10.0, distance)
    return u, v, grey[low[1] : high[1] + 1, low[0] : high[0] + 1], distance


def _is_ellipse(shape: FloatArray, area: float) -> bool:
    least, largest = np.linalg.eigvalsh(shape)
    if not least > _ASPECT**2 * largest > 0.0:
        return False
    mean = float(np.sqrt(least * largest))
    widened = max(1.0 - _BLUR_SQUARE / mean, _LEAST_SHARPNESS)
    return bool(_ROUND[0] * widened < area / _area_of(shape) < _ROUND[1])


def _area_of(shape: FloatArray) -> float:
    """Area of the ellipse with these moments [px²]."""
    return float(4.0 * np.pi * np.sqrt(np.linalg.det(shape)))
