"""A point cloud as an obstacle: what a depth camera or a scanner saw."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Self

import numpy as np

from omniservo.errors import InputError
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray, finite_number, frozen_again
from omniservo.planning.checks import LARGEST, bounded_array, own_clearance, own_motion
from omniservo.planning.obstacles.ball_tree import BallTree, ball_tree, nearest_point
from omniservo.planning.obstacles.cloud_boxes import MOST_BOXES, CloudBoxes, cloud_boxes
from omniservo.short_repr import short_repr

MOST_CLOUD_POINTS = 100_000
"""Points of a cloud, and of all clouds of a problem together."""


@with_field_docs
@dataclass(frozen=True, eq=False)
class Cloud:
    """Balls of one radius about many points, in the initial camera frame.

    Raises:
        InputError: no point or too many, a coordinate that is not finite (how many, and the first), a
            negative radius or clearance, or a number beyond 1e6 m.
    """

    points: FloatArray
    """(p, 3) [m], 1 ≤ p ≤ 1e5, read-only"""
    radius: float = 0.0
    """[m], ≥ 0; a cloud of radius 0 hides nothing"""
    clearance: float | None = None
    """what the camera centre keeps from every ball's surface [m]; None: the problem's clearance"""
    motion: FloatArray | None = None
    """displacement at w (3, k+1), highest power first [m], k ≤ 16, read-only; None: it stands still"""
    file: str | None = None
    """name of the file that it was read from, for messages"""

    FIELDS: ClassVar = {"points": "points", "radius": "radius"}

    __repr__ = short_repr
    __setstate__ = frozen_again

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", _checked_points(self.points))
        object.__setattr__(self, "radius", finite_number("radius", self.radius, minimum=0.0, maximum=LARGEST))
        object.__setattr__(self, "clearance", own_clearance(self.clearance))
        object.__setattr__(self, "motion", own_motion(self.motion))

    @cached_property
    def tree(self) -> BallTree:
        """The points in a tree of balls: how kernels find those that matter."""
        return ball_tree(self.points)

    @cached_property
    def boxes(self) -> CloudBoxes:
        """Boxes that hold all its balls: among them a whole arm is judged."""
        return cloud_boxes(self.tree, self.radius, MOST_BOXES)

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the distance of points (k, 3) to the nearest ball's surface [m] (k,), negative inside.

        Where it stands without its motion.
        """
        found = [nearest_point(*self.tree, x, x, math.inf)[1] for x in map(tuple, points)]
        return np.array(found) - self.radius

    def grown(self, metres: float) -> Self:
        """Return one that holds all within so many metres of it."""
        return replace(self, radius=self.radius + metres)


def _checked_points(value: Any) -> FloatArray:
    count = len(value) if hasattr(value, "__len__") else 1
    if not 1 <= count <= MOST_CLOUD_POINTS:
        raise InputError(f"points: {count} given; legal: 1 to {MOST_CLOUD_POINTS}")
    try:
        rows = np.asarray([] if value is None else value, dtype=np.float64).reshape(count, -1)
    except (TypeError, ValueError, OverflowError):
        rows = np.zeros((count, 1))  # no numbers at all: the next check says so
    finite = np.isfinite(rows).all(axis=1)
    if not finite.all():
        first = int(np.argmin(finite))
        raise InputError(
            f"points: {count - int(finite.sum())} of {count} are not finite, the first is number {first}: "
            f"{rows[first, :3].tolist()}; leave them out"
        )
    return bounded_array("points", value, (None, 3))
