"""The documentation's first task, with an arm that is not shipped: a gripper, six joints, no closed form."""

import re
from pathlib import Path

import numpy as np
import pytest
from tests.robots.urdf_arms import CYLINDER, SIX, fingers, urdf

from omniservo.calibration import save_camera
from omniservo.cameras import UnifiedCamera
from omniservo.planning import plan_with_arm
from omniservo.robots import Arm, handy_posture
from omniservo.runs import run_task
from omniservo.runs.arm_setting_of import arm_setting_of
from omniservo.runs.plan_task import problem_of
from omniservo.simulation.scene_of_task import scene_of_task
from omniservo.tasks import load_task

PAGE = Path(__file__).resolve().parents[2] / "docs" / "tasks.md"
EXAMPLE = re.search(r"<!-- own-arm -->\n```yaml\n(.*?)```", PAGE.read_text(), re.DOTALL)[1]


@pytest.fixture
def task(tmp_path):
    (tmp_path / "my_arm.urdf").write_text(urdf(SIX, visual=CYLINDER, extra=fingers()))
    joints = np.rad2deg(handy_posture(Arm(tmp_path / "my_arm.urdf"))).round().tolist()
    text = re.sub(r"joints: \[.*?\]", f"joints: {joints}", EXAMPLE)
    text = re.sub(r"tool_T_camera: \{.*?\}", "tool_T_camera: {translation: [90, 0, 20]}", text)
    save_camera(UnifiedCamera(210.0, 210.0, 159.5, 119.5, 0.0, 320, 240), tmp_path / "camera.yaml")
    text = text.replace("camera: perspective", "sensor: {rate: 10}\ncamera: camera.yaml")  # to be quick
    (tmp_path / "task.yaml").write_text(text)
    return load_task(tmp_path / "task.yaml")


def test_an_arm_with_a_gripper_is_planned_for_with_its_fingers(task):
    scene = scene_of_task(task)
    points = np.array([[x, y, 0.25 + x * y] for x in (-0.05, 0.0, 0.05) for y in (-0.04, 0.0, 0.04)])
    problem = problem_of(task, task.teach.initial_T_goal.transform, points)
    setting = arm_setting_of(task, scene)
    assert {"left", "right"} <= set(setting.bodies(problem.obstacles).links)
    assert plan_with_arm(problem, setting).plan.status == "certified"


def test_the_first_task_of_the_documentation_is_run_to_the_end(task):
    result = run_task(task, filmed=False)
    assert result.metrics["status"] == "converged"
    assert result.metrics["contacts"] == []
    assert result.metrics["arm_clearance_proof"] == "clear"
    assert {"left", "right"} <= set(result.whole_arm.executed)
    assert result.metrics["final_translation_error_m"] < 5e-4
