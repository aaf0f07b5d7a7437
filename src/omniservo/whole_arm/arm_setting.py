"""The arm that is to follow a camera path, where it stands, and what it has to keep."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.errors import InputError
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray, finite_array, finite_number, frozen, frozen_again
from omniservo.geometry.quick_poses import composed
from omniservo.geometry.single_pose import single_pose
from omniservo.planning.obstacles.obstacle import Obstacle
from omniservo.planning.planning_problem import PlanningProblem
from omniservo.robots import (
    SELF_CLEARANCE,
    Arm,
    ArmBodies,
    JointPath,
    MountedCamera,
    OwnSight,
    Solid,
    Tube,
    own_sight,
)
from omniservo.robots.arm import SINGULAR_VALUE
from omniservo.robots.collision.own_sight import own_sight_in
from omniservo.short_repr import short_repr
from omniservo.whole_arm.solids_of import solids_of

LIMIT_RESERVE = math.radians(1.0)
"""What joints keep to the ends of their ranges [rad], where nothing else is required."""

SERVO_RESERVE = math.radians(3.0)
"""What they keep along a path that is servoed by images [rad], but no more than at its start: noise turns
joints outwards, and the supervisor stops an arm its braking distance and 1° before an end."""

_ROUNDING = 1e-6
"""[rad] of the joints at the start"""


@with_field_docs
@dataclass(frozen=True, eq=False)
class ArmSetting:
    """An arm, its camera and its surroundings.

    Raises:
        InputError: something is not finite, negative, or of a wrong shape.
    """

    arm: Arm
    base_T_initial: RigidTransform
    """the initial camera, in which problems are stated, in the arm's base frame"""
    flange_T_camera: RigidTransform
    start: FloatArray | None = None
    """(n,) where the arm stands [rad], read-only; None: any configuration that sees the initial image"""
    mounted: tuple[Solid, ...] = ()
    """what the flange carries, in the camera frame; what of it holds the camera's centre hides no point"""
    surroundings: tuple[Solid, ...] = ()
    """what else stands around than a problem's obstacles, in the base frame"""
    clearance: float | None = 0.0
    """of the arm and what it carries to every obstacle and to the surroundings [m]; None: a problem's
    obstacles are there for the camera alone, and the surroundings are kept off by ``self_clearance``"""
    self_clearance: float = SELF_CLEARANCE
    """of the arm's parts to each other [m]"""
    limit_reserve: float = LIMIT_RESERVE
    """of every joint to the ends of its range [rad]; at least what the joints deviate by, if a tube says
    so"""
    singular_value: float = SINGULAR_VALUE
    """of the camera Jacobian, linear rows divided by `LENGTH_SCALE`: configurations keep at least this, and
    what a tube was measured at, if there is one"""
    tube: Tube | None = None
    """how far a run deviates from its path: what links deviate is added to every clearance. None: it does
    not"""

    __repr__ = short_repr
    __setstate__ = frozen_again

    def __post_init__(self) -> None:
        for name in ("mounted", "surroundings"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        for name in ("clearance", "self_clearance", "limit_reserve"):
            finite_number(name, 0.0 if (value := getattr(self, name)) is None else value, minimum=0.0)
        finite_number("singular_value", self.singular_value, minimum=SINGULAR_VALUE)
        if self.tube is not None:
            object.__setattr__(self, "singular_value", max(self.singular_value, self.tube.singular_value))
            most = np.asarray(self.tube.joints)
            if most.shape != (self.arm.dof,):
                raise InputError(f"tube: of {len(most)} joints; {self.arm.name} has {self.arm.dof}")
            if most.max() > self.limit_reserve:
                object.__setattr__(self, "limit_reserve", float(most.max()))
        for name in ("base_T_initial", "flange_T_camera"):
            single_pose(name, getattr(self, name))
        if self.start is not None:
            start = frozen(finite_array("start", self.start, (self.arm.dof,)))
            object.__setattr__(self, "start", start)
            low, high = self.arm.joint_range.T
            inside = (start >= low + self.limit_reserve) & (start <= high - self.limit_reserve)
            if not inside.all():
                j = int(np.argmin(inside))
                raise InputError(
                    f"start: {self.arm.joint_names[j]} at {np.rad2deg(start[j]):.2f} deg; its range "
                    f"{np.rad2deg(low[j]):.2f} … {np.rad2deg(high[j]):.2f} deg, of which "
                    f"{np.rad2deg(self.limit_reserve):g} deg are kept at both ends, does not hold it"
                )

    @cached_property
    def camera_T_flange(self) -> RigidTransform:
        """The flange in the camera frame."""
        return self.flange_T_camera.inv()

    @property
    def servoed(self) -> ArmSetting:
        """The same for visual servoing: joints keep `SERVO_RESERVE`, or what a tube says, to range ends."""
        if self.tube is not None:
            return self
        room = np.inf if self.start is None else float(self.arm.limit_margins(self.start).min())
        return replace(self, limit_reserve=max(self.limit_reserve, min(SERVO_RESERVE, room - _ROUNDING)))

    def base_T_flange(self, initial_T_camera: RigidTransform) -> RigidTransform:
        """Return the flange's pose for a pose of the camera."""
        return composed(composed(self.base_T_initial, initial_T_camera), self.camera_T_flange)

    @property
    def clearance_around(self) -> float:
        """What the arm keeps from everything that stands around [m]."""
        return self.self_clearance if self.clearance is None else self.clearance

    def bodies(self, obstacles: tuple[Obstacle, ...]) -> ArmBodies:
        """Return the arm among these obstacles and its surroundings.

        Raises:
            InputError: see `solids_of`.
        """
        carried = tuple(solid.moved(self.flange_T_camera) for solid in self.mounted)
        return ArmBodies(self.arm, mounted=carried, surroundings=self.solids(obstacles), tube=self.tube)

    def solids(self, obstacles: tuple[Obstacle, ...]) -> tuple[Solid, ...]:
        """Return what stands around the arm, in the base frame: the obstacles that count, the surroundings.

        Raises:
            InputError: see `solids_of`.
        """
        counted = () if self.clearance is None else obstacles
        return (*solids_of(counted, self.base_T_initial), *self.surroundings)

    def points_in_sight(self, problem: PlanningProblem) -> FloatArray | None:
        """Return the points (m, 3) that nothing may hide, in the base frame [m]; None: any may be hidden."""
        return self.base_T_initial.apply(problem.points) if problem.occlusion else None

    def own_sight(
        self, path: JointPath, base_points: FloatArray, span: tuple[float, float] = (0.0, 1.0)
    ) -> OwnSight:
        """Return what of the arm, of what it carries or around it hides points (m, 3); see `own_sight`.

        Lines of sight are kept as free as what the arm may deviate asks for.
        """
        kept, strays = self._strays
        return own_sight(
            self.arm, path, self._camera, base_points,
            surroundings=self.surroundings, kept=kept, camera_strays=strays, span=span,
        )  # fmt: skip

    def own_sight_in(self, q: FloatArray, base_points: FloatArray) -> OwnSight:
        """Return what hides points (m, 3) in one configuration (n,); see `own_sight`."""
        kept, strays = self._strays
        return own_sight_in(
            self.arm, q, self._camera, base_points,
            surroundings=self.surroundings, kept=kept, camera_strays=strays,
        )  # fmt: skip

    @property
    def _camera(self) -> MountedCamera:
        return MountedCamera(self.flange_T_camera, self.mounted)

    @property
    def _strays(self) -> tuple[dict[str, float], float]:
        """How far links and the camera's centre may be from where a path has them [m]."""
        return ({}, 0.0) if self.tube is None else (self.tube.links, self.tube.position)
