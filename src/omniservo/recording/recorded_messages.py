"""The messages of a recording that no servo exchanges: ROS 2's for paths, frames and events, and our own."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.ros_messages.messages import (
    Float64,
    Floats,
    Floats6,
    Floats7,
    HeaderMessage,
    Int32,
    Octets,
    RosMessage,
    TimeMessage,
    UInt8,
    UInt32,
    Vector3Message,
)


def _numbers(count: int = 0) -> FloatArray:
    return np.zeros(count)


@dataclass(eq=False)
class PointMessage(RosMessage, ros_type="geometry_msgs/msg/Point"):
    """A place [m]."""

    x: Float64 = 0.0
    """[m]"""
    y: Float64 = 0.0
    """[m]"""
    z: Float64 = 0.0
    """[m]"""


@dataclass(eq=False)
class QuaternionMessage(RosMessage, ros_type="geometry_msgs/msg/Quaternion"):
    """A rotation."""

    x: Float64 = 0.0
    """of the vector part"""
    y: Float64 = 0.0
    """of the vector part"""
    z: Float64 = 0.0
    """of the vector part"""
    w: Float64 = 1.0
    """the scalar part"""


@dataclass(eq=False)
class PoseMessage(RosMessage, ros_type="geometry_msgs/msg/Pose"):
    """Where something is and how it is turned."""

    position: PointMessage = field(default_factory=PointMessage)
    """[m]"""
    orientation: QuaternionMessage = field(default_factory=QuaternionMessage)
    """a unit quaternion"""


@dataclass(eq=False)
class PoseStampedMessage(RosMessage, ros_type="geometry_msgs/msg/PoseStamped"):
    """A pose in a named frame."""

    header: HeaderMessage = field(default_factory=HeaderMessage)
    """when, and in which frame"""
    pose: PoseMessage = field(default_factory=PoseMessage)
    """the pose"""


@dataclass(eq=False)
class PathMessage(RosMessage, ros_type="nav_msgs/msg/Path"):
    """Poses along a path."""

    header: HeaderMessage = field(default_factory=HeaderMessage)
    """when, and in which frame"""
    poses: list[PoseStampedMessage] = field(default_factory=list)
    """in their order"""


@dataclass(eq=False)
class TransformMessage(RosMessage, ros_type="geometry_msgs/msg/Transform"):
    """Where a frame is in another."""

    translation: Vector3Message = field(default_factory=Vector3Message)
    """[m]"""
    rotation: QuaternionMessage = field(default_factory=QuaternionMessage)
    """a unit quaternion"""


@dataclass(eq=False)
class TransformStampedMessage(RosMessage, ros_type="geometry_msgs/msg/TransformStamped"):
    """Where a named frame is in another."""

    header: HeaderMessage = field(default_factory=HeaderMessage)
    """when, and the frame in which it is"""
    child_frame_id: str = ""
    """the frame that is there"""
    transform: TransformMessage = field(default_factory=TransformMessage)
    """parent_T_child"""


@dataclass(eq=False)
class FramesMessage(RosMessage, ros_type="tf2_msgs/msg/TFMessage"):
    """Frames in one another."""

    transforms: list[TransformStampedMessage] = field(default_factory=list)
    """each"""


@dataclass(eq=False)
class LogMessage(RosMessage, ros_type="rcl_interfaces/msg/Log"):
    """An event, in words."""

    stamp: TimeMessage = field(default_factory=TimeMessage)
    """when"""
    level: UInt8 = 20
    """20 information, 30 warning, 40 error"""
    name: str = ""
    """of who tells it"""
    msg: str = ""
    """the words"""
    file: str = ""
    """empty"""
    function: str = ""
    """empty"""
    line: UInt32 = 0
    """0"""


@dataclass(eq=False)
class LookMessage(RosMessage, ros_type="omniservo_msgs/msg/Look"):
    """The arm stands and the newest image is checked: the job is planned from here."""

    header: HeaderMessage = field(default_factory=HeaderMessage)
    """of that image"""
    image_time: Float64 = 0.0
    """exactly [s]"""
    joints: Floats = field(default_factory=_numbers)
    """(n,) [rad]"""
    motion_seconds: Float64 = 0.0
    """that the arm took to come here"""


@dataclass(eq=False)
class MatchMessage(RosMessage, ros_type="omniservo_msgs/msg/Match"):
    """Points that the initial and the goal image both show."""

    header: HeaderMessage = field(default_factory=HeaderMessage)
    """of the initial image"""
    initial: Floats = field(default_factory=_numbers)
    """u, v of every point in the initial image [px]"""
    goal: Floats = field(default_factory=_numbers)
    """u, v of every point in the goal image [px]"""


@dataclass(eq=False)
class StepMessage(RosMessage, ros_type="omniservo_msgs/msg/Step"):
    """One control step: what was seen in the newest image and what was commanded for it."""

    header: HeaderMessage = field(default_factory=HeaderMessage)
    """of that image"""
    time: Float64 = 0.0
    """of its exposure since the servo's start [s]"""
    image_time: Float64 = 0.0
    """of its exposure, exactly [s]"""
    state_time: Float64 = 0.0
    """of the joints, exactly [s]"""
    w: Float64 = 0.0
    """path parameter; NaN without a path"""
    leg: Int32 = 0
    """which way was followed: 0 the plan's"""
    error_px: Float64 = 0.0
    """rms of the points from where they should be [px]"""
    goal_error_px: Float64 = 0.0
    """rms of the points from the goal image [px]"""
    control_seconds: Float64 = 0.0
    """from pixels to joint velocities [s]"""
    pixels: Floats = field(default_factory=_numbers)
    """u, v of every point [px]; NaN where lost"""
    valid: Octets = field(default_factory=lambda: np.zeros(0, np.uint8))
    """(n,) 1: found"""
    reference_pixels: Floats = field(default_factory=_numbers)
    """u, v where every point should be [px]"""
    twist: Floats6 = field(default_factory=lambda: _numbers(6))
    """(6,) of the camera, as commanded: linear [m/s], angular [rad/s], its own axes"""
    filter_change: Floats6 = field(default_factory=lambda: _numbers(6))
    """(6,) of it, what the visibility filter added"""
    estimated_pose: Floats7 = field(default_factory=lambda: _numbers(7))
    """(7,) initial_T_camera from the image: quaternion (x, y, z, w), translation [m]"""
    joints: Floats = field(default_factory=_numbers)
    """(n,) as read [rad]"""
    joint_velocities: Floats = field(default_factory=_numbers)
    """(n,) as read [rad/s]"""


