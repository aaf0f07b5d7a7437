"""Calibration boards: flat targets whose points are known by name and place."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from omniservo.errors import InputError
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray, finite_number

MOST_CELLS = 100
"""most columns or rows of a board"""


@with_field_docs
@dataclass(frozen=True)
class Board(ABC):
    """What all boards have: ``points`` (n, 3) [m] with z = 0, right-handed; a point's identity is its row."""

    columns: int
    rows: int

    def __post_init__(self) -> None:
        for name in ("columns", "rows"):
            whole_number(name, getattr(self, name), minimum=2)

    @property
    def points(self) -> FloatArray:
        """(n, 3) [m] in the board's frame."""
        flat = self.pitch * self.places
        return np.concatenate([flat, np.zeros((len(flat), 1))], axis=1)

    @property
    @abstractmethod
    def pitch(self) -> float:
        """Distance between neighbouring points along x [m]; the unit of `places`."""

    @cached_property
    def places(self) -> FloatArray:
        """(n, 2) points in units of the pitch, row by row, x fastest."""
        row, column = np.mgrid[0 : self.rows, 0 : self.columns]
        return np.stack([column.ravel(), row.ravel()], axis=1).astype(np.float64)


@with_field_docs
@dataclass(frozen=True)
class Checkerboard(Board):
    """A chequered board, counted in inner corners.

    x runs along the ``columns``, y along the ``rows``, z away from who looks at it; the square before the
    first corner in x and in y is dark where the number of columns plus rows is odd. Where it is even, the
    board looks the same turned by 180°, and which corner is the first is a choice made for each view.
    """

    square: float

    def __post_init__(self) -> None:
        super().__post_init__()
        length("square", self.square)

    @property
    def pitch(self) -> float:
        """Side of a square [m]."""
        return self.square


@with_field_docs
@dataclass(frozen=True)
class CharucoBoard(Board):
    """A chequered board with ArUco markers in its bright squares, as OpenCV prints it; counted in squares.

    The points are the inner corners, row by row; x right, y down, z into the board, as OpenCV's; the first
    corner is the one at (square, square) there.
    """

    square: float
    marker: float
    dictionary: str

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("columns", "rows"):
            whole_number(name, getattr(self, name), minimum=3)
        length("square", self.square)
        length("marker", self.marker)
        if not self.marker < self.square:
            raise InputError(f"marker: {self.marker:g} given; legal: less than the square, {self.square:g}")

    @property
    def pitch(self) -> float:
        """Side of a square [m]."""
        return self.square

    @cached_property
    def places(self) -> FloatArray:
        """(n, 2) inner corners in units of the pitch."""
        row, column = np.mgrid[1 : self.rows, 1 : self.columns]
        return np.stack([column.ravel(), row.ravel()], axis=1).astype(np.float64)

    @cached_property
    def marker_corners(self) -> FloatArray:
        """(m, 4, 2) corners of the markers in units of the pitch, clockwise from the top left, by number."""
        return self._marker_corners(1)

    @cached_property
    def legacy_marker_corners(self) -> FloatArray:
        """The same as OpenCV printed them before 4.6: with an even number of rows they begin with one."""
        return self._marker_corners(self.rows % 2)

    def _marker_corners(self, parity: int) -> FloatArray:
        row, column = np.mgrid[0 : self.rows, 0 : self.columns].reshape(2, -1)
        bright = (row + column) % 2 == parity
        half = 0.5 * self.marker / self.square
        middle = np.stack([column[bright], row[bright]], axis=1) + 0.5
        return np.asarray(middle[:, None, :] + half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]))


@with_field_docs
@dataclass(frozen=True)
class AprilGrid(Board):
    """Kalibr's grid of AprilTags 36h11 with dark squares between their corners; counted in tags.

    x right, y up, z to who looks at it. Tag 0 is at the bottom left, numbers grow to the right, then up.
    Point 4k + c is corner c of tag k: bottom left, bottom right, top right, top left (Kalibr's
    GridCalibrationTargetAprilgrid holds the same points in rows over the whole grid).
    """

    tag: float
    ratio: float

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.columns * self.rows > 587:
            raise InputError(f"tags: {self.columns}×{self.rows} given; legal: at most 587, all of 36h11")
        length("tag size", self.tag)
        finite_number("spacing ratio", self.ratio, above=0.05, maximum=1.0)

    @property
    def pitch(self) -> float:
        """Side of a tag [m]."""
        return self.tag

    @cached_property
    def places(self) -> FloatArray:
        """(4·tags, 2) corners in units of the tag's side."""
        row, column = np.mgrid[0 : self.rows, 0 : self.columns].reshape(2, -1)
        start = np.stack([column, row], axis=1) * (1.0 + self.ratio)
        corners = start[:, None, :] + np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float64)
        return np.asarray(corners.reshape(-1, 2))


@with_field_docs
@dataclass(frozen=True)
class CircleGrid(Board):
    """Dark discs on a bright ground, in a square grid, or asymmetric as OpenCV's.

    ``spacing`` is the distance between neighbouring discs of a row (symmetric). An asymmetric grid has disc
    (i, j) at ((2i + j mod 2)·spacing, j·spacing): OpenCV's ``calcBoardCornerPositions``.
    """

    spacing: float
    diameter: float
    layout: Literal["symmetric", "asymmetric"] = "symmetric"

    def __post_init__(self) -> None:
        super().__post_init__()
        length("spacing", self.spacing)
        length("diameter", self.diameter)
        nearest = self.spacing * (1.0 if self.layout == "symmetric" else np.sqrt(2.0))
        if not self.diameter < 0.9 * nearest:
            raise InputError(f"diameter: {self.diameter:g} given; legal: less than {0.9 * nearest:g}")

    @property
    def pitch(self) -> float:
        """The spacing [m]."""
        return self.spacing

    @cached_property
    def places(self) -> FloatArray:
        """(n, 2) centres in units of the spacing."""
        row, column = np.mgrid[0 : self.rows, 0 : self.columns].reshape(2, -1)
        x = column if self.layout == "symmetric" else 2 * column + row % 2
        return np.stack([x, row], axis=1).astype(np.float64)


def whole_number(name: str, value: object, *, minimum: int) -> int:
    """Return a count of columns or rows, or say what is legal."""
    if isinstance(value, bool) or not isinstance(value, int) or not minimum <= value <= MOST_CELLS:
        raise InputError(f"{name}: {value!r} given; legal: a whole number from {minimum} to {MOST_CELLS}")
    return value


def length(name: str, value: object) -> float:
    """Return a length on the board [m], or say what is legal."""
    return finite_number(name, value, minimum=1e-4, maximum=100.0)
