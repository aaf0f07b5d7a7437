"""Views for a hand-eye calibration from a robot whose arm is moved by hand or pendant."""

from __future__ import annotations

import json
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING

from omniservo.cli.live_views import FIRST_IMAGE, watched, write_images
from omniservo.cli.output import Output

if TYPE_CHECKING:
    from omniservo.calibration.boards import Board
    from omniservo.cameras.models import CentralModel
    from omniservo.tasks import RobotFile

POSES = "poses.json"
"""beside the images: the flange's poses"""


def take_views(
    robot: RobotFile,
    driver: str | None,
    board: Board,
    folder: Path,
    output: Output,
    *,
    seconds: float | None,
    force: bool,
) -> tuple[CentralModel, list[Path]]:
    """Watch a robot's camera and joints until nothing is missing or Ctrl-C; write images and poses.

    Nothing is commanded.

    Returns:
        The robot's camera, and the images' files, in the order in which they were taken.

    Raises:
        InputError: no such robot, or the folder cannot be written.
        NoSolutionError: too few were kept for a calibration; nothing is written.
    """
    from omniservo.calibration.hand_eye.pose_choice import FEWEST_POSES
    from omniservo.files import whole_folder, writable_folder, write_whole
    from omniservo.runs.open_hardware import listen_to_arm, open_robot_camera
    from omniservo.runs.watch_camera import ArmViewsOfBoard

    writable_folder(folder, FIRST_IMAGE, force=force)
    model = robot.loaded_arm()
    with output.working("connecting to arm and camera"):
        arm = listen_to_arm(robot, model, driver)
    with closing(arm), closing(open_robot_camera(robot)) as camera:
        choice = ArmViewsOfBoard(arm, robot.camera.calibration, board)
        watch = watched(camera, choice, output, seconds, FEWEST_POSES)
    poses = [model.base_T_flange(joints) for joints in choice.poses.joints]
    with whole_folder(folder, FIRST_IMAGE, force=force) as unfinished:
        names = write_images(watch, unfinished)
        entries = [
            {
                "image": name,
                "translation": pose.translation.tolist(),
                "quaternion": pose.rotation.as_quat().tolist(),
            }
            for name, pose in zip(names, poses, strict=True)
        ]
        document = {"format": "omniservo.robot_poses/1", "base_T_flange": entries}
        write_whole(unfinished / POSES, json.dumps(document, indent=1))
    output.written(folder)
    return robot.camera.calibration, [folder / name for name in names]
