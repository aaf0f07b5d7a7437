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
from omniservo.perception.tag_codes import TagCodes
from omniservo.perception.tag_kernels import D13, D23, PARAMETERS, POSE, cell_darkness, normal_equations
from omniservo.tag_dictionaries import TagLayout

CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
"""of the print on its plane: top left, top right, bottom right, bottom left"""
_UNKNOWN_CELLS = 0.4
"""pixels so near to what the tag does not print do not count: what is there is unknown and blurs in"""
LEAST_CONTRAST = 10.0
"""grey values from dark to bright"""
_LEAST_VOLUME = 1e-9
"""of three corner bearings: less is a line"""
_FIRST_BLUR = 1.0
_BLUR = (0.25, 4.0)
_LARGEST_BOX = 40_000
"""pixels that are checked, before some of them are chosen"""
_LARGEST_SIDE_PX = 1500.0
_UNEXPLAINED = 0.08
"""part of the grey values' variance that is shadow, glare and the like"""
_VARIANCE_OF_CODES = 0.2
"""of darkness 0 … 1 over a tag with its border"""
_CLEAR = 0.65
"""least darkness of a dark cell, and least brightness of a bright one, given all others"""
_UNCERTAIN = 0.1
"""largest standard deviation of a cell's darkness"""
_MOST_BLUR_CELLS = 0.75
_AT_CORNERS = 2.0
"""Corners are off so many times as far as parts of a tag: they are at its ends (measured on bent images)."""
_PARTS = 4
"""along a side, into which a tag is cut to see whether it is flat"""
_LEAST_OF_PART = 6
"""pixels"""
_LONGEST_PART = 1e3
"""condition of a part's information: more is an edge in one direction alone"""
_SHIFT = np.ix_([D13, D23], [D13, D23])
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

    layout: TagLayout
    dark: BoolArray
    """(cells, cells) that was fitted"""
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
    """mean side of the print [px]"""

    def corner_places(self) -> FloatArray:
        """Where on the tag (4, 3) its corners are, (x, y, 1)."""
        return np.column_stack([self.layout.border / self.layout.cells * CORNERS, np.ones(4)])

    def agrees(self, noise: float) -> bool:
        """Whether every cell has its colour, given the others, and the tag explains the grey values.

        A cell that the image does not show, because it is too small for blur or noise, is not agreed with.

        Args:
            noise: standard deviation of the image's grey values; it need not be explained.
        """
        cells = len(self.dark)
        if np.exp(self.others[0]) > _MOST_BLUR_CELLS * self.side_px / cells:
            return False
        darkness, information = np.empty(self.dark.shape), np.empty(self.dark.shape)
        state = (self.plane, self.others)
        part = cell_darkness(
            self.greys, self.rays, self.dark, _outer_window(self.layout), state, darkness, information
        )
        contrast, read = self.others[4], self.layout.read
        deviation = self.rms / contrast / np.sqrt(np.maximum(information[read], 1e-9))
        right = np.where(self.dark, darkness, 1.0 - darkness)[read]
        by_noise = (noise / contrast) ** 2 / _VARIANCE_OF_CODES
        return bool(
            1.0 - part <= _UNEXPLAINED + by_noise and right.min() >= _CLEAR and deviation.max() <= _UNCERTAIN
        )


def planes_of(corners: FloatArray, edge: float) -> FloatArray:
    """Return G (m, 3, 3) of prints by their corner bearings (n, 4, 3), without those that are none.

    The corners are those of the square |x|, |y| ≤ edge.
    """
    sides = np.stack([corners[:, 0], -corners[:, 1], corners[:, 2]], axis=2)
    sides = sides[good := np.abs(np.linalg.det(sides)) > _LEAST_VOLUME]
    corners = corners[good]
    length = np.linalg.solve(sides, corners[:, 3, :, None])[:, :, 0]
    good = (length > 1e-3).all(axis=1) & (length < 1e3).all(axis=1)
    places = np.column_stack([edge * CORNERS[:3], np.ones(3)])
    to_bearing = (corners[:, :3] * length[:, :, None]).swapaxes(1, 2)[good] @ np.linalg.inv(places.T)
    return np.asarray(np.linalg.inv(to_bearing))


def bearings_of(plane: FloatArray, places: FloatArray) -> FloatArray:
    """Return bearings (n, 3), any length, of places (n, 2) on the tag."""
    return np.asarray(np.linalg.solve(plane, np.column_stack([places, np.ones(len(places))]).T).T)


def _outer_window(layout: TagLayout) -> float:
    """Largest |x|, |y| of a pixel that counts."""
    return 1.0 - 2.0 * _UNKNOWN_CELLS / layout.cells


