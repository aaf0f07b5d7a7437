"""The dot tracker on rendered pictures of a whole scene."""

import numpy as np
from changed_task import shipped, written

from omniservo.perception import DotTracker, find_dots
from omniservo.scenes.scene_of_task import scene_of_task
from omniservo.simulation import SimulatedRobot
from omniservo.simulation.take_picture import take_picture
from omniservo.tasks import load_task


def test_dots_near_the_edge_of_a_grey_board_are_followed_as_they_are_found(tmp_path):
    """Against the mean of a small neighbourhood, such a dot and its board are one dark blob."""
    document = shipped("catadioptric-ring")
    for board in document["target"]["boards"][:7]:
        board["half_extents"] = [52, 46, 2]
    task = load_task(written(tmp_path, document))
    image = take_picture(SimulatedRobot(scene_of_task(task))).pixels
    true = task.camera.project(np.array([dot.center for dot in task.target.dots]))[0]
    assert len(find_dots(image, task.camera)) == len(true)
    pixels, valid = DotTracker(task.camera).update(image, true)
    assert valid.all()
    assert np.abs(pixels - true).max() < 0.2
