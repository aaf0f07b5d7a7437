"""A tag's corners from all its edges at once: the square whose code, blurred, is what the image shows.

Four straight sides in the world are four great circles of bearings, whatever the central camera; a square has
eight parameters, the matrix G that takes bearings to the tag's plane (`tag_kernels`). They are fitted, with
blur and illumination, to the grey values of the raw image, so that neither resampling nor a bent side biases
the corners, and the edges inside the tag count as well.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from omniservo.cameras.models.central_model import CentralModel
from omniservo.geometry.arrays import BoolArray, ByteArray, FloatArray
from omniservo.perception.tag_kernels import (
    PARAMETERS,
    POSE,
    cell_darkness,
    normal_equations,
)

CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
"""of the black square on its plane: top left, top right, bottom right, bottom left as printed"""
_PLACES = np.column_stack([CORNERS, np.ones(4)])
WHITE_CELLS = 0.6
"""of the white border that counts: what lies beyond one cell is unknown and blurs in"""
LEAST_CONTRAST = 10.0
"""grey values from dark to bright"""
_LEAST_VOLUME = 1e-9
"""of three corner bearings: less is a line"""
_FIRST_BLUR = 1.0
_BLUR = (0.25, 4.0)
_LARGEST_BOX = 40_000
"""pixels that are looked at, before some of them are chosen"""
_LARGEST_SIDE_PX = 1500.0
_UNEXPLAINED = 0.08
"""part of the grey values' variance that is shadow, glare and the like"""
_VARIANCE_OF_CODES = 0.2
"""of darkness 0 … 1 over a tag with its border"""
_CLEAR = 0.65
"""least darkness of a dark cell, and least brightness of a bright one, given all others"""
_UNCERTAIN = 0.2
"""largest standard deviation of a cell's darkness"""
_MOST_BLUR_CELLS = 0.75
_MODEL_ERROR = 0.005
"""[px] what remains without noise: the blur is not quite Gaussian, the camera not quite itself"""


class _Effort(NamedTuple):
    """What a fit may cost."""

    done_px: float
    """a step that moves no corner farther is the last; steps shrink at least tenfold near the end"""
    steps: int
    pixels: int


_RIM_EFFORT = _Effort(0.1, 6, 800)
"""enough to read the code, which is fitted next; most squares are no tags"""
_CODE_EFFORT = _Effort(0.01, 12, 2000)


@dataclass(frozen=True, eq=False)
class TagFit:
    """A square fitted to an image."""

    plane: FloatArray
    """G (3, 3): takes bearings to places (x, y, 1) on the tag, up to length"""
    others: FloatArray
    """(7,) log σ, and the six grey levels"""
    covariance: FloatArray
    """(8, 8) of the parameters of G"""
    rms: float
    """of the residuals [grey values]"""
    greys: FloatArray
    """(n,) of the pixels used"""
    rays: FloatArray
    """(n, 3, 3) of the same pixels"""
    side_px: float
    """mean side of the black square [px]"""

    def corner_bearings(self) -> FloatArray:
        """(4, 3) unit vectors."""
        return corner_bearings(self.plane)

    def agrees(self, dark: BoolArray, noise: float) -> bool:
        """Whether every cell has its colour, given the others, and the tag explains the grey values.

        A cell that the image does not show, because it is too small for blur or noise, is not agreed with.

        Args:
            dark: (cells, cells) the code that was fitted.
            noise: standard deviation of the image's grey values; it need not be explained.
        """
        if np.exp(self.others[0]) > _MOST_BLUR_CELLS * self.side_px / len(dark):
            return False
        darkness, information = np.empty(dark.shape), np.empty(dark.shape)
        state = (self.plane, self.others)
        part = cell_darkness(
            self.greys, self.rays, dark, outer_window(len(dark)), state, darkness, information
        )
        contrast = self.others[4]
        deviation = self.rms / contrast / np.sqrt(np.maximum(information, 1e-9))
        right = np.where(dark, darkness, 1.0 - darkness)
        by_noise = (noise / contrast) ** 2 / _VARIANCE_OF_CODES
        return bool(
            1.0 - part <= _UNEXPLAINED + by_noise and right.min() >= _CLEAR and deviation.max() <= _UNCERTAIN
        )


def planes_of(corners: FloatArray) -> FloatArray:
    """Return G (m, 3, 3) of squares with these corner bearings (n, 4, 3), without those that are none."""
    sides = np.stack([corners[:, 0], -corners[:, 1], corners[:, 2]], axis=2)
    sides = sides[good := np.abs(np.linalg.det(sides)) > _LEAST_VOLUME]
    corners = corners[good]
    length = np.linalg.solve(sides, corners[:, 3, :, None])[:, :, 0]
    good = (length > 1e-3).all(axis=1) & (length < 1e3).all(axis=1)
    to_bearing = (corners[:, :3] * length[:, :, None]).swapaxes(1, 2)[good] @ np.linalg.inv(_PLACES[:3].T)
    return np.asarray(np.linalg.inv(to_bearing))


