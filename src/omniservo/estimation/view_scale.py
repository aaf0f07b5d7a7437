"""What makes the structure of several views metric: a length that is known."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from omniservo.errors import InputError, spelled
from omniservo.estimation.known_displacements import DisplacementPrior, KnownDisplacements
from omniservo.estimation.two_view_input import stated_length
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray, IntArray, finite_array, owned
from omniservo.short_repr import short_repr


@with_field_docs
@dataclass(frozen=True)
class ViewDistance:
    """The distance of the camera centres of two views, as a robot's odometry knows it."""

    first: int
    second: int
    metres: float


@with_field_docs
@dataclass(frozen=True, eq=False)
class KnownPoints:
    """Points of which the coordinates in some frame are known, such as the corners of a tag.

    Of several groups, each with a frame of its own, as tags of known size at unknown places, only the sizes
    count.
    """

    indices: npt.ArrayLike
    """(k,) rows of the pixels"""
    points: npt.ArrayLike
    """(k, 3) [m]"""
    groups: npt.ArrayLike | None = None
    """(k,) whole numbers from 0: to which group each belongs. None: all are of one frame"""

    __repr__ = short_repr


_PAIR = np.zeros(2, dtype=np.int64)

_OTHER_SIZE = 2.0
"""Times as large or as small as all groups together say a group cannot be, however noisy its places."""

_NAMED = 4
"""known points in a message"""

ViewScale = float | tuple[tuple[int, int], float] | ViewDistance | KnownPoints | KnownDisplacements | None


