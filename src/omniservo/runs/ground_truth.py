"""What only who made the world knows of a run: for its log, its scores and its report's images."""

from __future__ import annotations

from typing import Protocol

from scipy.spatial.transform import RigidTransform

from omniservo.geometry.arrays import ByteArray, FloatArray


class GroundTruth(Protocol):
    """Where things truly are. Nothing that estimates, plans or controls asks it."""

    def world_T_camera(self, time: float) -> RigidTransform:
        """Return the camera's pose at the exposure of the frame with this time stamp [s]."""
        ...

    def arm_obstacle_distance(self) -> float:
        """Return the smallest distance from arm or camera to any obstacle now [m]; negative inside."""
        ...

    def contacts(self) -> frozenset[tuple[str, str]]:
        """Return the pairs of bodies that have touched since the start (names sorted in each pair)."""
        ...

    def points_under(self, joints: FloatArray, pixels: FloatArray) -> FloatArray:
        """Return the points (m, 3) [m], in the world, that the camera shows at ``pixels`` (m, 2).

        NaN where a pixel lies outside the camera's domain or nothing is seen there. ``joints`` (n,) [rad].
        """
        ...

    def hidden_by(self, joints: FloatArray, points: FloatArray) -> list[str | None]:
        """Return the name of the body that hides each point from the camera; None where none does.

        ``joints`` (n,) [rad]; ``points`` (m, 3) [m] in the world.
        """
        ...

    def outside_picture(
        self, joints: FloatArray, time: float | None = None, *, quick: bool = False
    ) -> ByteArray:
        """Return a bystander's image (rows, columns, 3), 8 bit sRGB, with the arm in ``joints`` (n,) [rad].

        Obstacles stand where they were at the exposure of the frame with the stamp ``time`` [s]; None: now.
        ``quick``: a smaller and simpler image, one of many.
        """
        ...
