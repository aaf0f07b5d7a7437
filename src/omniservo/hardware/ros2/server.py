"""Presents any arm and camera as ROS 2 topics, as ros2_control, MoveIt Servo and a camera driver would."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass
from typing import Any, Protocol

import cv2
import numpy as np
import numpy.typing as npt

from omniservo.errors import InputError, OmniservoError
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray
from omniservo.hardware.link_faults import FaultyLine, LinkFaults
from omniservo.hardware.ros2.network import DdsNetwork
from omniservo.hardware.ros2.node import Publisher, RosNode, Subscription
from omniservo.hardware.ros2.trajectory_follower import TrajectoryFollower
from omniservo.robots import Arm, CameraImage, RobotState
from omniservo.ros_messages.messages import (
    CompressedImageMessage,
    Float64MultiArrayMessage,
    HeaderMessage,
    ImageMessage,
    JointStateMessage,
    JointTrajectoryMessage,
    RosMessage,
    TimeMessage,
    TwistStampedMessage,
)

GAIN = 20.0
"""Of the joints' distance to the trajectory [1/s]."""

_IMAGE_TICK = 0.001


class ServedArm(Protocol):
    """An arm on `time.monotonic()`; threads may share it."""

    def read(self) -> RobotState:
        """Return the newest state."""
        ...

    def command(self, joint_velocities: npt.ArrayLike) -> None:
        """Move with these velocities (n,) [rad/s]."""
        ...

    def stop(self) -> None:
        """Brake."""
        ...


class ServedCamera(Protocol):
    """A camera on `time.monotonic()`; threads may share it."""

    def image(self) -> CameraImage | None:
        """Return the newest image."""
        ...


@with_field_docs
@dataclass(frozen=True)
class ServedTopics:
    """What a server publishes and hears; an empty name leaves a topic out."""

    joint_states: str = "/joint_states"
    """reliable, as joint_state_broadcaster is"""
    state_rate: float = 250.0
    """joint states in a second"""
    velocities: bool = True
    """whether joint states have velocities"""
    image: str = "/camera/image_raw"
    """best effort, as cameras' drivers are; "…/compressed" sends JPEG"""
    trajectory: str = "/joint_trajectory_controller/joint_trajectory"
    """followed by interpolation from its time stamp on; one that does not end at rest is refused"""
    velocity: str = ""
    """in the order of the server's joints; the last one is kept for ever"""
    twist: str = ""
    """of the flange in axes of the base; kept for 0.1 s"""
    arm: Arm | None = None
    """turns twists into joint velocities"""


TWIST_TIMEOUT = 0.1
"""MoveIt Servo's default of ``incoming_command_timeout`` [s]."""


