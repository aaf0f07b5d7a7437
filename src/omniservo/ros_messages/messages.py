"""The ROS 2 messages that a servo exchanges: fields, types' names and RIHS01 hashes.

They are the same in every distribution from Humble to Kilted, where each has a hash. `cdr` writes and reads
them; nothing here needs a DDS.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from functools import cache
from typing import Annotated, Any, ClassVar, get_args, get_type_hints

import numpy as np

from omniservo.geometry.arrays import ByteArray, FloatArray


@dataclass(frozen=True)
class Scalar:
    """A number by itself."""

    code: str
    """its letter in `struct`"""
    size: int
    """bytes, and their alignment"""


@dataclass(frozen=True)
class Numbers:
    """Numbers in a row: ``count`` of them, or as many as a length before them says."""

    dtype: str
    """of their NumPy array, little-endian"""
    count: int | None = None
    """None: a sequence"""


Int32 = Annotated[int, Scalar("i", 4)]
UInt32 = Annotated[int, Scalar("I", 4)]
UInt8 = Annotated[int, Scalar("B", 1)]
Bool = Annotated[bool, Scalar("?", 1)]
Float64 = Annotated[float, Scalar("d", 8)]
Floats = Annotated[FloatArray, Numbers("<f8")]
Floats9 = Annotated[FloatArray, Numbers("<f8", 9)]
Floats12 = Annotated[FloatArray, Numbers("<f8", 12)]
Floats7 = Annotated[FloatArray, Numbers("<f8", 7)]
Floats6 = Annotated[FloatArray, Numbers("<f8", 6)]
Octets = Annotated[ByteArray, Numbers("u1")]


def _none() -> FloatArray:
    return np.zeros(0)


class RosMessage:
    """What all messages share: their type's name and hash, which a subclass states."""

    ros_type: ClassVar[str]
    """as ROS 2 spells it, "sensor_msgs/msg/Image\""""
    type_hash: ClassVar[str]
    """RIHS01: what ROS 2 from Iron on calls this very definition; empty: it is not sent to others"""

    def __init_subclass__(cls, ros_type: str, rihs01: str = "") -> None:
        cls.ros_type, cls.type_hash = ros_type, f"RIHS01_{rihs01}" if rihs01 else ""

    @classmethod
    @cache
    def wire_fields(cls) -> tuple[tuple[str, Any, bool], ...]:
        """Return name, kind and "is it a list" of every field, in the order in which they are sent.

        A kind is a `Scalar`, `Numbers`, `str` or another message's class.
        """
        hints = get_type_hints(cls, include_extras=True)
        rows = []
        for each in fields(cls):  # type: ignore[arg-type]  # subclasses are dataclasses
            hint = hints[each.name]
            many = getattr(hint, "__origin__", None) is list
            hint = get_args(hint)[0] if many else hint
            rows.append((each.name, hint.__metadata__[0] if hasattr(hint, "__metadata__") else hint, many))
        return tuple(rows)


@dataclass(eq=False)
class TimeMessage(
    RosMessage,
    ros_type="builtin_interfaces/msg/Time",
    rihs01="b106235e25a4c5ed35098aa0a61a3ee9c9b18d197f398b0e4206cea9acf9c197",
):
    """An instant of the sender's clock."""

    sec: Int32 = 0
    """whole seconds, rounded down"""
    nanosec: UInt32 = 0
    """the rest [ns]"""

    @classmethod
    def of(cls, seconds: float) -> TimeMessage:
        """Return the message of a time [s]."""
        return cls(*divmod(round(seconds * 1e9), 10**9))

    @property
    def seconds(self) -> float:
        """The time [s], to 0.3 µs in our century."""
        return self.sec + 1e-9 * self.nanosec


@dataclass(eq=False)
class DurationMessage(
    RosMessage,
    ros_type="builtin_interfaces/msg/Duration",
    rihs01="e8d009f659816f758b75334ee1a9ca5b5c0b859843261f14c7f937349599d93b",
):
    """A time from another one on."""

    sec: Int32 = 0
    """whole seconds, rounded down"""
    nanosec: UInt32 = 0
    """the rest [ns]"""

    @classmethod
    def of(cls, seconds: float) -> DurationMessage:
        """Return the message of a duration [s]."""
        return cls(*divmod(round(seconds * 1e9), 10**9))

    @property
    def seconds(self) -> float:
        """The duration [s]."""
        return self.sec + 1e-9 * self.nanosec


