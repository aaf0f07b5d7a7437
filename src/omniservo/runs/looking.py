"""Moving the arm and taking an image in a robot cell, for who looks again."""

from __future__ import annotations

import numpy as np

from omniservo.geometry.arrays import ByteArray, FloatArray
from omniservo.looks import FOLLOWED
from omniservo.robots import CameraImage, JointPath, next_image
from omniservo.runs.job_recording import JobRecording
from omniservo.runs.look_again import TakeShot
from omniservo.runs.robot_cell import RobotCell
from omniservo.runs.safety_of_task import safety_of_task
from omniservo.runs.supervisor_of import supervisor_of
from omniservo.safety import follow_joints
from omniservo.scenes import Scene
from omniservo.tasks import Task


def looking(cell: RobotCell, recording: JobRecording | None) -> TakeShot:
    """Return what moves the cell's arm and takes an image; the ``recording`` is given."""

    def take(task: Task, scene: Scene, path: JointPath) -> tuple[float, ByteArray, FloatArray]:
        moved = scene.world_T_camera(scene.start_joints).inv() * scene.world_T_camera(path(np.array(1.0)))
        cell.approve(
            f"look again: move the camera by {1e3 * np.linalg.norm(moved.translation):.0f} mm and "
            f"{np.rad2deg(moved.rotation.magnitude()):.1f} deg, along joints that are proven free"
        )
        supervisor = supervisor_of(cell, safety_of_task(task))
        took = follow_joints(supervisor, path, FOLLOWED)
        image, joints = _image_at_rest(cell), cell.driver.read().joint_positions
        if recording is not None:
            recording.looked(image, scene, joints, took)
        return took, image.pixels, joints

    return take


def _image_at_rest(cell: RobotCell) -> CameraImage:
    """Return an image that was exposed after the arm had come to rest."""
    arrived = cell.driver.read().time
    image = next_image(cell.camera, cell.wait)
    while image.earliest < arrived:
        image = next_image(cell.camera, cell.wait)
    return image