def fit_border(image: ByteArray, camera: CentralModel, plane: FloatArray, layout: TagLayout) -> TagFit | None:
    """Fit the square's rim alone, whatever the code; None where there is no such square."""
    nearer = 1.0 - _UNKNOWN_CELLS
    window = np.array([layout.border - 2.0 * nearer, layout.border + 2.0 * nearer]) / layout.cells
    return _fit(
        _Print(image, camera, layout), plane, layout.square ^ layout.bright_inside, window, _RIM_EFFORT
    )


def fit_code(
    image: ByteArray, camera: CentralModel, plane: FloatArray, codes: TagCodes, number: int
) -> TagFit | None:
    """Fit the whole tag with the code of this number; None where the image shows no such square."""
    window = np.array([0.0, _outer_window(codes.layout)])
    return _fit(_Print(image, camera, codes.layout), plane, codes.dark[number], window, _CODE_EFFORT)


def corner_pixels(camera: CentralModel, fit: TagFit) -> FloatArray | None:
    """Return pixels (4, 2) of the corners, or None where one is not seen."""
    pixels, valid = camera.project(bearings_of(fit.plane, fit.corner_places()[:, :2]))
    return pixels if valid.all() and camera.in_image(pixels).all() else None


def corner_covariance(camera: CentralModel, fit: TagFit, pixels: FloatArray) -> FloatArray | None:
    """Return the covariance (4, 2, 2) [px²] of corners at these pixels, or None where one is at the rim.

    It is that of the noise, and in every direction the variance by which parts of the tag lie elsewhere than
    one flat square has them: a print that is not flat, a lens that bends it, an image that was compressed.
    """
    rays, seen = camera.unproject(pixels)
    around, near = camera.unproject(pixels[:, None] + _STEPS_ROUND)
    if not (seen.all() and near.all()):
        return None
    along = np.stack([around[:, 0] - around[:, 1], around[:, 2] - around[:, 3]], axis=2)
    moved = -np.linalg.solve(_places(fit.plane, rays, along)[1], _corner_motion(fit.corner_places()))
    covariance = moved @ fit.covariance @ moved.swapaxes(1, 2)
    more = _MODEL_ERROR**2 + _AT_CORNERS**2 * _unevenness(fit)
    return np.asarray(0.5 * (covariance + covariance.swapaxes(1, 2)) + more * np.eye(2))


