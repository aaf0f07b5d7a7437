"""Tags followed from image to image, each looked for where it is predicted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from omniservo.cameras.models.central_model import CentralModel
from omniservo.errors import InputError, spelled
from omniservo.geometry.arrays import BoolArray, ByteArray, FloatArray, finite_number
from omniservo.perception.find_dots import check_image, noise_of
from omniservo.perception.find_tags import read_tags
from omniservo.perception.tag_candidates import candidate_planes, read_cells
from omniservo.perception.tag_codes import likeliest_code, tag_codes
from omniservo.perception.tag_fit import corner_pixels, fit_code, planes_of
from omniservo.perception.tag_views import view_towards

_WIDEST_VIEW = np.deg2rad(130.0)


class TagTracker:
    """Finds the corners of known tags in each new image, given where they are expected.

    The tracker keeps nothing between images: a tag that was lost is found again as soon as it is seen near
    its prediction.
    """

    def __init__(
        self, camera: CentralModel, dictionary: str, ids: Sequence[int], *, gate_px: float = 12.0
    ) -> None:
        """Prepare to follow tags.

        Args:
            camera: the camera that takes the images.
            dictionary: of the tags, as in `find_tags`.
            ids: of the tags, k of them, each once.
            gate_px: largest distance from prediction to corner [px].

        Raises:
            InputError: no such dictionary or tag, an id twice, or the gate is not in 1…200 px.
        """
        self.camera = camera
        self.codes = tag_codes(dictionary)
        self.ids = tuple(self._checked_id(number) for number in ids)
        if len(set(self.ids)) < len(self.ids):
            raise InputError(f"ids: {spelled(list(ids))} given; each tag stands once")
        self.gate_px = finite_number("gate_px", gate_px, minimum=1, maximum=200)

    def update(self, image: ByteArray, predicted_pixels: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Find each tag near its prediction.

        The tag's code is fitted from the prediction where it can be read there, else a tangent view round
        the prediction is searched. A tag counts as in `find_tags`, with all its corners within the gate;
        where that search finds two tags of its id the tag is lost.

        Args:
            image: (height, width) grey values, uint8.
            predicted_pixels: (4k, 2) [px], corner c of the i-th id in row 4i + c; a tag with NaN in a row is
                one without prediction and stays lost.

        Returns:
            pixels (4k, 2) [px], NaN where lost; valid (4k,).

        Raises:
            InputError: not such an image, or predictions of another shape.
        """
        check_image(image, self.camera)
        predicted = np.asarray(predicted_pixels, dtype=np.float64)
        if predicted.shape != (4 * len(self.ids), 2):
            raise InputError(
                f"predicted_pixels: shape {predicted.shape} given; ({4 * len(self.ids)}, 2) is needed"
            )
        image = np.ascontiguousarray(image)
        noise = noise_of(image[::4])
        pixels = np.full(predicted.shape, np.nan)
        for i, number in enumerate(self.ids):
            rows = slice(4 * i, 4 * i + 4)
            found = self._found(image, number, predicted[rows], noise)
            if found is not None:
                pixels[rows] = found
        return pixels, np.isfinite(pixels[:, 0])

    def _found(self, image: ByteArray, number: int, predicted: FloatArray, noise: float) -> FloatArray | None:
        bearings, valid = self.camera.unproject(predicted)
        if not valid.all():
            return None
        planes = planes_of(bearings[None], self.codes.edge)
        if not len(planes):
            return None
        pixels = self._at(image, number, planes[0], noise)
        if pixels is None or not self._near(pixels, predicted):
            pixels = self._around(image, number, bearings, predicted)
        return pixels

    def _at(self, image: ByteArray, number: int, plane: FloatArray, noise: float) -> FloatArray | None:
        """Corners (4, 2) of the tag fitted from this plane, where its code can be read there."""
        greys = read_cells(image, self.camera, plane, self.codes.layout)
        if greys is None or likeliest_code(self.codes, greys) != (number, 0):
            return None
        fit = fit_code(image, self.camera, plane, self.codes, number)
        if fit is None or not fit.agrees(noise):
            return None
        return corner_pixels(self.camera, fit)

    def _around(
        self, image: ByteArray, number: int, bearings: FloatArray, predicted: FloatArray
    ) -> FloatArray | None:
        """Corners (4, 2) of the one tag of this id in a view round the prediction, within the gate."""
        middle = bearings.sum(axis=0)
        middle /= np.linalg.norm(middle)
        reach = float(np.arccos(np.clip(bearings @ middle, -1.0, 1.0)).max())
        side_px = max(float(np.ptp(predicted, axis=0).max()), 1.0)
        # as much more as the gate is of the tag, and the white border
        field = 2.0 * reach * (1.3 + 2.0 * self.gate_px / side_px)
        view = view_towards(self.camera, middle, min(field, _WIDEST_VIEW))
        if view is None:
            return None
        planes = candidate_planes(image, self.camera, self.codes.layout, (view,), raw=False)
        matches = []
        for found, fit in read_tags(image, self.camera, self.codes, planes):
            located = corner_pixels(self.camera, fit)
            if found == number and located is not None and self._near(located, predicted):
                matches.append(located)
        return matches[0] if len(matches) == 1 else None

    def _near(self, pixels: FloatArray, predicted: FloatArray) -> bool:
        return bool((np.linalg.norm(pixels - predicted, axis=1) <= self.gate_px).all())

    def _checked_id(self, number: int) -> int:
        most = len(self.codes.dark) - 1
        whole = finite_number("ids", number, minimum=0, maximum=most)
        if whole != int(whole):
            raise InputError(f"ids: {whole:g} given; a whole number is needed")
        return int(whole)