@dataclass(eq=False)
class HeaderMessage(
    RosMessage,
    ros_type="std_msgs/msg/Header",
    rihs01="f49fb3ae2cf070f793645ff749683ac6b06203e41c891e17701b1cb597ce6a01",
):
    """When, and in which frame."""

    stamp: TimeMessage = field(default_factory=TimeMessage)
    """of the sender's clock; 0: none"""
    frame_id: str = ""
    """the frame's name"""


@dataclass(eq=False)
class JointStateMessage(
    RosMessage,
    ros_type="sensor_msgs/msg/JointState",
    rihs01="a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
):
    """The joints of an arm, by name."""

    header: HeaderMessage = field(default_factory=HeaderMessage)
    """when they were read"""
    name: list[str] = field(default_factory=list)
    """the order of the arrays"""
    position: Floats = field(default_factory=_none)
    """(n,) [rad]; empty where they are not known"""
    velocity: Floats = field(default_factory=_none)
    """(n,) [rad/s]; empty where they are not known"""
    effort: Floats = field(default_factory=_none)
    """(n,) [N m]; empty where they are not known"""


@dataclass(eq=False)
class ImageMessage(
    RosMessage,
    ros_type="sensor_msgs/msg/Image",
    rihs01="d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47",
):
    """An image as it is in memory."""

    header: HeaderMessage = field(default_factory=HeaderMessage)
    """when it was taken"""
    height: UInt32 = 0
    """rows"""
    width: UInt32 = 0
    """columns"""
    encoding: str = ""
    """of a pixel: "mono8", "bgr8", …"""
    is_bigendian: UInt8 = 0
    """of pixels of more than a byte"""
    step: UInt32 = 0
    """bytes of a row"""
    data: Octets = field(default_factory=lambda: np.zeros(0, np.uint8))
    """(height × step,) bytes"""


@dataclass(eq=False)
class CompressedImageMessage(
    RosMessage,
    ros_type="sensor_msgs/msg/CompressedImage",
    rihs01="15640771531571185e2efc8a100baf923961a4d15d5569652e6cb6691e8e371a",
):
    """An image as a file has it."""

    header: HeaderMessage = field(default_factory=HeaderMessage)
    """when it was taken"""
    format: str = ""
    """ "jpeg", "png", or image_transport's "bgr8; jpeg compressed bgr8\""""
    data: Octets = field(default_factory=lambda: np.zeros(0, np.uint8))
    """the file's bytes"""


@dataclass(eq=False)
class RegionOfInterestMessage(
    RosMessage,
    ros_type="sensor_msgs/msg/RegionOfInterest",
    rihs01="ad16bcba5f9131dcdba6fbded19f726f5440e3c513b4fb586dd3027eeed8abb1",
):
    """A part of the sensor; all zero: the whole."""

    x_offset: UInt32 = 0
    """first column"""
    y_offset: UInt32 = 0
    """first row"""
    height: UInt32 = 0
    """rows"""
    width: UInt32 = 0
    """columns"""
    do_rectify: Bool = False
    """whether it belongs to the rectified image"""


@dataclass(eq=False)
class CameraInfoMessage(
    RosMessage,
    ros_type="sensor_msgs/msg/CameraInfo",
    rihs01="b3dfd68ff46c9d56c80fd3bd4ed22c7a4ddce8c8348f2f59c299e73118e7e275",
):
    """A camera's calibration."""

    header: HeaderMessage = field(default_factory=HeaderMessage)
    """of the image that it goes with"""
    height: UInt32 = 0
    """rows of the calibrated image"""
    width: UInt32 = 0
    """columns of the calibrated image"""
    distortion_model: str = ""
    """ "plumb_bob", "rational_polynomial", "equidistant\""""
    d: Floats = field(default_factory=_none)
    """distortion coefficients"""
    k: Floats9 = field(default_factory=lambda: np.zeros(9))
    """(9,) the intrinsic matrix by rows [px]"""
    r: Floats9 = field(default_factory=lambda: np.zeros(9))
    """(9,) rotation to the rectified camera, by rows"""
    p: Floats12 = field(default_factory=lambda: np.zeros(12))
    """(12,) the rectified camera's projection matrix, by rows"""
    binning_x: UInt32 = 0
    """columns that make one pixel; 0 is 1"""
    binning_y: UInt32 = 0
    """rows that make one pixel; 0 is 1"""
    roi: RegionOfInterestMessage = field(default_factory=RegionOfInterestMessage)
    """the part of the sensor"""


