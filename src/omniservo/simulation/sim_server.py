"""A task's simulated arm and camera behind the interfaces of real ones, on the wall clock."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import yaml

from omniservo.errors import InputError
from omniservo.hardware import LinkFaults
from omniservo.hardware.camera_sources.mjpeg_server import MjpegServer
from omniservo.hardware.rtde.rtde_arm import UR_JOINTS
from omniservo.hardware.rtde.server import FREE_PORTS, UrPorts, UrStandIn
from omniservo.robots import Arm
from omniservo.scenes import scene_of_task
from omniservo.scenes.scene_of_task import goal_joints
from omniservo.simulation.real_time_robot import RealTimeRobot
from omniservo.simulation.true_scene import light_of, true_scene
from omniservo.tasks import Task
from omniservo.tasks.robot_file import FORMAT

CAMERA_PORT = 8081
"""of the images, beside a controller's own ports"""

Interface = Literal["rtde", "ros2"]
"""what of a real robot is stood in for"""


@dataclass(frozen=True)
class Served:
    """A simulated robot that can be reached."""

    robot: RealTimeRobot
    """what moves, and the truth"""
    robot_file: str
    """YAML: the robot file that reaches it"""
    where: str
    """the addresses, in words"""


@contextmanager
def serve(
    task: Task,
    interface: Interface,
    *,
    at: Literal["start", "goal"] = "start",
    faults: LinkFaults | None = None,
    free_ports: bool = False,
    seed: int = 0,
    projected: bool = False,
) -> Iterator[Served]:
    """Have a task's arm and camera served while the block runs.

    Args:
        task: what stands where; its sensor says how often and how late images come.
        interface: rtde stands in for a controller of Universal Robots and a network camera (MJPEG); ros2
            for a ROS 2 system.
        at: where the arm stands: at the task's start, or at its goal, to be taught there.
        faults: of states, commands and images.
        free_ports: not those that such controllers have, but any that are free.
        seed: of the camera's noise.
        projected: images show the target's dots alone, which takes next to no time.

    Raises:
        InputError: the arm has another number of joints than the interface, a port cannot be had, or there
            are no dots to project.
    """
    scene = scene_of_task(task)
    if at == "goal":
        truth = true_scene(task, scene)
        light = task.simulation.goal_light
        lights = truth.lights if light is None else (light_of(light),)
        truth = replace(truth, start_joints=goal_joints(task, scene), lights=lights)
    else:
        truth = true_scene(task, scene)
    names = scene.arm.joint_names
    if interface == "rtde" and len(names) != len(UR_JOINTS):
        raise InputError(f"--as rtde: arms of {len(UR_JOINTS)} joints; {scene.arm.name} has {len(names)}")
    faults = faults or LinkFaults()
    with ExitStack() as stack:
        robot = RealTimeRobot(truth, seed, projected=projected)
        stack.callback(robot.close)
        served = _as_ros2 if interface == "ros2" else _as_rtde
        fields, images, where = served(stack, robot, scene.arm, faults, free_ports=free_ports)
        yield Served(robot, _robot_file(task, fields, images), where)


def _as_rtde(
    stack: ExitStack, robot: RealTimeRobot, arm: Arm, faults: LinkFaults, *, free_ports: bool
) -> tuple[dict[str, object], str, str]:
    """Serve a controller of Universal Robots and a network camera.

    Return the fields of the robot file, the images' URI, and both in words.
    """
    ports = FREE_PORTS if free_ports else UrPorts()
    server = stack.enter_context(UrStandIn(robot, ports=ports, faults=faults))
    camera = stack.enter_context(MjpegServer(robot, port=0 if free_ports else CAMERA_PORT, faults=faults))
    called = zip(arm.joint_names, UR_JOINTS, strict=True)
    fields: dict[str, object] = {
        "driver": "rtde",
        "address": server.address,
        "joints": {name: ur for name, ur in called if name not in (ur, f"{ur}_joint")},
        "options": {"script_port": server.ports.scripts[0], "dashboard_port": server.ports.dashboard},
    }
    where = f"RTDE {server.address}, programs on port {server.ports.scripts[0]}, images {camera.url}"
    return fields, camera.url, where


def _as_ros2(
    stack: ExitStack, robot: RealTimeRobot, arm: Arm, faults: LinkFaults, *, free_ports: bool
) -> tuple[dict[str, object], str, str]:
    """Serve ROS 2 topics on this machine, in its domain or, for ``free_ports``, one of its own."""
    from omniservo.hardware.ros2.network import DdsNetwork
    from omniservo.hardware.ros2.server import Ros2Server, ServedTopics

    network = DdsNetwork.localhost(100 + os.getpid() % 100 if free_ports else None)
    topics = ServedTopics()
    server = Ros2Server(robot, arm.joint_names, robot, topics=topics, faults=faults, network=network)
    stack.callback(server.close)
    fields: dict[str, object] = {"driver": "ros2", "address": f"{network.domain_id}@localhost"}
    where = f"ROS 2 {network}: {topics.joint_states}, {topics.trajectory}, {topics.image}"
    return fields, f"ros2:{topics.image}", where


def _robot_file(task: Task, fields: Mapping[str, object], images: str) -> str:
    """Return a robot file with what is reached by ``fields``, and the task's arm, mount and camera."""
    mount = task.arm.flange_T_camera.transform
    arm = {
        "model": task.arm.model,
        "flange": task.arm.flange,
        "packages": task.arm.packages,
        "flange_T_camera": {
            "translation": mount.translation.tolist(),
            "quaternion": mount.rotation.as_quat().tolist(),
        },
        "mount_covariance": None
        if task.arm.mount_covariance is None
        else np.array(task.arm.mount_covariance).tolist(),
    }
    camera = {
        "source": images,
        "calibration": task.camera.to_dict(),
        "rate": task.sensor.rate,
        "exposure": task.sensor.exposure,
        "readout": task.sensor.readout,
    }
    document = {
        "format": FORMAT,
        **{name: value for name, value in fields.items() if value},
        "arm": {name: value for name, value in arm.items() if value is not None and value != {}},
        "camera": camera,
        "speed": 1.0,
    }
    return yaml.safe_dump(document, sort_keys=False, default_flow_style=None, width=110)
