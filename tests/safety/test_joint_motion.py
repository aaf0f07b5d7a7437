"""A joint path is followed by the joints' own readings, and left by none of them."""

import numpy as np
import pytest
from tests.safety.conftest import START

from omniservo.errors import ServoStop
from omniservo.robots.path_following.joint_segment import joint_segment
from omniservo.safety import OffPath, follow_joints

END = START + np.array([0.2, -0.1, 0.15, 0.1, -0.2, 0.3])
WITHIN = 1e-3


def test_the_arm_keeps_to_the_line_and_stands_at_its_end(guard, written, arm, scene):
    path = joint_segment(arm, START, END, scene.flange_T_camera)
    took = follow_joints(guard(), path, WITHIN)
    gone = np.array(written.joints) - START
    along = (gone @ (END - START)) / ((END - START) @ (END - START))
    assert np.abs(gone - along[:, None] * (END - START)).max() < 0.3 * WITHIN
    assert np.abs(written.read().joint_positions - END).max() < 3e-4
    assert np.abs(written.read().joint_velocities).max() < 1e-3
    assert took >= 2.0


def test_a_joint_that_leaves_the_line_stops_the_arm(guard, written, arm, scene):
    path, command = joint_segment(arm, START, END, scene.flange_T_camera), written.command
    written.command = lambda velocities: command(np.asarray(velocities) * [1, 1, 0.8, 1, 1, 1])
    supervisor = guard()
    with pytest.raises(OffPath, match="off its path"):
        follow_joints(supervisor, path, WITHIN)
    assert isinstance(supervisor.stopped, OffPath)
    with pytest.raises(ServoStop, match="stopped before"):
        supervisor.command(np.zeros(6))