@dataclass(frozen=True, eq=False)
class GaugeLength:
    """A length of the structure: the size √(Σ‖xᵢ − x̄‖²) of some points or of two camera centres.

    x̄ is the mean of the group to which x belongs.
    """

    of_views: bool
    """x are centres of views, else points"""
    indices: IntArray
    """(k,) of x"""
    metres: float | None
    """what it truly is; None: it is set to 1"""
    known: FloatArray
    """(k, 3) [m] coordinates of the points where they are known, else (0, 3)"""
    groups: IntArray
    """(k,) of x; all 0: there is one"""

    @property
    def is_one_frame(self) -> bool:
        """Whether all known points are of one frame."""
        return not self.groups.any()

    def without(self, lost: IntArray) -> GaugeLength:
        """Return the length of what is left where some of its known points have no place."""
        if not len(lost):
            return self
        kept = ~np.isin(self.indices, lost)
        known, groups = self.known[kept], self.groups[kept]
        size = float(np.linalg.norm(_from_means(known, groups)))
        return GaugeLength(self.of_views, self.indices[kept], size, known, groups)

    def among(self, views: IntArray, points: IntArray) -> GaugeLength:
        """Return the length in arrays of these views and points only, both sorted."""
        rows = views if self.of_views else points
        kept = self.without(self.indices[~np.isin(self.indices, rows)])
        places = np.searchsorted(rows, kept.indices)
        return GaugeLength(self.of_views, places, kept.metres, kept.known, kept.groups)

    def value(self, centres: FloatArray, points: FloatArray) -> float:
        """Return the length in a structure of centres (v, 3) and points (n, 3)."""
        return float(np.linalg.norm(self._spread(centres, points)))

    def contradiction(self, points: FloatArray) -> str:
        """Return which known group the metric points (n, 3) show in quite another size, or nothing.

        One place far off, or a wrong structure, makes up the whole length and leaves the others next to none.
        """
        for group in np.unique(self.groups) if len(self.known) else ():
            of_group = self.groups == group
            rows, alike = self.indices[of_group], self.groups[of_group]
            true, seen = (np.linalg.norm(_from_means(x, alike)) for x in (self.known[of_group], points[rows]))
            if true > 0.0 and not 1.0 / _OTHER_SIZE < seen / true < _OTHER_SIZE:
                words = ", ".join(map(str, rows[:_NAMED])) + (", …" if len(rows) > _NAMED else "")
                return f"the known points {words} are {seen / true:.2g} times as far apart as they should be"
        return ""

    def log_gradient(self, centres: FloatArray, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return ∂ log(length)/∂ centres (v, 3) and ∂ points (n, 3)."""
        spread = self._spread(centres, points)
        gradients = np.zeros_like(centres), np.zeros_like(points)
        gradients[0 if self.of_views else 1][self.indices] = spread / float((spread**2).sum())
        return gradients

    def _spread(self, centres: FloatArray, points: FloatArray) -> FloatArray:
        chosen = (centres if self.of_views else points)[self.indices]
        return _from_means(chosen, self.groups)


def _from_means(points: FloatArray, groups: IntArray) -> FloatArray:
    """Return points (k, 3) less the mean of their group."""
    spread = points.copy()
    for group in np.unique(groups):
        spread[groups == group] -= points[groups == group].mean(axis=0)
    return spread


def checked_scale(scale: Any, views: int, n: int) -> GaugeLength | DisplacementPrior:
    """Return the length, or the displacements, that a scale states for so many views and points.

    Raises:
        InputError: not one of the forms of `estimate_views`, or with illegal indices or numbers.
    """
    none = np.empty((0, 3))
    if scale is None:
        return GaugeLength(True, np.array([0, 1]), None, none, _PAIR)
    if isinstance(scale, KnownDisplacements):
        return DisplacementPrior.of(scale, views)
    if isinstance(scale, ViewDistance):
        ends = _indices("scale: view", [scale.first, scale.second], views)
        return GaugeLength(True, ends, _pair_size(stated_length("scale: metres", scale.metres)), none, _PAIR)
    if isinstance(scale, KnownPoints):
        points = finite_array("scale: points", scale.points, (None, 3))
        rows = _indices("scale: index", list(np.asarray(scale.indices, dtype=object).ravel()), n)
        if len(rows) != len(points) or len(rows) < 2:
            words = f"{len(rows)} indices and {len(points)} points given; as many, at least two, are needed"
            raise InputError(f"scale: {words}")
        groups = np.zeros(len(rows), dtype=np.int64) if scale.groups is None else np.asarray(scale.groups)
        if groups.shape != rows.shape or groups.dtype.kind not in "iu" or groups.min() < 0:
            words = f"{groups.dtype} {groups.shape} given; whole numbers from 0, ({len(rows)},), are needed"
            raise InputError(f"scale: groups: {words}")
        size = float(np.linalg.norm(_from_means(points, groups)))
        if not size > 0.0:
            raise InputError("scale: points: all at one place; different points are needed")
        return GaugeLength(False, rows, size, owned(points), groups.astype(np.int64))
    if isinstance(scale, tuple | list):
        if len(scale) != 2 or not isinstance(scale[0], tuple | list) or len(scale[0]) != 2:
            legal = "None, metres, ((i, j), metres), ViewDistance, KnownPoints, KnownDisplacements"
            raise InputError(f"scale: {spelled(scale)} given; legal: {legal}")
        metres = stated_length("scale: metres", scale[1])
        return GaugeLength(
            False, _indices("scale: index", list(scale[0]), n), _pair_size(metres), none, _PAIR
        )
    metres = stated_length("scale", scale)
    return GaugeLength(True, np.array([0, 1]), _pair_size(metres), none, _PAIR)


def _pair_size(metres: float) -> float:
    """Return the size of two points so far apart: √(2 (d/2)²)."""
    return metres / math.sqrt(2.0)


def _indices(name: str, values: list[Any], count: int) -> IntArray:
    for value in values:
        if isinstance(value, bool) or not isinstance(value, int | np.integer) or not 0 <= value < count:
            raise InputError(f"{name} {spelled(value)} given; legal: whole numbers from 0 to {count - 1}")
    if len(set(values)) != len(values):
        raise InputError(f"{name}: {spelled(values)} given; they must differ")
    return np.array(values, dtype=np.int64)
