"""The bounds that the supervisor, the watch over the features and the visibility filter keep."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.errors import InputError
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray, finite_array, finite_number, frozen

_POSITIVE = (
    "image_age",
    "patience",
    "joint_age",
    "reaction",
    "max_linear_speed",
    "max_angular_speed",
    "growing_time",
    "visibility_rate",
    "drive_lag",
    "least_gain",
    "least_acceleration",
    "following_error",
    "image_error",
    "time_offset",
)


@with_field_docs
@dataclass(frozen=True, eq=False)
class SafetyOptions:
    """What no motion may exceed. The limits of the joints are those of the arm and not stated here.

    Raises:
        InputError: a number that is not legal, named.
    """

    image_age: float = 0.25
    """An image older than this is not acted on, and stops a robot that is not led to rest by then [s]."""
    patience: float = 3.0
    """The robot is stopped so long after the newest image that could be acted on [s]; until then `servo`
    slows down, stands, and waits. Less than ``image_age`` counts as that."""
    blind_room: float = 0.0
    """How far off its path the camera may be when it stands there without images [m]: what a plan keeps for
    tracking; 0: it is slowed down as fast as the joints may"""
    path_room: float | None = None
    """How far off its path the joints may have the camera [m]: no more than what the plan keeps to all
    obstacles; more stops the robot. None: not watched"""
    command_lag: float = 0.0
    """From a command until the arm acts on it [s]; what drives and their controller are known to take"""
    joint_age: float = 0.05
    """A joint state older than this is not acted on, and stops the robot [s]; judged on the wall's clock."""
    reaction: float = 0.1
    """Longest time between two looks at the moving robot [s]; a longer one stops it. It counts as part of
    every braking distance."""
    joint_reserve: float = float(np.deg2rad(1.0))
    """What is left of a joint's range beyond its braking distance, for the drive's own lag [rad]"""
    drive_lag: float = 0.25
    """L: what is sent shows in the joint readings by so much later at most, drives and reading together
    [s]"""
    least_gain: float = 0.7
    """A drive turns at least this share of what is sent, once its lag is over,"""
    most_gain: float = 1.6
    """and at most this"""
    least_acceleration: float = 0.5
    """A drive accelerates at least with this share of the arm's limit."""
    following_error: float = 3e-3
    """What lag and gain do not explain of a joint's motion may be this much [rad]; more stops the robot."""
    image_error: float = 4.0
    """A point's motion in the image may be off by this much beyond what structure, mount, calibration and
    time stamps explain [px]; see `ImageWatch`"""
    time_offset: float = 0.25
    """Time stamps of images may be off those of the joints by this much, either way [s]"""
    offset_sigma: float | None = None
    """Standard deviation of the offset between the two [s] where it was measured, and added to the images'
    stamps; images that ask for another one then stop the robot: see `DelayWatch`. None: not measured"""
    exposure: float = 0.0
    """So long each row of an image sees [s]; names what motion blur stops."""
    readout: float = 0.0
    """of a rolling shutter [s], 0: global: points are led back from their rows' instants to the time stamp"""
    structure_error: float = 0.4
    """The points' distances may be off by this share."""
    max_linear_speed: float = 1.0
    """of the camera's centre [m/s]; a faster command is slowed down as a whole"""
    max_angular_speed: float = 3.0
    """of the camera [rad/s]; likewise"""
    workspace: FloatArray | None = None
    """(2, 3) lowest and highest place of the camera's centre [m], along the axes of ``found_T_workspace``;
    None: anywhere that the joints allow"""
    found_T_workspace: RigidTransform | None = None
    """The frame of the workspace in the camera frame in which the supervisor found the robot; None: it is
    that one"""
    least_features: int = 4
    """Fewer points stop the robot; a pose needs four."""
    growing_px: float = 15.0
    """The image error may grow freely below this [px];"""
    growing_time: float = 1.0
    """above it, an error that grew from third to third of this time stops the robot [s]."""
    visibility_margin: float = 2.0
    """Distance to every image limit that the visibility filter keeps [px]; noise of the pixels, and what the
    points' distances are off, take of it"""
    visibility_rate: float = 10.0
    """κ: a point at h px from that margin may come nearer to it by κ h px/s [1/s]; keep κ · frame period
    well below 1"""

    def __post_init__(self) -> None:
        for name in _POSITIVE:
            finite_number(name, getattr(self, name), above=0.0)
        for name in (
            "joint_reserve",
            "blind_room",
            "growing_px",
            "visibility_margin",
            "structure_error",
            "command_lag",
            "exposure",
            "readout",
        ):
            finite_number(name, getattr(self, name), minimum=0.0)
        if self.path_room is not None:
            finite_number("path_room", self.path_room, minimum=0.0)
        if self.offset_sigma is not None:
            finite_number("offset_sigma", self.offset_sigma, minimum=0.0)
        finite_number("most_gain", self.most_gain, minimum=self.least_gain)
        finite_number("least_features", self.least_features, minimum=3)
        if not isinstance(self.least_features, int):
            raise InputError(f"least_features: {self.least_features} given; a whole number is needed")
        if self.workspace is not None:
            box = finite_array("workspace", self.workspace, (2, 3))
            if (box[0] >= box[1]).any():
                axis = "xyz"[int(np.argmax(box[0] >= box[1]))]
                raise InputError(
                    f"workspace: lowest {axis} is not below the highest; legal: (2, 3), low, high"
                )
            object.__setattr__(self, "workspace", frozen(box))
