"""Corners refined where they are known, searched where their neighbours say they must be."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import cKDTree

from omniservo.calibration.boards.local_map import local_map
from omniservo.calibration.boards.saddle_fit import FittedSaddles, fit_saddles
from omniservo.geometry.arrays import BoolArray, ByteArray, FloatArray, IntArray

_EXPLAINED = 0.8
_PURITY = 0.85  # of each quadrant's pixels on their side of the middle grey
_LEAST_CONTRAST = 3.0  # grey values, half the step from dark to bright
_OF_NEIGHBOURS = 0.2  # of the median contrast of all
_MOST_MOVED = 0.46  # of the window's reach
_MOST_TURNED = np.deg2rad(30.0)
_STRAY = 1.0  # of the window's reach
_ROUNDS = 40
_AROUND, _LEAST_AROUND = 2.3, 4  # steps; corners that a prediction needs within them


@dataclass
class Corners:
    """Places on a board and where their corners are seen so far; NaN where nothing is known."""

    image: ByteArray
    places: FloatArray
    """(n, 2) in steps of the lattice"""
    signs: FloatArray
    """(n,) ±1: contrast that the corner must have times this is the same for all; 0 where either may be"""
    reach: tuple[float, float]
    """see `fit_saddles`"""
    seen: BoolArray | None = None
    """(height, width) pixels that count; None for all"""
    pixels: FloatArray = field(init=False)
    contrast: FloatArray = field(init=False)
    tried: IntArray = field(init=False)

    def __post_init__(self) -> None:
        self.pixels = np.full((len(self.places), 2), np.nan)
        self.contrast = np.zeros(len(self.places))
        self.tried = np.zeros(len(self.places), dtype=np.int64)

    @property
    def known(self) -> BoolArray:
        """(n,) where the corner is known."""
        return np.isfinite(self.pixels[:, 0])

    def complete(self) -> None:
        """Refine what is known, search what is missing, and refine again with what is known by then."""
        for _ in range(2):
            self.refine()
            self.grow()
            self.drop_strays()
        self.refine()

    def drop_strays(self) -> None:
        """Drop corners that are not where the others say: another corner of the board, or none."""
        known = np.flatnonzero(self.known)
        places, pixels = self.places[known], self.pixels[known]
        expected, axes, ok = local_map(places, pixels, places, without_itself=True)
        steps = np.linalg.solve(axes[ok], (pixels - expected)[ok][:, :, None])[:, :, 0]
        self.pixels[known[ok][np.abs(steps).max(axis=1, initial=0.0) > _STRAY * self.reach[0]]] = np.nan

    def refine(self) -> None:
        """Fit all known corners again, each with a window as large as its neighbours allow; drop the bad."""
        known = np.flatnonzero(self.known)
        if len(known) < 3:
            self.pixels[:] = np.nan
            return
        _, axes, ok = local_map(self.places[known], self.pixels[known], self.places[known])
        fitted = fit_saddles(self.image, self.pixels[known[ok]], axes[ok], self.reach, self.seen)
        good = self._is_corner(fitted, self.pixels[known[ok]], axes[ok], known[ok])
        self.pixels[known] = np.nan
        self._keep(fitted, good, known[ok])

    def grow(self) -> None:
        """Search the missing corners beside known ones, and again beside those, until no more are found."""
        size = np.array([self.image.shape[1], self.image.shape[0]])
        for _ in range(_ROUNDS):
            known = np.flatnonzero(self.known)
            around = self._known_around(known)
            missing = np.flatnonzero(~self.known & (around >= _LEAST_AROUND) & (around > self.tried))
            if len(missing) == 0:
                return
            self.tried[missing] = around[missing]
            pixels, axes, ok = local_map(self.places[known], self.pixels[known], self.places[missing])
            ok &= ((pixels > -0.5) & (pixels < size - 0.5)).all(axis=1)
            missing, pixels, axes = missing[ok], pixels[ok], axes[ok]
            self._fit_at(missing, pixels, axes)

    def search(self, rows: IntArray, pixels: FloatArray, axes: FloatArray) -> None:
        """Search the corners ``rows``; ``pixels`` (n, 2), ``axes`` (n, 2, 2) say where all are seen."""
        self._fit_at(rows, pixels[rows], axes[rows])

    def _fit_at(self, rows: IntArray, pixels: FloatArray, axes: FloatArray) -> None:
        fitted = fit_saddles(self.image, pixels, axes, self.reach, self.seen)
        good = self._is_corner(fitted, pixels, axes, rows)
        self._keep(fitted, good, rows)

    def _known_around(self, known: IntArray) -> IntArray:
        """How many known corners lie near each place: those that a prediction would rest on."""
        if len(known) == 0:
            return np.zeros(len(self.places), dtype=np.int64)
        near = cKDTree(self.places[known]).query_ball_point(self.places, _AROUND, return_length=True)
        return np.asarray(near, dtype=np.int64)

    def _keep(self, fitted: FittedSaddles, good: BoolArray, rows: IntArray) -> None:
        self.pixels[rows[good]] = fitted.pixels[good]
        self.contrast[rows[good]] = fitted.contrast[good]

    def _is_corner(
        self, fitted: FittedSaddles, starts: FloatArray, axes: FloatArray, rows: IntArray
    ) -> BoolArray:
        if len(starts) == 0:
            return np.zeros(0, dtype=bool)
        moved = np.linalg.solve(axes, (fitted.pixels - starts)[:, :, None])[:, :, 0]
        signed = np.where(self.signs[rows] == 0, np.abs(fitted.contrast), fitted.contrast * self.signs[rows])
        known = self.known
        held = np.where(self.signs == 0, np.abs(self.contrast), self.contrast * self.signs)[known]
        usual = float(np.median(held)) if np.any(held) else float(np.median(signed))
        return np.asarray(
            (fitted.explained >= _EXPLAINED)
            & (fitted.purity >= _PURITY)
            & (signed * np.sign(usual) >= max(_LEAST_CONTRAST, _OF_NEIGHBOURS * abs(usual)))
            & (np.abs(moved).max(axis=1) <= _MOST_MOVED * self.reach[0])
            & (fitted.turned <= _MOST_TURNED)
        )