@dataclass(eq=False)
class JointTrajectoryPointMessage(
    RosMessage,
    ros_type="trajectory_msgs/msg/JointTrajectoryPoint",
    rihs01="de8907036d8bd45aac6f30cc9044a3d4a329c42cbf719aff7d95a584cfa532d7",
):
    """Where the joints are at one time of a trajectory."""

    positions: Floats = field(default_factory=_none)
    """(n,) [rad]"""
    velocities: Floats = field(default_factory=_none)
    """(n,) [rad/s]"""
    accelerations: Floats = field(default_factory=_none)
    """(n,) [rad/s²] or empty"""
    effort: Floats = field(default_factory=_none)
    """(n,) [N m] or empty"""
    time_from_start: DurationMessage = field(default_factory=DurationMessage)
    """after the header's stamp, or after the arrival where that is 0"""


@dataclass(eq=False)
class JointTrajectoryMessage(
    RosMessage,
    ros_type="trajectory_msgs/msg/JointTrajectory",
    rihs01="179b33eba59d676f6d967ac71fe35e7ca2f64b2f3928f4a018cec115e213796e",
):
    """A motion of the joints over time."""

    header: HeaderMessage = field(default_factory=HeaderMessage)
    """when it begins; 0: at once"""
    joint_names: list[str] = field(default_factory=list)
    """the order of the points' arrays"""
    points: list[JointTrajectoryPointMessage] = field(default_factory=list)
    """by increasing time"""


@dataclass(eq=False)
class Vector3Message(
    RosMessage,
    ros_type="geometry_msgs/msg/Vector3",
    rihs01="cc12fe83e4c02719f1ce8070bfd14aecd40f75a96696a67a2a1f37f7dbb0765d",
):
    """Three components."""

    x: Float64 = 0.0
    """along the first axis"""
    y: Float64 = 0.0
    """along the second axis"""
    z: Float64 = 0.0
    """along the third axis"""


@dataclass(eq=False)
class TwistMessage(
    RosMessage,
    ros_type="geometry_msgs/msg/Twist",
    rihs01="9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a",
):
    """A rigid body's velocity."""

    linear: Vector3Message = field(default_factory=Vector3Message)
    """[m/s]"""
    angular: Vector3Message = field(default_factory=Vector3Message)
    """[rad/s]"""


@dataclass(eq=False)
class TwistStampedMessage(
    RosMessage,
    ros_type="geometry_msgs/msg/TwistStamped",
    rihs01="5f0fcd4f81d5d06ad9b4c4c63e3ea51b82d6ae4d0558f1d475229b1121db6f64",
):
    """A velocity in a named frame."""

    header: HeaderMessage = field(default_factory=HeaderMessage)
    """when, and in whose axes"""
    twist: TwistMessage = field(default_factory=TwistMessage)
    """the velocity"""


@dataclass(eq=False)
class MultiArrayDimensionMessage(
    RosMessage,
    ros_type="std_msgs/msg/MultiArrayDimension",
    rihs01="5e773a60a4c7fc8a54985f307c7837aa2994252a126c301957a24e31282c9cbe",
):
    """One side of an array."""

    label: str = ""
    """its name"""
    size: UInt32 = 0
    """numbers along it"""
    stride: UInt32 = 0
    """numbers from it on inwards"""


@dataclass(eq=False)
class MultiArrayLayoutMessage(
    RosMessage,
    ros_type="std_msgs/msg/MultiArrayLayout",
    rihs01="4c66e6f78e740ac103a94cf63259f968e48c617e7699e829b63c21a5cb50dac6",
):
    """The shape of an array."""

    dim: list[MultiArrayDimensionMessage] = field(default_factory=list)
    """its sides, the outer first; empty: one row"""
    data_offset: UInt32 = 0
    """numbers before the first"""


@dataclass(eq=False)
class Float64MultiArrayMessage(
    RosMessage,
    ros_type="std_msgs/msg/Float64MultiArray",
    rihs01="1025ddc6b9552d191f89ef1a8d2f60f3d373e28b283d8891ddcc974e8c55397f",
):
    """Numbers in a row."""

    layout: MultiArrayLayoutMessage = field(default_factory=MultiArrayLayoutMessage)
    """their shape"""
    data: Floats = field(default_factory=_none)
    """(n,)"""
