"""A convex polyhedron as an obstacle."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from typing import ClassVar, Self

import numpy as np

from omniservo.errors import InputError
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray, frozen, frozen_again
from omniservo.planning.checks import bounded_array, own_clearance, own_motion
from omniservo.planning.constraints.body_gap import HULL
from omniservo.planning.constraints.hull_gap import Hull, hull_gap
from omniservo.planning.obstacles.core import Core
from omniservo.planning.obstacles.hull_shape import MOST_VERTICES, convex_hull
from omniservo.short_repr import short_repr

MOST_GIVEN = 100_000
"""Points of which the hull is taken."""


@with_field_docs
@dataclass(frozen=True, eq=False)
class Mesh:
    """The convex hull of vertices, in the initial camera frame.

    Of the points given, those that are no corner of the hull are left out.

    Raises:
        InputError: not finite, fewer than 4 points, all in one plane, more than 1000 corners, a negative
            clearance, or a number beyond 1e6 m.
    """

    vertices: FloatArray
    """(n, 3) [m], 4 ≤ n ≤ 1000, in the order given, read-only"""
    clearance: float | None = None
    """what the camera centre keeps from its surface [m]; None: the problem's clearance"""
    motion: FloatArray | None = None
    """displacement at w (3, k+1), highest power first [m], k ≤ 16, read-only; None: it stands still"""
    file: str | None = None
    """name of the file that it was read from, for messages"""

    FIELDS: ClassVar = {"vertices": "vertices"}

    __repr__ = short_repr
    __setstate__ = frozen_again

    def __post_init__(self) -> None:
        points = bounded_array("vertices", self.vertices, (None, 3))
        if len(points) > MOST_GIVEN:
            raise InputError(f"vertices: {len(points)} given; legal: at most {MOST_GIVEN}")
        hull = convex_hull("vertices", points)
        if len(hull.corners) > MOST_VERTICES:
            raise InputError(
                f"vertices: a hull of {len(hull.corners)} corners given; legal: at most {MOST_VERTICES}"
            )
        object.__setattr__(self, "vertices", frozen(hull.corners))
        object.__setattr__(self, "clearance", own_clearance(self.clearance))
        object.__setattr__(self, "motion", own_motion(self.motion))

    @property
    def core(self) -> Core:
        """What the proof separates from the path."""
        extents = np.abs(self.vertices).max(axis=0)
        return Core(np.zeros(3), np.eye(3), extents, shape=HULL, vertices=self.vertices)

    def distance(self, points: FloatArray) -> FloatArray:
        """Return the distance of points (k, 3) to the surface [m] (k,), negative inside.

        Where it stands without its motion.
        """
        places = [(float(x), float(y), float(z)) for x, y, z in points]
        return np.array([hull_gap(self.hull, place, place)[3] for place in places])

    def grown(self, metres: float) -> Self:
        """Return one that holds all within so many metres of it.

        A cube that holds the ball goes to every vertex. Where that gives more corners than a mesh may have
        it is enlarged from a point inside instead, λ times: λ s(n) ≥ s(n) + metres where s(n) ≥ its depth.
        """
        cube = metres * np.array(list(product((-1.0, 1.0), repeat=3)))
        around = convex_hull("vertices", (self.vertices[:, None] + cube).reshape(-1, 3)).corners
        if len(around) > MOST_VERTICES:
            middle = self.vertices.mean(axis=0)
            depth = float((self.hull.faces[:, 3] - self.hull.faces[:, :3] @ middle).min())
            around = middle + (1.0 + metres / depth) * (self.vertices - middle)
        return replace(self, vertices=around)

    @cached_property
    def hull(self) -> Hull:
        """The vertices with the hull's faces and edges."""
        return convex_hull("vertices", np.array(self.vertices))
