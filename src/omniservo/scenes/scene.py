"""What stands in the world of a task: plain values, every pose and point in world coordinates [m].

The world's +Z is up; gravity points along −Z.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.cameras.models import CentralModel
from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray, finite_array, finite_number, frozen
from omniservo.geometry.quick_poses import composed
from omniservo.geometry.single_pose import single_pose
from omniservo.robots import Arm, Solid
from omniservo.scenes.lens_error import LensError
from omniservo.scenes.light import Light
from omniservo.scenes.panel import Panel
from omniservo.scenes.sensor import Sensor

Colour: TypeAlias = tuple[float, float, float]
"""Linear red, green, blue in [0, 1]; the camera on the flange sees its luminance."""

BOARD_COLOUR: Colour = (0.88, 0.88, 0.86)
"""White card."""

OBSTACLE_COLOUR: Colour = (0.42, 0.13, 0.08)
"""Brick red, dark for the camera."""

SURROUNDINGS_COLOUR: Colour = (0.38, 0.27, 0.16)
"""Wood, darker than card."""

DOT_COLOUR: Colour = (0.03, 0.03, 0.03)
"""Black ink."""

_SHORTEST = 1e-4
"""No body is thinner than twice this [m]."""


@dataclass(frozen=True)
class SceneBox:
    """A block that does not move."""

    name: str
    """unique in its scene; contacts are reported under it"""
    world_T_box: RigidTransform
    half_extents: FloatArray
    """(3,) along the box's own axes [m]"""
    colour: Colour = BOARD_COLOUR

    def __post_init__(self) -> None:
        single_pose(f"box {self.name!r}: world_T_box", self.world_T_box)
        extents = finite_array(f"box {self.name!r}: half_extents", self.half_extents, (3,))
        if extents.min() < _SHORTEST:
            raise InputError(
                f"box {self.name!r}: half extent {extents.min():g} m given; at least {_SHORTEST:g} is needed"
            )
        object.__setattr__(self, "half_extents", frozen(extents))
        _check_colour(f"box {self.name!r}", self.colour)

    @property
    def corners(self) -> FloatArray:
        """(8, 3) corners in the world [m]."""
        signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1], indexing="ij")).reshape(3, 8).T
        corners: FloatArray = self.world_T_box.apply(signs * self.half_extents)
        return corners


@dataclass(frozen=True)
class Ball:
    """A sphere that does not move."""

    name: str
    """unique in its scene; contacts are reported under it"""
    center: FloatArray
    """(3,) [m]"""
    radius: float
    """[m]"""
    colour: Colour = OBSTACLE_COLOUR

    def __post_init__(self) -> None:
        object.__setattr__(
            self, "center", frozen(finite_array(f"ball {self.name!r}: center", self.center, (3,)))
        )
        finite_number(f"ball {self.name!r}: radius", self.radius, minimum=_SHORTEST)
        _check_colour(f"ball {self.name!r}", self.colour)


@dataclass(frozen=True)
class Dots:
    """Dark discs. They have no body of their own: they cannot be touched."""

    centers: FloatArray
    """(n, 3) centres of the visible faces [m]"""
    normals: FloatArray
    """(n, 3) out of the visible face; normalised on construction"""
    radius: float
    """[m]"""
    colour: Colour = DOT_COLOUR

    def __post_init__(self) -> None:
        centers = finite_array("dots: centers", self.centers, (None, 3))
        normals = finite_array("dots: normals", self.normals, (len(centers), 3))
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        if len(normals) and lengths.min() < 1e-9:
            raise InputError(
                f"dots: normal {int(lengths.argmin())} has length {lengths.min():g}; it must not be 0"
            )
        finite_number("dots: radius", self.radius, minimum=_SHORTEST)
        _check_colour("dots", self.colour)
        object.__setattr__(self, "centers", frozen(centers))
        object.__setattr__(self, "normals", frozen(normals / lengths))


