"""Images with detail like that of real surfaces, made from a seed: what natural features are found on."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from scipy.fft import fftfreq, irfft2, rfftfreq

from omniservo.errors import InputError, spelled
from omniservo.geometry.arrays import FloatArray, finite_number

LONGEST = 4096
"""Most rows or columns of an image."""

_PAPER, _INK = 0.80, 0.04
_STONES_ACROSS = 9  # along the longer side
_PLANKS_ACROSS = 5
_SMALLEST = 16
"""Least rows or columns."""


def texture(kind: str, seed: int, rows: int, columns: int) -> FloatArray:
    """Return an image (rows, columns) of linear greys in [0, 1].

    Everything in it scales with its longer side; all sizes of detail down to single elements occur, their
    strength falling about as 1/f like in photographs of nature (Field 1987).

    Args:
        kind: one of `texture_kinds`: "stones", a wall of rubble; "poster", print with images and lines of
            letters; "crate", weathered planks with nails and a stencil.
        seed: which one of its kind.
        rows: 16 … `LONGEST`
        columns: 16 … `LONGEST`

    Raises:
        InputError: no such kind, or a number out of range.
    """
    if kind not in _KINDS:
        raise InputError(f"kind: {spelled(kind)} given; legal: {', '.join(_KINDS)}")
    for name, value in (("rows", rows), ("columns", columns)):
        finite_number(name, value, minimum=_SMALLEST, maximum=LONGEST)
    finite_number("seed", seed, minimum=0)
    picture = _KINDS[kind](np.random.default_rng(seed), int(rows), int(columns))
    return np.clip(picture, 0.02, 0.95)


def texture_kinds() -> tuple[str, ...]:
    """Return the kinds that `texture` makes."""
    return tuple(_KINDS)


def _cloud(
    rng: np.random.Generator, rows: int, columns: int, *, fall: float = 1.0, stretch: float = 1.0
) -> FloatArray:
    """Noise of mean 0 and standard deviation 1 whose amplitude falls as f^-fall; ``stretch``: longer in y."""
    down = fftfreq(rows)[:, None] * stretch
    across = rfftfreq(columns)[None, :]
    frequency = np.hypot(down, across)
    frequency[0, 0] = np.inf
    phases = rng.uniform(0.0, 2.0 * np.pi, frequency.shape)
    cloud: FloatArray = irfft2(np.exp(1j * phases) / frequency**fall, s=(rows, columns))
    cloud -= cloud.mean()
    cloud /= cloud.std()
    return cloud


def _stones(rng: np.random.Generator, rows: int, columns: int) -> FloatArray:
    """Cells round jittered points (Worley 1996), each with its own tone, mortar between, grain over all."""
    side = max(rows, columns) / _STONES_ACROSS
    shape = (int(np.ceil(rows / side)) + 2, int(np.ceil(columns / side)) + 2)
    jitter = rng.uniform(0.08, 0.92, (2, *shape))
    tones = rng.uniform(0.10, 0.60, shape)
    y, x = (
        np.indices((rows, columns))[axis] / side + 0.05 * _cloud(rng, rows, columns, fall=1.8)
        for axis in (0, 1)
    )
    row, column = (
        np.clip(np.floor(place).astype(np.int64) + 1, 1, count - 2)
        for place, count in zip((y, x), shape, strict=True)
    )
    nearest = np.full((rows, columns), np.inf)
    second, tone = nearest.copy(), np.zeros((rows, columns))
    middles = np.indices(shape) - 1 + jitter
    for down, across in np.ndindex(3, 3):
        i, j = row + down - 1, column + across - 1
        distance = np.hypot(middles[0, i, j] - y, middles[1, i, j] - x)
        tone = np.where(distance < nearest, tones[i, j], tone)
        second = np.minimum(second, np.maximum(distance, nearest))
        nearest = np.minimum(nearest, distance)
    height = np.minimum((second - nearest) / 0.30, 1.0)  # of the stone above its mortar
    slope = np.gradient(height, 1.0 / side)
    light = 1.0 - 0.06 * np.clip(slope[0] + slope[1], -5.0, 5.0)
    grain = _cloud(rng, rows, columns)
    stone = tone * light * (1.0 + 0.20 * grain) + 0.03 * _cloud(rng, rows, columns, fall=0.5)
    return np.where(height < 0.18, 0.07 + 0.015 * grain, stone)


def _poster(rng: np.random.Generator, rows: int, columns: int) -> FloatArray:
    """Coloured areas as greys, images in few tones, discs and bars, headlines and lines of letters."""
    side = max(rows, columns)
    picture = np.full((rows, columns), _PAPER)
    for row, column in _spread(rng, 16):
        height, width = (rng.uniform(0.10, 0.38, 2) * side).astype(int)
        top, left = int(row * rows) - height // 2, int(column * columns) - width // 2
        area = picture[max(top, 0) : top + height, max(left, 0) : left + width]
        if min(area.shape) >= _SMALLEST:
            area[:] = rng.uniform(0.1, 0.75) if rng.uniform() < 0.4 else _print_of(rng, *area.shape)
    for row, column in _spread(rng, 12):
        _disc(picture, row * rows, column * columns, rng.uniform(0.012, 0.06) * side, rng)
    for row, column in _spread(rng, 14):
        height = max(int(rng.choice([0.012, 0.018, 0.03, 0.055]) * side), 4)
        for line in range(int(rng.integers(1, 5))):
            top = int(row * rows) + int(1.5 * line * height)
            _letters(picture, rng, top, max(int(column * columns) - 4 * height, 0), height)
    return picture + 0.012 * _cloud(rng, rows, columns)


def _spread(rng: np.random.Generator, count: int) -> FloatArray:
    """Places (count, 2) in the unit square without large gaps: steps by a generalised golden ratio."""
    steps = np.arange(count)[:, None] * np.array([0.7548776662466927, 0.5698402909980532])
    places: FloatArray = (rng.uniform(size=2) + steps) % 1.0
    return places


def _print_of(rng: np.random.Generator, rows: int, columns: int) -> FloatArray:
    """An image in five tones."""
    tones = np.sort(rng.uniform(0.05, 0.8, 5))
    return tones[np.digitize(_cloud(rng, rows, columns, fall=1.6), [-1.0, -0.3, 0.3, 1.0])]


def _disc(picture: FloatArray, row: float, column: float, radius: float, rng: np.random.Generator) -> None:
    """Put a disc or a ring into the image."""
    around, distance = _around(picture, row, column, radius)
    hole = radius * rng.choice([0.0, 0.0, 0.6])
    around[(distance < radius) & (distance >= hole)] = rng.choice([_INK, _PAPER, 0.3])


def _around(picture: FloatArray, row: float, column: float, radius: float) -> tuple[FloatArray, FloatArray]:
    """Return the part of an image that holds a circle, and every element's distance from its centre."""
    top, left = (max(int(place - radius), 0) for place in (row, column))
    part = picture[top : int(row + radius) + 2, left : int(column + radius) + 2]
    y, x = np.ogrid[top : top + part.shape[0], left : left + part.shape[1]]
    return part, np.hypot(y - row, x - column)


