"""The arm (kinematics, limits), and what every arm driver and every camera, real or simulated, implements."""

from omniservo.renamed import renamed
from omniservo.robots.arm import Arm
from omniservo.robots.arm_driver import ArmDriver, ArmMode, RobotState
from omniservo.robots.arm_files import SHOWN_GROUP
from omniservo.robots.camera_source import CameraImage, CameraSource
from omniservo.robots.collision.arm_bodies import ArmBodies
from omniservo.robots.collision.arm_clearance import (
    SELF_CLEARANCE,
    ArmClearance,
    Closeness,
    arm_clearance,
    spelled_gap,
)
from omniservo.robots.collision.camera_housing import CAMERA_HOUSING
from omniservo.robots.collision.link_gaps import FARTHEST, link_gaps
from omniservo.robots.collision.mounted_camera import MountedCamera
from omniservo.robots.collision.own_sight import OwnSight, own_sight
from omniservo.robots.collision.solid import Solid
from omniservo.robots.link import Link, Shape
from omniservo.robots.load_arm import load_arm, shipped_arms
from omniservo.robots.next_image import next_image
from omniservo.robots.path_following.follow_path import FollowedPath, follow_path
from omniservo.robots.path_following.joint_path import JointPath, PathFailure
from omniservo.robots.path_following.strayed import strayed
from omniservo.robots.path_following.tracking_tube import TrackingTube, Tube, shipped_tube
from omniservo.robots.suggestions.suggested_mount import suggested_mount
from omniservo.robots.suggestions.suggested_posture import suggested_posture
from omniservo.robots.suggestions.suggested_table import suggested_table

__all__ = [
    "CAMERA_HOUSING",
    "FARTHEST",
    "SELF_CLEARANCE",
    "SHOWN_GROUP",
    "Arm",
    "ArmBodies",
    "ArmClearance",
    "ArmDriver",
    "ArmMode",
    "CameraImage",
    "CameraSource",
    "Closeness",
    "FollowedPath",
    "JointPath",
    "Link",
    "MountedCamera",
    "OwnSight",
    "PathFailure",
    "RobotState",
    "Shape",
    "Solid",
    "TrackingTube",
    "Tube",
    "arm_clearance",
    "follow_path",
    "link_gaps",
    "load_arm",
    "next_image",
    "own_sight",
    "shipped_arms",
    "shipped_tube",
    "spelled_gap",
    "strayed",
    "suggested_mount",
    "suggested_posture",
    "suggested_table",
]

__getattr__ = renamed(
    __name__,
    {
        "Robot": "ArmDriver",
        "handy_mount": "suggested_mount",
        "handy_posture": "suggested_posture",
        "handy_table": "suggested_table",
    },
)
