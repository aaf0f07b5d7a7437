"""Obstacles as the planner knows them, in a task file: the fields of a problem file, in the task's units."""

from __future__ import annotations

import math
from abc import abstractmethod
from functools import cached_property
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import BeforeValidator, ConfigDict, Field, field_validator, model_validator
from scipy.spatial.transform import RigidTransform

from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray
from omniservo.planning import Box, Capsule, Cloud, Cylinder, Ellipsoid, HalfSpace, Mesh, Sphere
from omniservo.planning.checks import NEAR_UNIT
from omniservo.planning.obstacles.cloud import MOST_CLOUD_POINTS
from omniservo.planning.obstacles.mesh import MOST_GIVEN
from omniservo.planning.obstacles.obstacle import Obstacle
from omniservo.tasks.placed import Block, Framed, Placed, Turned
from omniservo.tasks.quantities import Direction, Length, NonNegativeLength, Point, PositiveLength


class _Obstacle(Framed):
    model_config = ConfigDict(populate_by_name=True)

    clearance: NonNegativeLength | None = None
    """own clearance instead of the planner's [m]"""

    @model_validator(mode="before")
    @classmethod
    def _moved_in_time(cls, fields: Any) -> Any:
        if isinstance(fields, dict) and fields.get("motion") is not None:
            raise ValueError(
                "motion: of a problem's file, where it runs over the path's own w; a run goes by time, "
                "replans on the way and judges the whole arm; legal here: the task's moves, at a time each"
            )
        return fields

    @property
    @abstractmethod
    def obstacle(self) -> Obstacle:
        """The planner's obstacle."""

    @model_validator(mode="after")
    def _is_a_body(self) -> Self:
        try:
            _ = self.obstacle
        except InputError as error:
            raise ValueError(str(error)) from None
        return self

    def transformed(self, a_T_b: RigidTransform) -> Self:
        """Return the same, stated in frame b, in frame a."""
        places = [name for name in ("center", "start", "end") if hasattr(self, name)]
        return self.model_copy(
            update={name: tuple(a_T_b.apply(getattr(self, name)).tolist()) for name in places}
        )


class SphereSection(_Obstacle):
    """A ball; radius 0 is a point."""

    type: Literal["sphere"] = "sphere"
    center: Point
    radius: NonNegativeLength = 0.0

    @property
    def obstacle(self) -> Sphere:
        """The planner's obstacle."""
        return Sphere(np.array(self.center), self.radius, self.clearance)


class BoxSection(Block, _Obstacle):
    """A box along the axes of its frame, or turned."""

    type: Literal["box"]

    @property
    def obstacle(self) -> Box:
        """The planner's obstacle."""
        center, half = np.array(self.center), np.array(self.half_extents)
        return Box(center, half, self.rotation.as_quat(), self.clearance)


class _Rod(_Obstacle):
    start: Annotated[Point, Field(alias="from")]
    end: Annotated[Point, Field(alias="to")]
    radius: PositiveLength


class CapsuleSection(_Rod):
    """A rod with round ends."""

    type: Literal["capsule"]

    @property
    def obstacle(self) -> Capsule:
        """The planner's obstacle."""
        return Capsule(np.array(self.start), np.array(self.end), self.radius, self.clearance)


class CylinderSection(_Rod):
    """A rod with flat ends."""

    type: Literal["cylinder"]

    @property
    def obstacle(self) -> Cylinder:
        """The planner's obstacle."""
        return Cylinder(np.array(self.start), np.array(self.end), self.radius, self.clearance)


class EllipsoidSection(Placed, _Obstacle):
    """An ellipsoid along the axes of its frame, or turned."""

    type: Literal["ellipsoid"]
    radii: tuple[PositiveLength, PositiveLength, PositiveLength]
    """[m]"""

    @property
    def obstacle(self) -> Ellipsoid:
        """The planner's obstacle."""
        center, radii = np.array(self.center), np.array(self.radii)
        return Ellipsoid(center, radii, self.rotation.as_quat(), self.clearance)


