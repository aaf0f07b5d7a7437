"""Is an image smeared by motion, and how far?

An image that moved by L pixels along one direction while it was taken has little slope along it, and what
slope there is, is that of the sharp image at one place less that at another, L away: the autocorrelation
of the slope along that direction has its minimum at a shift of L (Yitzhaky & Kopeika, "Identification of
blur parameters from motion blurred images", Graphical Models and Image Processing 1997).
"""

from __future__ import annotations

import cv2
import numpy as np

from omniservo.geometry.arrays import ByteArray, FloatArray

LEAST_SMEAR = 15
"""[px] A surface's own texture has its minimum nearer; features of an image smeared so far, in both
images alike, are wrong by several times what their patches say."""
FARTHEST = 100
"""[px]"""
LEAST_DEPTH = 0.15
"""of the minimum below 0, in parts of the autocorrelation at 0"""
ONE_SIDED = (0.05, 0.5)
"""Mean square slope along the direction over that across it: with less, the surface shows bars and nothing
else, and soft light along them looks like a smear."""
LEAST_OVERLAP = 0.5
"""of the pixels at a shift of 0: fewer are few enough for their slopes to disagree by chance"""
ROWS = 256
"""at once: large images need little memory"""


def smear_length(image: ByteArray) -> int:
    """Return over how many pixels an image (height, width) of grey values is smeared; 0: none is seen.

    Straight motion is seen, from `LEAST_SMEAR` to `FARTHEST` pixels, over no more than about half the image.
    """
    smooth = cv2.GaussianBlur(image.astype(np.float32), (0, 0), 1.0)
    x, y = (cv2.Sobel(smooth, cv2.CV_32F, *order).ravel() for order in ((1, 0), (0, 1)))
    energy, axes = np.linalg.eigh(np.array([[x @ x, x @ y], [x @ y, y @ y]], dtype=np.float64))
    if not ONE_SIDED[0] * energy[1] < energy[0] < ONE_SIDED[1] * energy[1]:
        return 0
    alike = _autocorrelation(smooth, float(np.degrees(np.arctan2(axes[1, 0], axes[0, 0]))))
    shift = int(np.argmin(alike))
    return shift if shift >= LEAST_SMEAR and alike[shift] < -LEAST_DEPTH * alike[0] else 0


def _autocorrelation(image: FloatArray, angle: float) -> FloatArray:
    """Return that of the slope along a direction [deg], for shifts of 0 to `FARTHEST` px along it.

    It is 0 where what is shifted overlaps too little.
    """
    height, width = image.shape
    turn = cv2.getRotationMatrix2D((0.5 * (width - 1), 0.5 * (height - 1)), angle, 1.0)
    turned, inside = (cv2.warpAffine(a, turn, (width, height)) for a in (image, np.ones_like(image)))
    whole = (cv2.erode(inside, np.ones((5, 5))) > 0.999).astype(np.float32)
    slopes = whole * cv2.Sobel(turned, cv2.CV_32F, 1, 0)
    sums = np.zeros((2, FARTHEST + 1))
    for first in range(0, height, ROWS):
        for k, a in enumerate((slopes, whole)):
            power = np.abs(np.fft.rfft(a[first : first + ROWS], width + FARTHEST + 1, axis=1)) ** 2
            sums[k] += np.fft.irfft(power.sum(0), width + FARTHEST + 1)[: FARTHEST + 1]
    alike = sums[0] / np.maximum(sums[1], 1.0)
    return np.where(sums[1] >= LEAST_OVERLAP * sums[1, 0], alike, 0.0)
