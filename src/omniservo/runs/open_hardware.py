"""Opening the cell of a real robot."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.drive import COMMAND_LIFE, ArmOpener, DriveClient
from omniservo.errors import InputError, spelled
from omniservo.geometry.arrays import FloatArray
from omniservo.hardware import ArmAddress, ArmConnection
from omniservo.hardware.camera_sources import open_camera
from omniservo.hardware.shifted_camera import ShiftedCamera
from omniservo.robots import Arm, CameraSource, next_image
from omniservo.runs.checked_connection import CheckedConnection
from omniservo.runs.hardware_cell import HardwareCell
from omniservo.runs.moved_joint import moved_joint
from omniservo.runs.on_robot import image_latency_of, on_robot
from omniservo.runs.robot_records import StoredDelay
from omniservo.runs.safety_of_task import image_age_of, safety_of_task
from omniservo.safety import SafetyOptions, refuse_unready
from omniservo.scenes import Scene
from omniservo.tasks import RobotFile, Task

PERIODS = 2.0
"""A command counts for so many of the camera's periods longer."""

PATIENCE = 10.0
"""So long is waited for a first image [s]."""


def open_robot(robot: RobotFile, arm: Arm, driver: str | None = None) -> ArmConnection:
    """Connect to the arm of a robot file, in this process.

    Args:
        robot: the file.
        arm: as loaded of it.
        driver: replaces the file's; ``FILE.py:CLASS`` runs that file's code.

    Raises:
        InputError: no one there, other joints, or an arm that would go on moving if this program fell silent.
        ConnectionLost: the connection was lost before the first state.
    """
    where = _address(robot, arm, driver)
    connection = CheckedConnection(where.open(), where.joint_names)
    if connection.watchdog is None and robot.watchdog is None:
        connection.close()
        raise InputError(
            f"driver: {where.driver} cannot promise that the arm stops when commands cease; state the "
            "watchdog of your own that stops it, in seconds (watchdog: 0.1), or choose another driver"
        )
    return connection


def listen_to_arm(robot: RobotFile, arm: Arm, driver: str | None = None) -> ArmConnection:
    """Connect to the arm of a robot file for its joints alone, while somebody else moves it.

    Args:
        robot: the file.
        arm: as loaded of it.
        driver: see `open_robot`.

    Raises:
        InputError, ConnectionLost: see `open_robot`; what would stop it does not matter.
    """
    where = _address(robot, arm, driver)
    # A program of ours, or zeros on the topic of commands, would take the arm from pendant and hand.
    silent = {"rtde": {"send_program": False}, "ros2": {"listen_only": True}}.get(where.driver, {})
    listening = replace(where, options={**where.options, **silent})
    return CheckedConnection(listening.open(), where.joint_names)


def _address(robot: RobotFile, arm: Arm, driver: str | None) -> ArmAddress:
    if driver is None and ".py:" in robot.driver:
        raise InputError(
            f"driver: {spelled(robot.driver)} given; a robot file runs no code: --driver FILE.py:CLASS does"
        )
    names = robot.driver_names(arm)
    return ArmAddress(driver or robot.driver, robot.address, names, arm, robot.watchdog, dict(robot.options))


def open_robot_camera(robot: RobotFile, delay: StoredDelay | None = None) -> ShiftedCamera:
    """Connect to the camera of a robot file; its images have the size that its calibration states.

    Args:
        robot: the file.
        delay: how late its images are, as measured, by which their stamps are corrected; None: it was not.

    Raises:
        InputError: no one there, no images, or of another size.
    """
    lens = robot.camera.calibration
    offset, sigma = (0.0, 0.0) if delay is None else (delay.camera_offset, delay.camera_sigma)
    with ExitStack() as opened:
        camera = ShiftedCamera(_camera_at(robot), offset, sigma)
        opened.callback(camera.close)
        rows, columns = next_image(camera, time.sleep, patience=PATIENCE).pixels.shape
        if (columns, rows) != (lens.width, lens.height):
            raise InputError(
                f"camera.source: {robot.camera.source}: images of {columns}×{rows} px; the calibration is of "
                f"{lens.width}×{lens.height} px: another camera, or another setting of it"
            )
        opened.pop_all()
    return camera


def _camera_at(robot: RobotFile) -> CameraSource:
    """Return the camera at the file's URI."""
    ros = robot.driver == "ros2"
    states = str(robot.options.get("joint_states", "/joint_states")) if ros else ""
    return camera_at(robot.camera_uri, robot.address if ros else "", states)


