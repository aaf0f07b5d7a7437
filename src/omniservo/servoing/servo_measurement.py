"""What a servo method is given of an image: directions, distances and poses, all as estimated from images."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from scipy.spatial.transform import RigidTransform

from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray
from omniservo.servoing.rotation_vector import rotation_vector


@with_field_docs
@dataclass(frozen=True, eq=False)
class ServoMeasurement:
    """The n points that are seen now and in the goal image, row by row the same; nothing is ground truth."""

    time: float
    """exposure of the image since the servo's start [s]"""
    bearings: FloatArray
    """(n, 3) unit vectors to the points in the camera frame, of this image"""
    distances: FloatArray
    """(n,) to the points [m], by the pose that explains this image"""
    goal_bearings: FloatArray
    """(n, 3) likewise in the camera frame of the goal image"""
    goal_distances: FloatArray
    """(n,) [m], by the pose that explains the goal image"""
    pose_matrix: FloatArray
    """(4, 4) of ``goal_T_camera``"""

    @cached_property
    def goal_T_camera(self) -> RigidTransform:
        """The camera's pose in the camera frame of the goal image, by these two poses [m]."""
        return RigidTransform(self.pose_matrix, normalize=False)

    @cached_property
    def turn(self) -> FloatArray:
        """θu (3,), the rotation vector of goal_R_camera [rad]."""
        return rotation_vector(self.pose_matrix[:3, :3])

    @property
    def points(self) -> FloatArray:
        """(n, 3) the points in the camera frame [m]: where they are seen, at their distance."""
        return self.bearings * self.distances[:, None]

    @property
    def goal_points(self) -> FloatArray:
        """(n, 3) the points in the camera frame of the goal image [m]."""
        return self.goal_bearings * self.goal_distances[:, None]
