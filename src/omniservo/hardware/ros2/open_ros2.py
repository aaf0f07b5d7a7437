"""Arms and cameras under ROS 2, as a robot file states them."""

from __future__ import annotations

from dataclasses import replace

from omniservo.errors import InputError, spelled
from omniservo.hardware.ros2.commands import ArmCommands, TrajectoryCommands, TwistCommands, VelocityCommands
from omniservo.hardware.ros2.network import DdsNetwork
from omniservo.hardware.ros2.ros2_arm import Ros2Arm
from omniservo.hardware.ros2.ros2_camera import Ros2Camera
from omniservo.robots import Arm

LEGAL = "trajectory, velocity:JOINT,JOINT,… (the controller's, in its order), twist:FRAME"
"""what an arm can be commanded by"""


def network_of(address: str) -> DdsNetwork:
    """Return the network of an address: "", DOMAIN, or DOMAIN@INTERFACE; localhost is this machine alone.

    Raises:
        InputError: not such an address.
    """
    domain, _, interface = address.partition("@")
    if domain and not domain.isdecimal():
        raise InputError(f"address: {spelled(address)} given; legal: DOMAIN or DOMAIN@INTERFACE, 0@eth0")
    number = int(domain) if domain else None
    return DdsNetwork.localhost(number) if interface == "localhost" else DdsNetwork(number, interface)


def open_ros2_arm(
    address: str,
    joint_names: tuple[str, ...],
    arm: Arm,
    watchdog: float | None,
    *,
    commands: str = "trajectory",
    topic: str = "",
    joint_states: str = "/joint_states",
    listen_only: bool = False,
) -> Ros2Arm:
    """Connect to an arm.

    Args:
        address: see `network_of`.
        joint_names: as the joint states have them, in the order of all arrays.
        arm: its kinematics and limits.
        watchdog: the user's own, which velocity and twist need [s].
        commands: ``trajectory`` (joint_trajectory_controller), ``velocity:JOINT,JOINT,…``
            (forward_velocity_controller, its parameter ``joints``) or ``twist:FRAME`` (MoveIt Servo, its
            planning frame).
        topic: of the commands; "": the controller's default.
        joint_states: their topic.
        listen_only: nothing is ever sent.

    Raises:
        InputError: see `Ros2Arm`; other commands.
        ConnectionLost: no one there.
    """
    return Ros2Arm(
        joint_names,
        arm.joint_acceleration,
        _commands(commands, topic, arm, watchdog),
        joint_states=joint_states,
        network=network_of(address),
        listen_only=listen_only,
    )


def open_ros2_camera(topic: str, address: str, joint_states: str) -> Ros2Camera:
    """Connect to a camera, whose clock is that of the joint states.

    Raises:
        InputError, ConnectionLost: see `Ros2Camera`.
    """
    return Ros2Camera(topic, clock_topic=joint_states, network=network_of(address))


def _commands(stated: str, topic: str, arm: Arm, watchdog: float | None) -> ArmCommands:
    kind, _, what = stated.partition(":")
    if (kind, bool(what)) not in (("trajectory", False), ("velocity", True), ("twist", True)):
        raise InputError(f"options: commands: {spelled(stated)} given; legal: {LEGAL}")
    found: TrajectoryCommands | VelocityCommands | TwistCommands = TrajectoryCommands()
    if kind == "velocity":
        found = VelocityCommands(tuple(name.strip() for name in what.split(",")), watchdog)
    if kind == "twist":
        found = TwistCommands(arm, what, watchdog)
    return replace(found, topic=topic) if topic else found
