"""Dots followed from image to image, each looked for where it is predicted."""

from __future__ import annotations

import numpy as np

from omniservo.cameras.models import CentralModel
from omniservo.errors import InputError
from omniservo.geometry.arrays import BoolArray, ByteArray, FloatArray, IntArray, finite_number
from omniservo.perception.dot_centres import circle_centres
from omniservo.perception.dot_kernels import COLUMNS
from omniservo.perception.dots import DotOptions
from omniservo.perception.find_dots import (
    blob_moments,
    check_image,
    covariances,
    darker_than_mean,
    measure,
    neighbourhoods,
    noise_of,
    of_the_scene,
    threshold_offset,
)

CLEAR = 2.0
"""the second nearest dot must be so many times farther off than the nearest, plus one pixel"""


class DotTracker:
    """Finds the dots of a target in each new image, given where they are expected.

    The tracker keeps nothing between images: a dot that was lost is found again as soon as it is seen
    near its prediction.
    """

    def __init__(
        self, camera: CentralModel, *, gate_px: float = 12.0, options: DotOptions | None = None
    ) -> None:
        """Prepare to follow dots.

        Args:
            camera: the camera that takes the images.
            gate_px: largest distance from prediction to dot [px].
            options: what counts as a dot, as in `find_dots`.

        Raises:
            InputError: the gate is not in 1…200 px.
        """
        self.camera = camera
        self.gate_px = finite_number("gate_px", gate_px, minimum=1, maximum=200)
        self.options = options or DotOptions()

    def update(self, image: ByteArray, predicted_pixels: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Find each dot near its prediction.

        Only a window round each prediction is searched; a larger one where that leaves a dot without
        partner. A prediction and a dot belong together where each is the other's nearest, within the gate,
        and no second dot is about as near. ``pixels`` is the image of the dot's centre, as of `find_dots`.

        Args:
            image: (height, width) grey values, uint8.
            predicted_pixels: (n, 2) [px]; a row with NaN is a dot without prediction and stays lost.

        Returns:
            pixels (n, 2) [px], NaN where lost; valid (n,).

        Raises:
            InputError: not such an image, or predictions of another shape.
        """
        check_image(image, self.camera)
        predicted = np.asarray(predicted_pixels, dtype=np.float64)
        if predicted.ndim != 2 or predicted.shape[1] != 2:
            raise InputError(f"predicted_pixels: shape {predicted.shape} given; (n, 2) is needed")
        pixels = np.full(predicted.shape, np.nan)
        valid = np.zeros(len(predicted), dtype=np.bool_)
        asked = np.flatnonzero(np.isfinite(predicted).all(1))
        noise = noise_of(image[::4])
        offset = threshold_offset(noise, self.options)
        rows = np.zeros((0, COLUMNS))
        for block in neighbourhoods(self.options):
            lost = asked[~valid[asked]]
            blobs = [self._blobs_near(image, predicted[i], block, offset) for i in lost]
            if not any(len(b) for b in blobs):
                continue
            measured = measure(image, np.concatenate(blobs), noise, self.options)
            rows = _with_new(rows, of_the_scene(measured, self.camera))
            centres = circle_centres(self.camera, rows[:, :2], covariances(rows))
            partner = _partners(predicted[asked], centres, self.gate_px)
            found = partner >= 0
            pixels[asked[found]] = centres[partner[found]]
            valid[asked[found]] = True
        return pixels, valid

    def _blobs_near(self, image: ByteArray, centre: FloatArray, block: int, offset: float) -> FloatArray:
        """Dark blobs in the window round a prediction, against the mean of squares of side ``block``."""
        height, width = image.shape
        reach = self.gate_px + 0.5 * block
        left, top = (int(max(0.0, c - reach)) for c in centre)
        right, bottom = (
            int(min(size, c + reach + 1)) for size, c in zip((width, height), centre, strict=True)
        )
        if right - left < 5 or bottom - top < 5:
            return np.zeros((0, 5))
        mask = darker_than_mean(image[top:bottom, left:right], block, offset)
        blobs = blob_moments(mask, (left, top), self.options)
        near = np.hypot(blobs[:, 0] - centre[0], blobs[:, 1] - centre[1]) <= self.gate_px + 2.0
        return np.asarray(blobs[near])


def _with_new(rows: FloatArray, more: FloatArray) -> FloatArray:
    """Measurements (n, COLUMNS) with those of ``more`` that are not there yet, within a pixel."""
    gaps = np.linalg.norm(more[:, None, :2] - rows[None, :, :2], axis=2)
    return np.concatenate([rows, more[(gaps > 1.0).all(1)]])


def _partners(predicted: FloatArray, found: FloatArray, gate: float) -> IntArray:
    """Index of the dot that belongs to each prediction, -1 for none."""
    partner = np.full(len(predicted), -1, dtype=np.int64)
    if not len(found):
        return partner
    gaps = np.linalg.norm(predicted[:, None] - found, axis=2)
    nearest = gaps.argmin(1)
    for i, k in enumerate(nearest):
        mutual = gaps[:, k].argmin() == i and gaps[i, k] <= gate
        if mutual and (np.delete(gaps[i], k) > CLEAR * gaps[i, k] + 1.0).all():
            partner[i] = k
    return partner
