"""The topics of a recording and their types."""

from __future__ import annotations

from omniservo.recording.recorded_messages import (
    CallsMessage,
    EndMessage,
    FramesMessage,
    LogMessage,
    LookMessage,
    MatchMessage,
    PathMessage,
    StepMessage,
    WaitMessage,
)
from omniservo.ros_messages import RosMessage
from omniservo.ros_messages.messages import (
    CameraInfoMessage,
    ImageMessage,
    JointStateMessage,
    TwistStampedMessage,
)

FORMAT = "omniservo.recording/1"
"""The recordings that this version writes and replays."""

PARAMETERS = "omniservo"
"""The name of the metadata that say what was run."""

DROPPED = "omniservo.dropped"
"""The name of the metadata that say how many images are missing where they stand."""

IMAGE = "/camera/image"
CAMERA_INFO = "/camera/camera_info"
JOINT_STATES = "/joint_states"
JOINT_COMMANDS = "/joint_commands"
CAMERA_TWIST = "/camera_twist"
PLANNED_PATH = "/planned_path"
FRAMES = "/tf"
FIXED_FRAMES = "/tf_static"
EVENTS = "/rosout"
LOOK = "/omniservo/look"
MATCH = "/omniservo/match"
STEP = "/omniservo/step"
WAIT = "/omniservo/wait"
CALLS = "/omniservo/calls"
END = "/omniservo/end"

TYPES: dict[str, type[RosMessage]] = {
    IMAGE: ImageMessage,
    CAMERA_INFO: CameraInfoMessage,
    JOINT_STATES: JointStateMessage,
    JOINT_COMMANDS: JointStateMessage,
    CAMERA_TWIST: TwistStampedMessage,
    PLANNED_PATH: PathMessage,
    FRAMES: FramesMessage,
    FIXED_FRAMES: FramesMessage,
    EVENTS: LogMessage,
    LOOK: LookMessage,
    MATCH: MatchMessage,
    STEP: StepMessage,
    WAIT: WaitMessage,
    CALLS: CallsMessage,
    END: EndMessage,
}
"""By topic."""

BASE, INITIAL_CAMERA, CAMERA, ESTIMATED_CAMERA = "base", "initial_camera", "camera", "camera_estimated"
"""Frames: the arm's foot; the camera where the plan begins; as the joints have it; as the image has it."""
