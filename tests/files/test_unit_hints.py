"""A value that is a thousand times, or 57 times, out of its range is told with the unit that was meant."""

from importlib import resources

import pytest
import yaml
from scipy.spatial.transform import RigidTransform

from omniservo.calibration.boards import board_from_text
from omniservo.errors import InputError
from omniservo.robots import load_arm
from omniservo.tasks import load_task


def task_with_joints(folder, joints):
    fields = yaml.safe_load((resources.files("omniservo.tasks") / "shipped" / "ur5e-table.yaml").read_text())
    fields["units"] = {"length": "mm"}
    fields["start"] = {"joints": joints}
    file = folder / "task.yaml"
    file.write_text(yaml.safe_dump(fields))
    return file


def test_joints_in_degrees_are_told_with_the_field_that_says_so(tmp_path):
    with pytest.raises(
        InputError, match=r"legal: .* deg; if they are in degrees, state units: \{angle: deg\}"
    ):
        load_task(task_with_joints(tmp_path, [0, -90, 90, -90, -90, 0]))
    with pytest.raises(InputError, match=r"legal: .* deg$"):
        load_task(task_with_joints(tmp_path, [0, -9000, 90, -90, -90, 0]))


def test_a_pose_far_out_of_reach_is_told_with_a_question_about_its_unit():
    arm = load_arm("ur5e")
    with pytest.raises(InputError, match=r"out of the arm's reach, .*units: \{length: mm\}"):
        arm.inverse(RigidTransform.from_translation([300.0, 200.0, 400.0]))
    with pytest.raises(InputError, match=r"out of the arm's reach, which is [0-9.]+ m$"):
        arm.inverse(RigidTransform.from_translation([1.5, 0.0, 0.4]))


@pytest.mark.parametrize("text", ["checkerboard:9x6:24.23", "aprilgrid:6x6:88:0.3"])
def test_a_board_of_squares_of_many_metres_is_refused_with_what_was_meant(text):
    with pytest.raises(InputError, match=r"24.23 mm are 0.02423|88 mm are 0.088"):
        board_from_text(text)