def _letters(picture: FloatArray, rng: np.random.Generator, top: int, left: int, height: int) -> None:
    """Put a line of made-up letters into the image: two to four strokes each on a grid of 5 × 4."""
    ink = _INK if rng.uniform() < 0.8 else _PAPER
    stroke = max(height // 6, 1)
    for _ in range(int(rng.integers(4, 16))):
        if rng.uniform() < 0.8:
            for _ in range(int(rng.integers(2, 5))):
                y, x = top + height * rng.integers(0, 5) // 5, left + 3 * height * rng.integers(0, 3) // 20
                if rng.uniform() < 0.5:
                    picture[y : y + stroke, x : x + height // 2] = ink
                else:
                    picture[top : top + height, x : x + stroke] = ink
        left += 7 * height // 10


def _crate(rng: np.random.Generator, rows: int, columns: int) -> FloatArray:
    """Upright planks with grain, gaps and nails, and a stencilled mark."""
    side = max(rows, columns)
    picture = np.empty((rows, columns))
    edges = np.unique(np.linspace(0, columns, max(round(_PLANKS_ACROSS * columns / side), 1) + 1).astype(int))
    for left, right in pairwise(edges):
        grain = _cloud(rng, rows, right - left, stretch=12.0)
        picture[:, left:right] = rng.uniform(0.28, 0.5) * (1.0 + 0.22 * grain)
        picture[:, left : left + max(side // 200, 1)] = 0.04
        for row in (0.06, 0.94):
            for column in (0.25, 0.75):
                middle = left + column * (right - left)
                head, distance = _around(picture, row * rows, middle, 0.008 * side)
                head[distance < 0.008 * side] = 0.06
    for _ in range(8):
        height = int(rng.uniform(0.05, 0.11) * side)
        _letters(picture, rng, int(rng.integers(0, rows)), int(rng.integers(0, columns)), max(height, 4))
    return picture * (1.0 + 0.12 * _cloud(rng, rows, columns))


_KINDS: dict[str, Callable[[np.random.Generator, int, int], FloatArray]] = {
    "stones": _stones,
    "poster": _poster,
    "crate": _crate,
}
