"""The corner between four squares to a few hundredths of a pixel: two blurred, bent edges that cross."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omniservo.calibration.boards.saddle_kernels import (
    ANGLE_1,
    BEND_1,
    CONTRAST,
    LOG_BLUR,
    PARAMETERS,
    fit_crossings,
)
from omniservo.geometry.arrays import BoolArray, ByteArray, FloatArray

LARGEST_RADIUS = 9.0
"""[px] farther pixels tell little more about the crossing"""


@dataclass(frozen=True)
class FittedSaddles:
    """What the fit says of each start."""

    pixels: FloatArray
    """(n, 2) [px]; NaN where there was nothing to fit"""
    explained: FloatArray
    """(n,) part of the grey values' variance that the crossing explains, at most 1"""
    purity: FloatArray
    """(n,) least part, over the quadrants, of pixels that are on their quadrant's side of the middle grey"""
    contrast: FloatArray
    """(n,) half the grey values from dark to bright, positive where the sector between +x and +y is bright"""
    turned: FloatArray
    """(n,) [rad] by how much an edge turned away from the direction it started with, at most"""
    blur: FloatArray
    """(n,) [px] standard deviation of the edges' blur"""


def fit_saddles(
    image: ByteArray,
    starts: FloatArray,
    axes: FloatArray,
    reach: tuple[float, float] = (0.65, 0.65),
    seen: BoolArray | None = None,
) -> FittedSaddles:
    """Fit the crossing of two edges to the grey values around each start, by damped least squares.

    With q = p − c the offset from the corner, tᵢ and nᵢ its parts along and across edge i,
    d = n − ½κt² (an edge may bend), and σ the blur, the grey value at p is

        I(p) = a + g·q + b erf(d₁/(√2 σ)) erf(d₂/(√2 σ)).

    No edge has to be straight, so strongly distorted squares do not bias their corners.

    Args:
        image: (height, width) grey values.
        starts: (n, 2) [px] where the corners are expected.
        axes: (n, 2, 2) [px] columns: from the corner to the next in +x and in +y of the board.
        reach: (along, across) the window in steps of the lattice: pixels at most ``along`` from the corner
            in x and in y, and at most ``across`` in the smaller of the two.
        seen: (height, width) pixels that count; None for all.
    """
    count = len(starts)
    states, results = np.zeros((count, PARAMETERS)), np.zeros((count, 3))
    limits = np.array([reach[0], reach[1], LARGEST_RADIUS])
    if count:
        fit_crossings(
            np.ascontiguousarray(image),
            np.ascontiguousarray(starts, dtype=np.float64),
            np.ascontiguousarray(axes, dtype=np.float64),
            limits,
            np.zeros((0, 0), dtype=np.bool_) if seen is None else np.array(seen, dtype=np.bool_, order="C"),
            states,
            results,
        )
    pixels = starts + states[:, :2]
    size = np.array([image.shape[1], image.shape[0]])
    done = (results[:, 2] >= 2 * PARAMETERS) & ((pixels >= -0.5) & (pixels <= size - 0.5)).all(axis=1)
    before = np.arctan2(axes[:, 1, :], axes[:, 0, :])
    turned = np.abs((states[:, ANGLE_1:BEND_1] - before + np.pi) % (2 * np.pi) - np.pi).max(
        axis=1, initial=0.0
    )
    return FittedSaddles(
        np.where(done[:, None], pixels, np.nan),
        np.where(done, results[:, 0], 0.0),
        results[:, 1],
        states[:, CONTRAST],
        turned,
        np.exp(states[:, LOG_BLUR]),
    )