def _places(plane: FloatArray, rays: FloatArray, along: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Places (n, 2) on the tag of bearings (n, 3), and their derivatives (n, 2, 2) by the pixels.

    ``along`` (n, 3, 2) are the bearings' derivatives by u and v.
    """
    q, dq = rays @ plane.T, plane @ along
    x = q[:, :2] / q[:, 2:]
    return x, (dq[:, :2] - x[:, :, None] * dq[:, 2:3]) / q[:, 2, None, None]


def _unevenness(fit: TagFit) -> float:
    """Variance [px²] of a coordinate by which parts of the tag lie elsewhere than the fit has them.

    The tag is cut into parts, and each part's displacement d follows from its own residuals, with information
    Λ. Of noise alone Σ dᵀΛd is χ² with as many degrees as the fit leaves free; more than its mean and one
    standard deviation is theirs.
    """
    places, by_pixels = _places(fit.plane, fit.rays[:, 0], fit.rays[:, 1:].swapaxes(1, 2))
    window = np.array([0.0, _outer_window(fit.layout)])
    part = np.clip(np.floor(0.5 * _PARTS * (places / window[1] + 1.0)), 0, _PARTS - 1) @ [_PARTS, 1]
    matrix, vector = np.empty((PARAMETERS, PARAMETERS)), np.empty(PARAMETERS)
    square, information, free = 0.0, 0.0, -POSE
    for number in range(_PARTS**2):
        inside = part == number
        if np.count_nonzero(inside) < _LEAST_OF_PART:
            continue
        seen, state = (fit.greys[inside], fit.rays[inside]), (fit.plane, fit.others)
        normal_equations(*seen, fit.dark, window, state, fit.rms, matrix, vector)
        turn = by_pixels[inside].mean(axis=0)
        known = turn.T @ matrix[_SHIFT] @ turn / fit.rms**2
        pull = turn.T @ vector[[D13, D23]] / fit.rms**2
        if np.linalg.cond(known) < _LONGEST_PART:
            square += float(pull @ np.linalg.solve(known, pull))
            information += float(np.trace(known))
            free += 2
    free = max(free, 1)
    return max(square - free - np.sqrt(2.0 * free), 0.0) / information if information else 0.0


def _corner_motion(places: FloatArray) -> FloatArray:
    """∂(x, y)/∂δ (4, 2, 8) at places (4, 3) on the tag, for G ← (1 + δ) G."""
    motion = np.zeros((4, 2, POSE))
    motion[:, 0, :3] = motion[:, 1, 3:6] = places
    motion[:, :, 6:] = -places[:, :2, None] * places[:, None, :2]
    return motion


class _Print(NamedTuple):
    """A tag in an image, wherever it may be."""

    image: ByteArray
    camera: CentralModel
    layout: TagLayout


def _fit(
    seen: _Print, plane: FloatArray, dark: BoolArray, window: FloatArray, effort: _Effort
) -> TagFit | None:
    collected = _pixels_around(seen, plane, window, effort.pixels)
    if collected is None:
        return None
    greys, rays, side_px = collected
    low, high = np.percentile(greys, [10, 90])
    if high - low < LEAST_CONTRAST:
        return None
    others = np.array([np.log(_FIRST_BLUR), high, 0.0, 0.0, high - low, 0.0, 0.0])
    plane, rms, damping = plane.copy(), high - low, 1e-3
    matrix, vector = np.empty((PARAMETERS, PARAMETERS)), np.empty(PARAMETERS)
    motion = _corner_motion(np.column_stack([CORNERS, np.ones(4)]))
    trial_matrix, trial_vector = matrix.copy(), vector.copy()
    count, cost = normal_equations(greys, rays, dark, window, (plane, others), rms, matrix, vector)
    for _ in range(effort.steps):
        if count < 3 * PARAMETERS:
            return None
        rms = max(float(np.sqrt(cost)), 0.5)
        step = _step(matrix, vector, damping)
        shift = 0.5 * side_px * float(np.abs(motion @ step[:POSE]).max())
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
    rms = max(float(np.sqrt(cost)), 0.3)
    return TagFit(seen.layout, dark, plane, others, covariance, rms, greys, rays, side_px)


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
    seen: _Print, plane: FloatArray, window: FloatArray, most: int
) -> tuple[FloatArray, FloatArray, float] | None:
    """Grey values and rays of at most ``most`` pixels between two squares on the tag, and its mean side [px].

    None where what is read of the tag is cut by the image's border, the lens's rim, a dead zone or a mask.
    """
    image, camera, layout = seen
    inner, outer = window
    reach = 1.0 if layout.bright_inside else layout.border / layout.cells
    outline, valid = camera.project(bearings_of(plane, reach * _OUTLINE))
    if not (valid.all() and camera.in_image(outline).all()):
        return None
    around_px = float(np.linalg.norm(np.diff(outline, axis=0, append=outline[:1]), axis=1).sum() / 4.0)
    if not 6.0 < around_px < _LARGEST_SIDE_PX:
        return None
    spread = 0.5 * max(outer / reach - 1.0, 0.0) * np.ptp(outline, axis=0) + 3.0
    size = np.array([image.shape[1], image.shape[0]])
    low = np.maximum(np.floor(outline.min(axis=0) - spread), 0.0)
    high = np.minimum(np.ceil(outline.max(axis=0) + spread), size - 1.0)
    pixels = _some_pixels(low, high)
    bearings, has_ray = camera.unproject(pixels)
    q = np.where(has_ray[:, None], bearings, 0.0) @ plane.T
    ahead = has_ray & (q[:, 2] > 1e-12)
    places = q[:, :2] / np.where(ahead, q[:, 2], 1.0)[:, None]
    out = np.abs(places).max(axis=1)
    ahead &= (out <= outer + 0.1) & (out >= inner - 0.1)
    near = np.flatnonzero(ahead & _is_known(layout, places))[:most]
    around, known = camera.unproject(pixels[near, None] + _STEPS_ROUND)
    good = known.all(axis=1) & camera.in_image(pixels[near])
    pixels, bearings, around = pixels[near][good], bearings[near][good], around[good]
    rays = np.stack([bearings, around[:, 0] - around[:, 1], around[:, 2] - around[:, 3]], axis=1)
    u, v = pixels.astype(np.int64).T
    return image[v, u].astype(np.float64), rays, around_px / reach


def _is_known(layout: TagLayout, places: FloatArray) -> BoolArray:
    """Which places (n, 2) on the tag are far enough from cells that are not printed."""
    known = np.ones(len(places), dtype=np.bool_)
    if layout.printed.all():
        return known
    cells = 0.5 * layout.cells * (places + 1.0)
    for corner in CORNERS:
        column, row = np.clip(np.floor(cells + _UNKNOWN_CELLS * corner), 0, layout.cells - 1).astype(int).T
        known &= layout.printed[row, column]
    return known


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