class HalfSpaceSection(_Obstacle):
    """A wall or a floor: free where normal·x ≥ offset."""

    type: Literal["half_space"]
    normal: Direction
    """unit"""
    offset: Length

    @field_validator("normal")
    @classmethod
    def _unit(cls, normal: tuple[float, float, float]) -> tuple[float, float, float]:
        length = math.hypot(*normal)
        if abs(length - 1.0) > NEAR_UNIT:
            raise ValueError(f"length {length:g}; it must be 1 within {NEAR_UNIT:g}")
        return normal

    def transformed(self, a_T_b: RigidTransform) -> Self:
        """Return the same, stated in frame b, in frame a."""
        normal = a_T_b.rotation.apply(self.normal)
        offset = self.offset + float(normal @ a_T_b.translation)
        return self.model_copy(update={"normal": tuple(normal.tolist()), "offset": offset})

    @property
    def obstacle(self) -> HalfSpace:
        """The planner's obstacle."""
        return HalfSpace(np.array(self.normal), self.offset, self.clearance)


class MeshSection(Turned, _Obstacle):
    """The convex hull of vertices, turned, then moved."""

    type: Literal["mesh"]
    vertices: Annotated[tuple[Point, ...], Field(min_length=4, max_length=MOST_GIVEN)]
    """in the task's file in their place ``file``: an STL, OBJ or DAE, in the task's units or in those that
    ``units`` or ``scale`` beside it state; each closed convex part of it is an obstacle"""
    translation: Point = (0.0, 0.0, 0.0)
    """[m]"""
    file: str | None = None
    """name of the file in which they stand"""

    def transformed(self, a_T_b: RigidTransform) -> Self:
        """Return the same, stated in frame b, in frame a."""
        there = a_T_b.apply(self._placed).tolist()
        return type(self)(  # not a copy, which would keep the obstacle of the old place
            type="mesh", vertices=there, clearance=self.clearance, file=self.file
        )

    @cached_property
    def obstacle(self) -> Mesh:
        """The planner's obstacle."""
        return Mesh(self._placed, self.clearance, file=self.file)

    @property
    def _placed(self) -> FloatArray:
        placed: FloatArray = self.rotation.apply(np.array(self.vertices)) + self.translation
        return placed


class CloudSection(_Obstacle):
    """Balls of one radius about many points: what a depth camera saw."""

    type: Literal["cloud"]
    points: Annotated[tuple[Point, ...], Field(min_length=1, max_length=MOST_CLOUD_POINTS)]
    """in the task's file in their place ``file``: a .npy, .xyz, .txt or .ply of them, in the task's units or
    in those that ``units`` or ``scale`` beside it state"""
    file: str | None = None
    """name of the file in which they stand"""
    radius: NonNegativeLength = 0.0

    def transformed(self, a_T_b: RigidTransform) -> Self:
        """Return the same, stated in frame b, in frame a."""
        there = a_T_b.apply(self.points).tolist()
        return type(self)(  # not a copy, which would keep the obstacle of the old place
            type="cloud", points=there, radius=self.radius, clearance=self.clearance, file=self.file
        )

    @cached_property
    def obstacle(self) -> Cloud:
        """The planner's obstacle."""
        return Cloud(np.array(self.points), self.radius, self.clearance, file=self.file)


def _sphere_by_default(value: Any) -> Any:
    return {"type": "sphere", **value} if isinstance(value, dict) else value


ObstacleSection = Annotated[
    Annotated[
        SphereSection
        | BoxSection
        | CapsuleSection
        | CylinderSection
        | EllipsoidSection
        | HalfSpaceSection
        | MeshSection
        | CloudSection,
        Field(discriminator="type"),
    ],
    BeforeValidator(_sphere_by_default),
]
"""One of them, distinguished by ``type``; without it a sphere."""
