"""The patches of one reference image, and where they are in another."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from omniservo.cameras.models import CentralModel
from omniservo.errors import InputError
from omniservo.geometry.arrays import BoolArray, ByteArray, FloatArray, IntArray
from omniservo.perception.align_patches import align, make_templates
from omniservo.perception.find_dots import check_image
from omniservo.perception.local_affinity import local_affinities, transported
from omniservo.perception.patch_kernels import FloatImage
from omniservo.perception.tangent_patches import TangentFrames

HALF = 7
"""[px] half the side of a patch in the image it comes from"""
PROMISING = 0.5
"""correlation of a patch at the best whole sample, before it is laid on precisely"""
RIVAL = 0.1
"""a patch elsewhere in the gate that correlates not even this much worse may be the right one as well"""
PEAK = 3
"""[samples] a peak of the correlation is the highest so far round"""
STEPS = 10


class PatchReference:
    """The patches round given pixels of one image, ready to be found in others: `seek`, then `lay_on`."""

    def __init__(self, camera: CentralModel, name: str, image: ByteArray, pixels: npt.ArrayLike) -> None:
        """Cut the patches; ``name`` is what the caller calls the pixels (n, 2).

        Raises:
            InputError: not an image of the camera, or not such pixels.
        """
        check_image(image, camera)
        given = np.asarray(pixels, dtype=np.float64)
        if given.ndim != 2 or given.shape[1] != 2:
            raise InputError(f"{name}: shape {given.shape} given; (n, 2) is needed")
        bearings, seen = camera.unproject(given)
        frames = TangentFrames.at(np.where(seen[:, None], bearings, [0.0, 0.0, 1.0]))
        size = np.sqrt(np.abs(np.linalg.det(frames.jacobians(camera))))
        seen &= np.isfinite(size) & (size > 0.0)
        self._camera = camera
        self._templates = make_templates(
            camera, image.astype(np.float32, order="C"), frames, 1.0 / np.where(seen, size, 1.0), HALF
        )
        self.whole: BoolArray = self._templates.whole & seen
        """(n,) the image shows the whole patch, and it is not flat"""
        # where and in what shape the patches were seen last, and of which that is known
        self._frames, self._affinities = frames, np.tile(np.eye(2), (len(given), 1, 1))
        self._places, self._known = np.zeros((len(given), 2)), np.zeros(len(given), dtype=np.bool_)

    def seek(self, image: FloatImage, bearings: FloatArray, gate_px: float) -> FloatArray:
        """Look for the patches within about ``gate_px`` of predicted bearings (n, 3), NaN for none.

        Returns:
            (n,) the correlation at the best whole sample; -1 where there is none, or a second one as good.
        """
        asked = self.whole & np.isfinite(bearings).all(1)
        self._frames, self._affinities = self._shapes(bearings, asked)
        self._places, peaks = np.zeros((len(asked), 2)), np.full(len(asked), -1.0)
        rows = np.flatnonzero(asked)
        if len(rows):
            self._places[rows], peaks[rows] = self._search(image, rows, gate_px)
        return peaks

    def lay_on(self, image: FloatImage, chosen: BoolArray) -> tuple[FloatArray, FloatArray]:
        """Lay the ``chosen`` (n,) patches precisely on where `seek` saw them.

        Returns:
            bearings (n, 3) and the correlation there (n,); -1 where not chosen or not converged.
        """
        correlation, rows = np.full(len(chosen), -1.0), np.flatnonzero(chosen)
        if len(rows):
            planes = self._frames[rows]
            found = align(
                self._camera, image, self._templates[rows], planes, self._places[rows],
                self._affinities[rows], steps=STEPS,
            )  # fmt: skip
            there = planes.directions(found.places[:, None])[:, 0]
            moved = transported(planes, there / np.linalg.norm(there, axis=1, keepdims=True))
            self._frames.bearings[rows], self._frames.first[rows] = moved.bearings, moved.first
            self._affinities[rows] = found.affinities
            correlation[rows] = np.where(found.converged, found.correlation, -1.0)
        self._known = correlation > 0.0
        return self._frames.bearings, correlation

    def _shapes(self, bearings: FloatArray, asked: BoolArray) -> tuple[TangentFrames, FloatArray]:
        """Planes at the predictions, and affinities to them: the last ones, or those of the neighbourhood."""
        away = np.where(asked[:, None], bearings, self._templates.frames.bearings)
        frames = transported(self._templates.frames, away)
        affinities = local_affinities(self._templates.frames, frames, asked)
        kept = asked & self._known
        frames.first[kept] = transported(self._frames[kept], away[kept]).first
        affinities[kept] = self._affinities[kept]
        return frames, affinities

    def _search(self, image: FloatImage, rows: IntArray, gate_px: float) -> tuple[FloatArray, FloatArray]:
        """Places (m, 2) on the planes of some rows where the patches correlate best, and how well (m,)."""
        frames = self._frames[rows]
        maps = self._templates.pitch[rows, None, None] * self._affinities[rows]
        # over the gate the lens is nearly affine: near enough for a whole sample
        linear = frames.jacobians(self._camera) @ maps
        pixels = self._camera.project(frames.bearings)[0]
        inside = np.flatnonzero(np.isfinite(linear).all((1, 2)))
        offsets, peaks = np.zeros((len(maps), 2)), np.full(len(maps), -1.0)
        if not len(inside):  # all of them are at the rim of the lens
            return offsets, peaks
        size = np.sqrt(np.abs(np.linalg.det(linear[inside])))
        reach = int(np.clip(np.ceil(gate_px / np.median(size)), 2, 40))
        side, patch = 2 * (reach + HALF) + 1, 2 * HALF + 1
        patches = self._templates.grey[rows].astype(np.float32).reshape(-1, patch, patch)
        for i in inside:
            to_image = np.column_stack([linear[i], pixels[i] - linear[i] @ (reach + HALF, reach + HALF)])
            window = cv2.warpAffine(
                image, to_image, (side, side), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
                borderMode=cv2.BORDER_REPLICATE,
            )  # fmt: skip
            offsets[i], peaks[i] = _best_place(window, patches[i])
        return np.einsum("nij,nj->ni", maps, offsets), peaks


def _best_place(window: FloatImage, patch: FloatImage) -> tuple[tuple[float, float], float]:
    """Where a patch correlates best, from the window's middle, and how; -1: elsewhere nearly as well."""
    alike = cv2.matchTemplate(window, patch, cv2.TM_CCOEFF_NORMED)
    row, column = divmod(int(np.argmax(alike)), alike.shape[1])
    best = float(alike[row, column])
    tops = (alike >= cv2.dilate(alike, np.ones((2 * PEAK + 1, 2 * PEAK + 1), np.uint8)))[1:-1, 1:-1]
    rivals = np.sort(alike[1:-1, 1:-1][tops])
    here = 0 < row < alike.shape[0] - 1 and 0 < column < alike.shape[1] - 1
    rival = float(rivals[-1 - here]) if len(rivals) > here else -1.0
    middle = alike.shape[0] // 2
    clear = best > PROMISING and rival < best - RIVAL
    return (column - middle, row - middle), best if clear else -1.0
