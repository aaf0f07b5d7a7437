"""What the simulator knows of its robot and no robot knows of itself."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.geometry.arrays import ByteArray, FloatArray
from omniservo.simulation.outside_view import OutsideView
from omniservo.simulation.ray_caster import MISS, RayCaster
from omniservo.simulation.simulated_robot import SimulatedRobot
from omniservo.simulation.true_lens import TrueLens
from omniservo.simulation.world import World

_SURFACE = 1e-3
"""[m] what is met this close before a point is the surface that the point lies on"""


class SimulatedTruth:
    """Where things truly are, and images of it from outside.

    Args:
        robot: of what it knows the truth, as it is at the time.
    """

    def __init__(self, robot: SimulatedRobot) -> None:
        self._robot = robot
        self._views: dict[tuple[World, bool], OutsideView] = {}

    def world_T_camera(self, time: float) -> RigidTransform:
        """Return the camera's pose at the exposure of the frame with this time stamp [s].

        Raises:
            InputError: no frame was exposed at that time.
        """
        return self._robot.world_T_camera(time)

    def arm_obstacle_distance(self) -> float:
        """Return the smallest distance from arm or camera to any obstacle now [m]; negative inside."""
        return self._robot.arm_obstacle_distance()

    def contacts(self) -> frozenset[tuple[str, str]]:
        """Return the pairs of bodies that have touched since the start (names sorted in each pair)."""
        return self._robot.contacts()

    def points_under(self, joints: FloatArray, pixels: FloatArray) -> FloatArray:
        """Return the points (n, 3) [m], in the world, that the camera shows at ``pixels`` (n, 2).

        NaN where a pixel lies outside the camera's domain or its ray meets nothing.

        Args:
            joints: (n,) of the arm [rad].
            pixels: (n, 2) [px].
        """
        world = self._robot.world
        caster = RayCaster(world, sees_camera=False)
        pose = world.world_T_camera(caster.pose_arm(joints))
        bearings, valid = TrueLens(world.scene).unproject(pixels)
        directions = pose.rotation.apply(np.where(valid[:, None], bearings, [0.0, 0.0, 1.0]))
        origin = np.array(pose.translation)
        _, distances, _ = caster.cast(origin, np.ascontiguousarray(directions))
        met = valid & (distances >= 0.0)
        return np.asarray(np.where(met[:, None], origin + distances[:, None] * directions, np.nan))

    def hidden_by(self, joints: FloatArray, points: FloatArray) -> list[str | None]:
        """Return the name of the body that hides each point from the camera; None where none does.

        Args:
            joints: (n,) of the arm [rad].
            points: (m, 3) in the world [m].
        """
        world = self._robot.world
        caster = RayCaster(world, sees_camera=False)
        origin = np.array(world.world_T_camera(caster.pose_arm(joints)).translation)
        distances = np.linalg.norm(points - origin, axis=1)
        geoms, met, _ = caster.cast(origin, (points - origin) / distances[:, None])
        blocked = (geoms != MISS) & (met < distances - _SURFACE)
        return [
            world.body_of(int(geom)) if hides else None for geom, hides in zip(geoms, blocked, strict=True)
        ]

    def outside_picture(
        self, joints: FloatArray, time: float | None = None, *, quick: bool = False
    ) -> ByteArray:
        """Return a bystander's image (rows, columns, 3), 8 bit sRGB, with the arm in these joints.

        Args:
            joints: (n,) [rad].
            time: of the frame at whose exposure obstacles stand where they are shown [s]; None: now.
            quick: smaller, with hard shadows: one of many.
        """
        world = self._robot.world if time is None else self._robot.exposure(time)[1]
        if (world, quick) not in self._views:
            self._views[world, quick] = (
                OutsideView(world, width=480, height=360, shadow_rays=1, films=True)
                if quick
                else OutsideView(world)
            )
        return self._views[world, quick].render(joints)