@dataclass(frozen=True)
class Scene:
    """The whole world of one task."""

    arm: Arm
    world_T_base: RigidTransform
    """the arm's foot"""
    flange_T_camera: RigidTransform
    camera: CentralModel
    """what whoever works with the images is given"""
    start_joints: FloatArray
    """(n,) [rad], within the arm's range"""
    sensor: Sensor = field(default_factory=Sensor)
    dots: Dots | None = None
    panels: tuple[Panel, ...] = ()
    """printed images: tags, textured faces"""
    boards: tuple[SceneBox, ...] = ()
    """what carries dots and panels or stands behind them"""
    obstacles: tuple[SceneBox | Ball, ...] = ()
    surroundings: tuple[SceneBox, ...] = ()
    """what else stands around: tables, walls"""
    solids: tuple[Solid, ...] = ()
    """obstacles of any kind, in the world; those of one name are one body"""
    floor: float | None = None
    """height of a horizontal floor [m]; None: no floor"""
    true_camera: CentralModel | None = None
    """whose images are taken, of the same size; None: `camera`"""
    lens_error: LensError | None = None
    """where the images are displaced against that model's"""
    lights: tuple[Light, ...] = (Light(),)
    """as they shine one after the other, by `Light.since`"""

    def __post_init__(self) -> None:
        for name in ("world_T_base", "flange_T_camera"):
            single_pose(f"scene: {name}", getattr(self, name))
        joints = finite_array("scene: start_joints", self.start_joints, (self.arm.dof,))
        if not self.arm.within_limits(joints):
            raise InputError(f"scene: start_joints {np.rad2deg(joints).round(1)} deg leave the arm's range")
        object.__setattr__(self, "start_joints", frozen(joints))
        if self.true_camera is not None:
            sizes = [(lens.width, lens.height) for lens in (self.true_camera, self.camera)]
            if sizes[0] != sizes[1]:
                raise InputError(f"scene: true_camera: {_size(sizes[0])} given; camera has {_size(sizes[1])}")
        times = [light.since for light in self.lights]
        if not times or times[0] > 0.0 or times != sorted(times):
            raise InputError("scene: lights: one since 0 s is needed, and later ones in their order")
        names = [body.name for body in (*self.bodies, *self.panels)]
        names += {solid.name for solid in self.solids}
        twice = {name for name in names if names.count(name) > 1}
        if twice:
            raise InputError(f"scene: the name {min(twice)!r} is given twice")

    def light_at(self, time: float) -> Light:
        """Return the light that shines at ``time`` [s] on the clock of whoever takes images."""
        return [light for light in self.lights if light.since <= max(time, 0.0)][-1]

    @property
    def bodies(self) -> tuple[SceneBox | Ball, ...]:
        """Boxes and balls that can be touched."""
        return (*self.boards, *self.obstacles, *self.surroundings)

    def world_T_camera(self, q: FloatArray) -> RigidTransform:
        """Return the camera's pose for the joints ``q`` (n,) [rad]."""
        return composed(composed(self.world_T_base, self.arm.base_T_flange(q)), self.flange_T_camera)

    def joints_for(self, world_T_camera: RigidTransform, near: FloatArray) -> FloatArray:
        """Return the joints (n,) [rad] nearest to ``near`` that put the camera at the pose.

        Raises:
            InputError: no joints within the limits reach it.
        """
        return self.arm.inverse_near(
            self.world_T_base.inv() * world_T_camera * self.flange_T_camera.inv(), near
        )


def _check_colour(name: str, colour: Colour) -> None:
    values = finite_array(f"{name}: colour", colour, (3,))
    if values.min() < 0.0 or values.max() > 1.0:
        raise InputError(f"{name}: colour {colour} given; red, green and blue lie between 0 and 1")


def _size(size: tuple[int, int]) -> str:
    return f"{size[0]} × {size[1]} px"