def camera_at(uri: str, network: str = "", joint_states: str = "") -> CameraSource:
    """Connect to a camera by its URI, ROS 2 topics (``ros2:TOPIC``) included.

    Args:
        uri: see `open_camera`.
        network: of ROS 2: DOMAIN, or DOMAIN@INTERFACE.
        joint_states: of ROS 2: the topic whose clock the camera has; empty: its own.

    Raises:
        InputError: no one there, or no such camera.
    """
    scheme, _, topic = uri.partition(":")
    if scheme != "ros2":
        return open_camera(uri)
    from omniservo.hardware.ros2.open_ros2 import open_ros2_camera

    return open_ros2_camera(topic, network, joint_states)


def open_hardware(
    task: Task,
    robot: RobotFile,
    approve: Callable[[str], None],
    driver: str | None = None,
    delay: StoredDelay | None = None,
) -> tuple[Task, HardwareCell]:
    """Return the task as it is done on the robot from where its arm now stands, and the cell to do it in.

    Args:
        task: the job.
        robot: what it is done with.
        approve: called with what the arm is about to do; raises where it may not.
        driver: replaces the file's.
        delay: how late its images and motions are, as measured; None: it was not.

    Raises:
        InputError: see `on_robot`, `open_robot`, `open_robot_camera`; the arm was moved meanwhile.
        ServoStop: the arm may not be moved: protective stop, or somebody else is in control.
    """
    arm = robot.loaded_arm()
    late = None if delay is None else delay.loop
    begun, scene = on_robot(task, robot, arm, _joints(robot, arm, driver), late)
    options = safety_of_task(begun)
    if delay is not None:
        options = delay.within(options)
    # the supervisor's clock ends where an image comes, not where its twist acts
    age = image_age_of(robot.camera.rate, image_latency_of(robot.camera, late))
    options = replace(options, image_age=age)
    return begun, _cell(scene, robot, _Seats(approve, driver, delay), options)


def open_bare(
    robot: RobotFile, approve: Callable[[str], None], options: SafetyOptions, driver: str | None = None
) -> HardwareCell:
    """Return the cell of a robot without a task; the file's workspace is among its options.

    Raises:
        InputError, ServoStop: as `open_hardware`.
    """
    arm = robot.loaded_arm()
    mount, lens = robot.arm.flange_T_camera.transform, robot.camera.calibration
    scene = Scene(arm, RigidTransform.identity(), mount, lens, _joints(robot, arm, driver))
    if robot.workspace is not None:
        stated = robot.workspace.transformed(scene.world_T_camera(scene.start_joints).inv())
        box = np.array([stated.min, stated.max])
        options = replace(options, workspace=box, found_T_workspace=stated.transform)
    return _cell(scene, robot, _Seats(approve, driver, None), options)


@dataclass(frozen=True)
class _Seats:
    """How a cell is opened beside what its robot file says; see `open_hardware`."""

    approve: Callable[[str], None]
    driver: str | None
    delay: StoredDelay | None


def _cell(scene: Scene, robot: RobotFile, seats: _Seats, options: SafetyOptions) -> HardwareCell:
    where = _address(robot, scene.arm, seats.driver)
    opener = ArmOpener(ArmAddress.open, {"self": where}, robot.watchdog, tuple(where.joint_names))
    with ExitStack() as opened:
        camera = open_robot_camera(robot, seats.delay)
        opened.callback(camera.close)
        client = DriveClient(
            opener,
            scene.arm,
            scene.flange_T_camera,
            camera=camera,
            options=options,
            command_life=COMMAND_LIFE + PERIODS / robot.camera.rate,
        )
        opened.callback(client.close)
        # the workspace is stated from where the joints were read first
        if words := moved_joint(scene.arm, scene.start_joints, client.read().joint_positions):
            raise InputError(
                f"{words} while the robot was connected to; start again from where the arm now stands"
            )
        opened.pop_all()
    return HardwareCell(scene, client, camera, seats.approve)


def _joints(robot: RobotFile, arm: Arm, driver: str | None) -> FloatArray:
    """Return the joints (n,) [rad] of an arm that may be moved."""
    with closing(open_robot(robot, arm, driver)) as connection:
        state = connection.read()
    refuse_unready(state)
    return state.joint_positions
