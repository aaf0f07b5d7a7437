"""A task as it is done on a real robot: with its arm, mount and camera, from where the arm now stands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray
from omniservo.robots import Arm
from omniservo.runs.begun_elsewhere import begun_at
from omniservo.runs.loop_delay import LoopDelay
from omniservo.scenes import Scene, scene_of_task
from omniservo.tasks import RobotFile, Task, TaskOnRobot
from omniservo.tasks.robot_file import RobotCamera
from omniservo.tasks.sensor import SensorSection
from omniservo.tasks.simulation import SimulationSection


def on_robot(
    task: Task, robot: RobotFile, arm: Arm, joints: FloatArray, late: LoopDelay | None = None
) -> tuple[Task, Scene]:
    """Return task and scene for a real arm that stands in ``joints`` (n,) [rad].

    Everything that the task states stays where it is in the arm's base frame; what its camera and its start
    were is replaced by the robot's. Its time limit grows by what the arm is slowed down.

    ``late``: how much later than an image its twist acts, as measured; None: as `sensor_of` states it.

    Raises:
        InputError: the task moves obstacles itself; both state a workspace; the joints are out of range.
    """
    if task.moves:
        raise InputError(f"{task.name}: moves: obstacles are moved by the simulator alone")
    if robot.workspace is not None and task.planning.workspace is not None:
        raise InputError(f"{task.name}: planning.workspace: the robot file states one too; legal: one")
    if words := out_of_range(arm, joints):
        raise InputError(words)
    world_T_base = RigidTransform.from_translation(np.asarray(task.arm.foot))
    flange_T_camera = robot.arm.flange_T_camera.transform
    world_T_here = world_T_base * arm.base_T_flange(joints) * flange_T_camera
    begun = begun_at(task, world_T_here, joints, 0.0)
    planning, lens = begun.planning, robot.camera
    if robot.workspace is not None:
        stated = robot.workspace.transformed(world_T_here.inv() * world_T_base)
        planning = planning.model_copy(update={"workspace": stated})
    begun = begun.model_copy(
        update={
            "arm": robot.arm.model_copy(update={"foot": task.arm.foot}),
            "camera": lens.calibration,
            "sensor": sensor_of(lens, late),
            "simulation": SimulationSection(),
            "planning": planning,
            "servo": task.servo.model_copy(update={"time_limit": task.servo.time_limit / robot.speed}),
        }
    )
    if task.sources is not None:
        sources, kept = task.sources, None if late is None else late.to_dict()
        begun = begun.read_from(TaskOnRobot(sources.path, sources.read, sources.packages, task, robot, kept))
    return begun, replace(scene_of_task(begun), arm=arm, start_joints=joints)


def out_of_range(arm: Arm, joints: FloatArray) -> str:
    """Return in words which joint (n,) [rad] is farthest out of its range; "" where none is."""
    margins = arm.limit_margins(joints)
    worst = int(margins.argmin())
    if margins[worst] >= 0.0:
        return ""
    at, low, high = np.rad2deg([joints[worst], *arm.joint_range[worst]])
    return (
        f"the arm's joint {arm.joint_names[worst]} is at {at:.2f} deg, out of the range in {arm.path.name}, "
        f"{low:.5g} to {high:.5g} deg: bring it inside; or is this another arm's file, or another zero?"
    )


def sensor_of(lens: RobotCamera, late: LoopDelay | None = None) -> SensorSection:
    """Return how a robot's camera delivers images, as its file has it, and how late a twist acts on them.

    ``late``: as measured; None: 20 ms later than the middle of the exposure.
    """
    acts = SensorSection().latency if late is None else late.total
    return SensorSection(
        rate=lens.rate,
        latency=max(acts, 0.5 * (lens.exposure + lens.readout)),
        exposure=lens.exposure,
        readout=lens.readout,
    )


def image_latency_of(lens: RobotCamera, late: LoopDelay | None = None) -> float:
    """Return how late a robot's images come after the middle of their exposure, at most [s].

    ``late``: as measured; None: as late as `sensor_of` takes a twist to act.
    """
    return sensor_of(lens).latency if late is None else late.images
