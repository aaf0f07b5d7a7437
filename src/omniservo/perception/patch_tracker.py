"""Points of a surface followed by the patches round them, each looked for where it is predicted."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from omniservo.cameras.models import CentralModel
from omniservo.errors import InputError
from omniservo.geometry.arrays import BoolArray, ByteArray, FloatArray, finite_number
from omniservo.perception.find_dots import check_image
from omniservo.perception.patch_reference import PatchReference

LEAST_CORRELATION = 0.8


class PatchTracker:
    """Finds the points of a target in each new image, given where they are expected.

    Each patch is compared with the reference images, never with the image before: nothing drifts. Between
    images only the shape of the found patches is kept, as the start of the next search; a point that was
    lost is found again as soon as it is seen near its prediction.
    """

    def __init__(
        self,
        camera: CentralModel,
        image: ByteArray,
        pixels: npt.ArrayLike,
        *,
        goal_image: ByteArray | None = None,
        pixels_goal: npt.ArrayLike | None = None,
        gate_px: float = 12.0,
    ) -> None:
        """Cut the patches.

        Args:
            camera: the camera that takes the images.
            image: (height, width) grey values, uint8: the reference image.
            pixels: (n, 2) [px] the points in it; a row with NaN is a point that it does not show.
            goal_image: a second reference image, such as the one to be reached; for each point the one
                that looks more like the new image counts.
            pixels_goal: (n, 2) [px] the points in that.
            gate_px: largest distance from prediction to point [px].

        Raises:
            InputError: not such images or points, only one of the goal's arguments, or a gate not in 1…50 px.
        """
        self.camera = camera
        self.gate_px = finite_number("gate_px", gate_px, minimum=1, maximum=50)
        self._references = [PatchReference(camera, "pixels", image, pixels)]
        if (goal_image is None) != (pixels_goal is None):
            raise InputError("goal_image, pixels_goal: one of them given; legal: both, or none")
        if goal_image is not None and pixels_goal is not None:
            self._references.append(PatchReference(camera, "pixels_goal", goal_image, pixels_goal))
        counts = [len(r.whole) for r in self._references]
        if counts[-1] != counts[0]:
            raise InputError(f"pixels_goal: {counts[-1]} rows given; {counts[0]} are needed, as in pixels")

    @property
    def trackable(self) -> BoolArray:
        """(n,) whether a reference image shows the whole patch, with some texture on it."""
        return np.asarray(np.logical_or.reduce([r.whole for r in self._references]))

    def update(self, image: ByteArray, predicted_pixels: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Find each point near its prediction.

        The window round a prediction is brought into the patch's own shape (an affinity between tangent
        planes: of the last image, or else of the neighbouring predictions), the patch is looked for in it
        by correlation, and laid on precisely (`align_patches`). A point is lost where nothing correlates,
        where a second place in the gate does so nearly as well, or where another point fits the same place
        better.

        Args:
            image: (height, width) grey values, uint8.
            predicted_pixels: (n, 2) [px]; a row with NaN is a point without prediction and stays lost.

        Returns:
            pixels (n, 2) [px], NaN where lost; valid (n,).

        Raises:
            InputError: not such an image, or predictions of another shape.
        """
        check_image(image, self.camera)
        predicted = np.asarray(predicted_pixels, dtype=np.float64)
        if predicted.shape != (len(self.trackable), 2):
            wanted = f"({len(self.trackable)}, 2)"
            raise InputError(f"predicted_pixels: shape {predicted.shape} given; {wanted} is needed")
        bearings = self.camera.unproject(predicted)[0]
        source = image.astype(np.float32, order="C")
        peaks = np.stack([r.seek(source, bearings, self.gate_px) for r in self._references])
        best = np.where(peaks.max(axis=0) > 0.0, peaks.argmax(axis=0), -1)
        found, score = np.full((len(predicted), 3), np.nan), np.full(len(predicted), -1.0)
        for k, reference in enumerate(self._references):
            there, alike = reference.lay_on(source, best == k)
            found[best == k], score[best == k] = there[best == k], alike[best == k]
        pixels, seen = self.camera.project(found)
        valid = seen & (score > LEAST_CORRELATION)
        valid[valid] = np.linalg.norm(pixels[valid] - predicted[valid], axis=1) <= self.gate_px
        valid[valid] = _best_of_place(pixels[valid], score[valid])
        return np.where(valid[:, None], pixels, np.nan), valid


def _best_of_place(pixels: FloatArray, score: FloatArray) -> BoolArray:
    """False where another patch was found at the same place and fits better."""
    best = np.ones(len(pixels), dtype=np.bool_)
    for i, j in cKDTree(pixels).query_pairs(1.0) if len(pixels) else ():
        best[i if score[i] < score[j] else j] = False
    return best