class Ros2Server:
    """Serves an arm, and a camera, until it is closed.

    Args:
        arm: what moves.
        joint_names: its joints, in the order of its arrays.
        camera: what sees; None: no images.
        topics: see ServedTopics.
        faults: of messages both ways, and of the server's clock.
        network: where it serves.
    """

    def __init__(
        self,
        arm: ServedArm,
        joint_names: tuple[str, ...],
        camera: ServedCamera | None = None,
        *,
        topics: ServedTopics | None = None,
        faults: LinkFaults | None = None,
        network: DdsNetwork | None = None,
    ) -> None:
        self._arm, self._camera, self._names = arm, camera, tuple(joint_names)
        self._topics = topics or ServedTopics()
        self._faults = faults or LinkFaults()
        if self._topics.twist and self._topics.arm is None:
            raise InputError("arm: none given; twists need one")
        self._begin = time.monotonic()
        self.heard = 0
        """commands that were followed"""
        self.refused: list[str] = []
        """why commands were not, the last hundred"""
        self._follower = TrajectoryFollower(self._names)
        self._velocities: tuple[float, FloatArray] | None = None
        """commanded without a trajectory: until when, and how fast"""
        self._closing = threading.Event()
        self._node = RosNode(network or DdsNetwork())
        self._states = self._node.publish(self._topics.joint_states, JointStateMessage, depth=10)
        self._commands: list[tuple[Subscription[Any], FaultyLine[RosMessage]]] = [
            (self._node.subscribe(topic, kind, reliable=True), self._line())
            for topic, kind in (
                (self._topics.trajectory, JointTrajectoryMessage),
                (self._topics.velocity, Float64MultiArrayMessage),
                (self._topics.twist, TwistStampedMessage),
            )
            if topic
        ]
        self._threads = [threading.Thread(target=self._serve_arm, name="ros2-serve-arm", daemon=True)]
        if camera is not None and self._topics.image:
            self._jpeg = self._topics.image.endswith("/compressed")
            kind: Any = CompressedImageMessage if self._jpeg else ImageMessage
            self._images: Publisher[Any] = self._node.publish(self._topics.image, kind, reliable=False)
            self._threads.append(
                threading.Thread(target=self._serve_camera, name="ros2-serve-camera", daemon=True)
            )
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        """Brake the arm and leave the domain; a second call does nothing."""
        if self._closing.is_set():
            return
        self._closing.set()
        for thread in self._threads:
            thread.join()
        self._arm.stop()
        self._node.close()

    def _line(self) -> FaultyLine[Any]:
        return FaultyLine(self._faults, self._begin)

    def _monotonic(self, stamp: float) -> float:
        """Return when the server's clock shows a time, on this machine's clock [s]."""
        drift = 1e-6 * self._faults.drift_ppm
        return self._begin + (stamp - self._faults.clock_offset - self._begin) / (1.0 + drift)

    def _serve_arm(self) -> None:
        line: FaultyLine[JointStateMessage] = self._line()
        period, due = 1.0 / self._topics.state_rate, time.monotonic()
        while not self._closing.is_set():
            self._hear()
            now = time.monotonic()
            if now >= due:
                state = self._arm.read()
                self._drive(state, now)
                line.put(self._state_message(state, line.stamp(state.time)), now)
                due = max(due + period, now)
            for message in line.due(now):
                self._states.write(message)
            self._closing.wait(min(0.001, period / 2))

    def _state_message(self, state: RobotState, stamp: float) -> JointStateMessage:
        velocities = state.joint_velocities if self._topics.velocities else np.zeros(0)
        header = HeaderMessage(TimeMessage.of(stamp))
        return JointStateMessage(header, list(self._names), state.joint_positions, velocities)

    def _hear(self) -> None:
        for subscription, line in self._commands:
            now = time.monotonic()
            for message in subscription.take():
                line.put(message, now)
            for message in line.due(now):
                try:
                    why = self._command(message, now)
                except (OmniservoError, ValueError, np.linalg.LinAlgError) as error:
                    why = str(error)
                self.heard += not why
                self.refused = [*self.refused, why][-100:] if why else self.refused

    def _command(self, message: RosMessage, now: float) -> str:
        """Take a command; return why it is refused, or nothing."""
        if isinstance(message, JointTrajectoryMessage):
            state = self._arm.read()
            stamp = message.header.stamp.seconds
            begin = self._monotonic(stamp) if stamp > 0.0 else now
            target = self._follower.at(now) or (state.joint_positions, state.joint_velocities)
            self._velocities = None
            return self._follower.take(message, begin, now, *target)
        if isinstance(message, Float64MultiArrayMessage):
            velocities, until = message.data, np.inf
        elif isinstance(message, TwistStampedMessage) and self._topics.arm is not None:
            flange, jacobian = self._topics.arm.locate(self._arm.read().joint_positions)
            parts = (message.twist.linear, message.twist.angular)
            twist = np.concatenate([flange[:, :3].T @ [part.x, part.y, part.z] for part in parts])
            velocities, until = np.linalg.solve(jacobian, twist), now + TWIST_TIMEOUT
        if len(velocities) != len(self._names) or not np.isfinite(velocities).all():
            return f"velocities {velocities.tolist()}"
        self._velocities = until, velocities
        return ""

    def _drive(self, state: RobotState, now: float) -> None:
        """Send the arm what trajectory, velocities or twist ask for now."""
        if self._velocities is not None:
            until, velocities = self._velocities
            self._arm.command(velocities if now < until else np.zeros(len(self._names)))
            return
        target = self._follower.at(now)
        if target is not None:
            positions, velocities = target
            self._arm.command(velocities + GAIN * (positions - state.joint_positions))

    def _serve_camera(self) -> None:
        line: FaultyLine[Any] = self._line()
        last = -np.inf
        while not self._closing.is_set():
            try:
                image = self._camera.image() if self._camera is not None else None
            except OmniservoError:  # the camera is gone; so are its images
                image = None
            now = time.monotonic()
            if image is not None and image.time > last:
                last = image.time
                line.put(self._image_message(image, line.stamp(image.time)), now)
            for message in line.due(time.monotonic()):
                self._images.write(message)
            self._closing.wait(_IMAGE_TICK)

    def _image_message(self, image: CameraImage, stamp: float) -> RosMessage:
        header = HeaderMessage(TimeMessage.of(stamp), "camera")
        height, width = image.pixels.shape
        if self._jpeg:
            data = cv2.imencode(".jpg", image.pixels)[1].reshape(-1)
            return CompressedImageMessage(header, "mono8; jpeg compressed mono8", data)
        return ImageMessage(header, height, width, "mono8", 0, width, image.pixels.reshape(-1))
