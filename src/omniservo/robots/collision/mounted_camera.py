"""A camera on the flange, and what is carried beside it."""

from __future__ import annotations

from dataclasses import dataclass

from scipy.spatial.transform import RigidTransform

from omniservo.field_docs import with_field_docs
from omniservo.geometry.single_pose import single_pose
from omniservo.robots.collision.solid import Solid


@with_field_docs
@dataclass(frozen=True)
class MountedCamera:
    """A camera on an arm's flange, and the bodies that the flange carries beside it."""

    flange_T_camera: RigidTransform
    mounted: tuple[Solid, ...] = ()
    """what the flange carries, in the camera frame: housing, bracket, gripper"""

    def __post_init__(self) -> None:
        single_pose("flange_T_camera", self.flange_T_camera)
