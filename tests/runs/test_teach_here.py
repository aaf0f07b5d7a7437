"""A goal is taught with the joints in which its image was taken."""

from dataclasses import replace

import numpy as np
import pytest

from omniservo.errors import InputError
from omniservo.runs import teach_here
from omniservo.simulation import SimulatedCell
from omniservo.tasks import load_task


class Turning:
    """An arm that is led by hand: its second joint turns by so much from one reading to the next [rad]."""

    def __init__(self, cell, step):
        self._cell, self._step, self._readings = cell, step, 0

    def __getattr__(self, name):
        return getattr(self._cell, name)

    @property
    def driver(self):
        return self

    def read(self):
        state = self._cell.driver.read()
        self._readings += 1
        turned = self._readings * self._step * np.eye(len(state.joint_positions))[1]
        return replace(state, joint_positions=state.joint_positions + turned)


def test_an_arm_that_moves_while_the_goal_image_is_taken_is_refused_by_the_joint_s_name():
    task = load_task("paper-example-1")
    cell = SimulatedCell(task, 0)
    with pytest.raises(
        InputError, match=rf"{cell.scene.arm.joint_names[1]} turned by 0\.57 deg while it was taken"
    ):
        teach_here(task, Turning(cell, 0.01))
    start = cell.driver.read().joint_positions
    taught = teach_here(task, Turning(cell, 0.0004))
    assert taught.joints - start == pytest.approx(2 * 0.0004 * np.eye(len(start))[1])