@dataclass(eq=False)
class WaitMessage(RosMessage, ros_type="omniservo_msgs/msg/Wait"):
    """Images were missing, and are back; the next step is that of the first one."""

    header: HeaderMessage = field(default_factory=HeaderMessage)
    """when"""
    since: Float64 = 0.0
    """when the arm began to slow down, since the servo's first image [s]"""
    stands_at: Float64 = 0.0
    """when its reference stood, likewise [s]"""
    until: Float64 = 0.0
    """when an image could be acted on, likewise [s]"""
    resumed: Float64 = 0.0
    """when the reference went on, likewise [s]"""
    rising: Float64 = 0.0
    """how long it took to be as fast as planned [s]"""
    why: str = ""
    """in words"""


@dataclass(eq=False)
class CallsMessage(RosMessage, ros_type="omniservo_msgs/msg/Calls"):
    """The loop's calls to the supervised robot, in their order, since the last of these messages."""

    header: HeaderMessage = field(default_factory=HeaderMessage)
    """when"""
    calls: Octets = field(default_factory=lambda: np.zeros(0, np.uint8))
    """a `Call` each"""
    values: Floats = field(default_factory=_numbers)
    """the numbers that belong to them, one call's after the other's"""


@dataclass(eq=False)
class EndMessage(RosMessage, ros_type="omniservo_msgs/msg/End"):
    """How the servo ended; the arm stands."""

    header: HeaderMessage = field(default_factory=HeaderMessage)
    """when"""
    reason: str = ""
    """empty: the goal was reached; else the name of what stopped it"""
    message: str = ""
    """the same in words"""