def corner_bearings(plane: FloatArray) -> FloatArray:
    """Return the bearings (4, 3) of the square's corners."""
    rays = np.linalg.solve(plane, _PLACES.T).T
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))


def bearings_of(plane: FloatArray, places: FloatArray) -> FloatArray:
    """Return bearings (n, 3), any length, of places (n, 2) on the tag."""
    return np.asarray(np.linalg.solve(plane, np.column_stack([places, np.ones(len(places))]).T).T)


def outer_window(cells: int) -> float:
    """Largest |x|, |y| of a pixel that counts, on a tag of so many cells."""
    return 1.0 + 2.0 * WHITE_CELLS / cells


def fit_border(image: ByteArray, camera: CentralModel, plane: FloatArray, cells: int) -> TagFit | None:
    """Fit the black square's rim alone, whatever the code; None where there is no such square."""
    dark = np.ones((cells, cells), dtype=np.bool_)
    return _fit(image, camera, plane, dark, 1.0 - 2.0 * WHITE_CELLS / cells, _RIM_EFFORT)


def fit_code(image: ByteArray, camera: CentralModel, plane: FloatArray, dark: BoolArray) -> TagFit | None:
    """Fit the whole tag with this code (cells, cells); None where the image shows no such square."""
    return _fit(image, camera, plane, dark, 0.0, _CODE_EFFORT)


def corner_pixels(camera: CentralModel, fit: TagFit) -> tuple[FloatArray, FloatArray] | None:
    """Return pixels (4, 2) of the corners and their covariance (4, 2, 2), or None where one is not seen."""
    bearings = fit.corner_bearings()
    pixels, valid = camera.project(bearings)
    if not (valid.all() and camera.in_image(pixels).all()):
        return None
    around, seen = camera.unproject(pixels[:, None] + _STEPS_ROUND)
    if not seen.all():
        return None
    along = np.stack([around[:, 0] - around[:, 1], around[:, 2] - around[:, 3]], axis=2)
    q, dq = bearings @ fit.plane.T, fit.plane @ along
    x = q[:, :2] / q[:, 2:]
    places = (dq[:, :2] - x[:, :, None] * dq[:, 2:3]) / q[:, 2, None, None]
    moved = -np.linalg.solve(places, _corner_motion())
    covariance = moved @ fit.covariance @ moved.swapaxes(1, 2)
    return pixels, 0.5 * (covariance + covariance.swapaxes(1, 2)) + _MODEL_ERROR**2 * np.eye(2)


def _corner_motion() -> FloatArray:
    """∂(x, y)/∂δ (4, 2, 8) at the corners, for G ← (1 + δ) G."""
    motion = np.zeros((4, 2, POSE))
    motion[:, 0, :3] = motion[:, 1, 3:6] = _PLACES
    motion[:, :, 6:] = -CORNERS[:, :, None] * CORNERS[:, None, :]
    return motion


def _fit(
    image: ByteArray,
    camera: CentralModel,
    plane: FloatArray,
    dark: BoolArray,
    inner: float,
    effort: _Effort,
) -> TagFit | None:
    outer = outer_window(len(dark))
    collected = _pixels_around(image, camera, plane, (inner, outer), effort.pixels)
    if collected is None:
        return None
    greys, rays, side_px = collected
    window = np.array([inner, outer])
    low, high = np.percentile(greys, [10, 90])
    if high - low < LEAST_CONTRAST:
        return None
    others = np.array([np.log(_FIRST_BLUR), high, 0.0, 0.0, high - low, 0.0, 0.0])
    plane, rms, damping = plane.copy(), high - low, 1e-3
    matrix, vector = np.empty((PARAMETERS, PARAMETERS)), np.empty(PARAMETERS)
    trial_matrix, trial_vector = matrix.copy(), vector.copy()
    count, cost = normal_equations(greys, rays, dark, window, (plane, others), rms, matrix, vector)
    for _ in range(effort.steps):
        if count < 3 * PARAMETERS:
            return None
        rms = max(float(np.sqrt(cost)), 0.5)
        step = _step(matrix, vector, damping)
        shift = 0.5 * side_px * float(np.abs(_corner_motion() @ step[:POSE]).max())
        step *= min(1.0, 0.2 * side_px / max(shift, 1e-9))
        trial, trial_others = _turned(plane, step), others + step[POSE:]
        trial_others[0] = np.clip(trial_others[0], np.log(_BLUR[0]), np.log(_BLUR[1]))
        number, trial_cost = normal_equations(
            greys, rays, dark, window, (trial, trial_others), rms, trial_matrix, trial_vector
        )
        if number >= 0.7 * count and trial_cost <= cost * (1 + 1e-9):
            plane, others, count, cost = trial, trial_others, number, trial_cost
            matrix, trial_matrix, vector, trial_vector = trial_matrix, matrix, trial_vector, vector
            damping = max(0.1 * damping, 1e-7)
        else:
            damping *= 10.0
        if shift < effort.done_px:
            break
    if not others[4] - abs(others[5]) - abs(others[6]) > LEAST_CONTRAST:
        return None
    covariance = np.linalg.pinv(matrix)[:POSE, :POSE] * max(cost, 1.0 / 12.0) * count / (count - PARAMETERS)
    return TagFit(plane, others, covariance, max(float(np.sqrt(cost)), 0.3), greys, rays, side_px)


