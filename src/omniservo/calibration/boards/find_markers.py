"""Square markers by number, with their four corners, in both reflections of an image."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from omniservo.geometry.arrays import ByteArray, FloatArray, IntArray
from omniservo.tag_dictionaries import dictionary

_BORDERS = (1, 2)
"""dark cells around the code: OpenCV prints 1, Kalibr 2"""
_ENOUGH = 4
_LEAST_PERIMETER_PX = 40.0
"""smaller squares have no code that can be read; noise is full of them"""
_DOUBLED = 3_000_000  # pixels: larger images are not searched in double size


@dataclass(frozen=True)
class Markers:
    """The markers of one image."""

    numbers: IntArray
    """(m,)"""
    corners: FloatArray
    """(m, 4, 2) [px], in the order of the dictionary's own orientation"""
    mirrored: bool
    """whether they were read in the reflected image"""
    border: int
    """dark cells around the code"""

    def __len__(self) -> int:
        return len(self.numbers)


def find_markers(image: ByteArray, name: str, count: int, *, borders: tuple[int, ...] = _BORDERS) -> Markers:
    """Read the markers 0…count−1 of a dictionary; the reading that finds most is returned.

    The image is read as it is, reflected, with each width of the dark border, and doubled where few are
    found. A number that is read twice is dropped.

    Args:
        image: (height, width) grey values.
        name: of the dictionary.
        count: how many of its markers are on the board.
        borders: widths of the border to try, in cells.
    """
    best = Markers(np.zeros(0, dtype=np.int64), np.zeros((0, 4, 2)), mirrored=False, border=1)
    scales = (1, 2) if image.size <= _DOUBLED else (1,)
    for scale in scales:
        for mirrored in (False, True):
            for border in borders:
                markers = _read(image, name, count, scale, mirrored, border)
                if len(markers) > len(best):
                    best = markers
        if len(best) >= min(_ENOUGH, count):
            break
    return best


def _read(image: ByteArray, name: str, count: int, scale: int, mirrored: bool, border: int) -> Markers:
    parameters = cv2.aruco.DetectorParameters()
    parameters.markerBorderBits = border
    parameters.adaptiveThreshWinSizeMax = 43
    parameters.minMarkerPerimeterRate = max(0.01, _LEAST_PERIMETER_PX / max(image.shape))
    # a square of a wide-angle image has bent sides
    parameters.polygonalApproxAccuracyRate = 0.06
    detector = cv2.aruco.ArucoDetector(dictionary(name), parameters)
    seen = np.ascontiguousarray(image[:, ::-1]) if mirrored else image
    if scale != 1:
        seen = cv2.resize(seen, None, fx=scale, fy=scale, interpolation=cv2.INTER_CUBIC)
    corners, numbers, _ = detector.detectMarkers(seen)
    if numbers is None:
        return Markers(np.zeros(0, dtype=np.int64), np.zeros((0, 4, 2)), mirrored, border)
    numbers = np.asarray(numbers, dtype=np.int64).ravel()
    pixels = (np.array(corners, dtype=np.float64).reshape(-1, 4, 2) + 0.5) / scale - 0.5
    if mirrored:
        pixels[..., 0] = image.shape[1] - 1 - pixels[..., 0]
    value, times = np.unique(numbers, return_counts=True)
    good = (numbers < count) & np.isin(numbers, value[times == 1])
    return Markers(numbers[good], pixels[good], mirrored, border)