def _step(matrix: FloatArray, vector: FloatArray, damping: float) -> FloatArray:
    scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-12))
    scaled = matrix * np.outer(scale, scale) + damping * np.eye(PARAMETERS)
    try:
        return np.asarray(scale * np.linalg.solve(scaled, scale * vector))
    except np.linalg.LinAlgError:
        return np.zeros(PARAMETERS)


def _turned(plane: FloatArray, step: FloatArray) -> FloatArray:
    """(1 + δ) G."""
    return np.asarray(plane + np.append(step[:POSE], 0.0).reshape(3, 3) @ plane)


def _pixels_around(
    image: ByteArray, camera: CentralModel, plane: FloatArray, window: tuple[float, float], most: int
) -> tuple[FloatArray, FloatArray, float] | None:
    """Grey values and rays of at most ``most`` pixels between two squares on the tag, and its mean side [px].

    None where the tag is cut by the image's border, the lens's rim, a dead zone or a mask.
    """
    inner, outer = window
    outline, valid = camera.project(bearings_of(plane, _OUTLINE))
    if not (valid.all() and camera.in_image(outline).all()):
        return None
    side_px = float(np.linalg.norm(np.diff(outline, axis=0, append=outline[:1]), axis=1).sum() / 4.0)
    if not 6.0 < side_px < _LARGEST_SIDE_PX:
        return None
    spread = 0.5 * (outer - 1.0) * np.ptp(outline, axis=0) + 3.0
    size = np.array([image.shape[1], image.shape[0]])
    low = np.maximum(np.floor(outline.min(axis=0) - spread), 0.0)
    high = np.minimum(np.ceil(outline.max(axis=0) + spread), size - 1.0)
    pixels = _some_pixels(low, high)
    bearings, seen = camera.unproject(pixels)
    q = np.where(seen[:, None], bearings, 0.0) @ plane.T
    ahead = seen & (q[:, 2] > 1e-12)
    out = np.abs(q[:, :2]).max(axis=1) / np.where(ahead, q[:, 2], 1.0)
    near = np.flatnonzero(ahead & (out <= outer + 0.1) & (out >= inner - 0.1))
    near = near[:most]
    around, known = camera.unproject(pixels[near, None] + _STEPS_ROUND)
    good = known.all(axis=1) & camera.in_image(pixels[near])
    pixels, bearings, around = pixels[near][good], bearings[near][good], around[good]
    rays = np.stack([bearings, around[:, 0] - around[:, 1], around[:, 2] - around[:, 3]], axis=1)
    u, v = pixels.astype(np.int64).T
    return image[v, u].astype(np.float64), rays, side_px


def _some_pixels(low: FloatArray, high: FloatArray) -> FloatArray:
    """Pixels (n, 2) of a box in an order by chance, always the same; of a large box, one in each square."""
    step = max(1.0, np.floor(np.sqrt(np.prod(high - low + 1.0) / _LARGEST_BOX)))
    rng = np.random.default_rng(0)
    grid = np.stack(
        np.meshgrid(np.arange(low[0], high[0] + 1, step), np.arange(low[1], high[1] + 1, step)), -1
    )
    pixels = grid.reshape(-1, 2)
    if step > 1.0:
        # not in rows, which would meet an edge along them always at the same distance
        pixels = np.minimum(pixels + np.floor(rng.uniform(0.0, step, pixels.shape)), high)
    return np.asarray(pixels[rng.permutation(len(pixels))])


_STEPS_ROUND = np.array([[0.5, 0.0], [-0.5, 0.0], [0.0, 0.5], [0.0, -0.5]])
"""[px] for the derivatives of a bearing by its pixel"""
_ALONG = np.linspace(0.0, 1.0, 5)[:-1, None]
_OUTLINE = np.concatenate(
    [(1.0 - _ALONG) * a + _ALONG * b for a, b in zip(CORNERS, np.roll(CORNERS, -1, axis=0), strict=True)]
)
"""(16, 2) places round the black square"""
