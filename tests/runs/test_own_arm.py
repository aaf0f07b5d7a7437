"""The documentation's first task, with an arm that is not shipped: a gripper, six joints, no closed form."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from tests.cli.calling import call
from tests.robots.urdf_arms import CYLINDER, SIX, fingers, urdf
from tests.runs.changed_task import PlainCell

from omniservo.camera_files import save_camera
from omniservo.cameras import UnifiedCamera
from omniservo.robots import Arm, suggested_mount, suggested_posture, suggested_table
from omniservo.runs import run_task
from omniservo.runs.arm_setting_of import arm_setting_of
from omniservo.runs.plan_task import problem_of
from omniservo.scenes.scene_of_task import scene_of_task
from omniservo.tasks import load_task
from omniservo.whole_arm import plan_with_arm

PAGE = Path(__file__).resolve().parents[2] / "docs" / "tasks.md"
EXAMPLE, MORE = re.search(
    r"<!-- own-arm -->\n```yaml\n(.*?)```.*?```yaml\n(.*?)```", PAGE.read_text(), re.DOTALL
).groups()
"""the page's first task, and what it puts beside the way"""


ARM = urdf(SIX, visual=CYLINDER, extra=fingers())


@pytest.fixture(scope="module")
def completed(tmp_path_factory):
    """The page's task with what is suggested for the arm."""
    urdf_file = tmp_path_factory.mktemp("arm") / "my_arm.urdf"
    urdf_file.write_text(ARM)
    arm = Arm(urdf_file)
    posture = suggested_posture(arm)
    table = suggested_table(arm, suggested_mount(arm), posture)
    text = re.sub(r"joints: \[.*?\]", f"joints: {np.rad2deg(posture).round().tolist()}", EXAMPLE)
    places = [(1e3 * row).round().tolist() for row in (table.pose.translation, table.size)]
    stated = "center: {}, half_extents: {}, frame: base".format(*places)
    text = re.sub(r"center: .*?, frame: base", stated, text)
    text = re.sub(r"flange_T_camera: \{.*?\}", "flange_T_camera: {translation: [90, 0, 20]}", text)
    return text.replace("camera: perspective", "sensor: {rate: 10}\ncamera: camera.yaml")  # to be quick


@pytest.fixture
def file(completed, tmp_path):
    (tmp_path / "my_arm.urdf").write_text(ARM)
    save_camera(UnifiedCamera(210.0, 210.0, 159.5, 119.5, 0.0, 320, 240), tmp_path / "camera.yaml")
    (tmp_path / "task.yaml").write_text(completed)
    return tmp_path / "task.yaml"


@pytest.fixture
def task(file):
    return load_task(file)


def test_an_arm_with_a_gripper_is_planned_for_with_its_fingers(task):
    scene = scene_of_task(task)
    points = np.array([[x, y, 0.25 + x * y] for x in (-0.05, 0.0, 0.05) for y in (-0.04, 0.0, 0.04)])
    problem = problem_of(task, task.teach.initial_T_goal.transform, points)
    setting = arm_setting_of(task, scene)
    assert {"left", "right"} <= set(setting.bodies(problem.obstacles).links)
    assert plan_with_arm(problem, setting).plan.status == "certified"


@pytest.mark.parametrize(("nearer", "status"), [(0, "certified"), (30, "infeasible")])
def test_what_the_documentation_puts_beside_the_way_is_kept_from(file, nearer, status):
    document = {**yaml.safe_load(file.read_text()), **yaml.safe_load(MORE)}
    document["planning"]["obstacles"][0]["center"][0] -= nearer
    file.write_text(json.dumps(document))
    task = load_task(file)
    points = np.array([[x, y, 0.25 + x * y] for x in (-0.05, 0.0, 0.05) for y in (-0.04, 0.0, 0.04)])
    problem = problem_of(task, task.teach.initial_T_goal.transform, points)
    assert plan_with_arm(problem, arm_setting_of(task, scene_of_task(task))).plan.status == status


@pytest.mark.slow
def test_the_first_task_of_the_documentation_is_run_to_the_end(task):
    sensor = task.sensor.model_copy(update={"rate": 5.0})  # pictures take most of the time
    result = run_task(task.model_copy(update={"sensor": sensor}), PlainCell, filmed=False)
    assert result.metrics["status"] == "converged"
    assert result.metrics["contacts"] == []
    assert result.metrics["arm_clearance_executed_m"] is None  # there is no obstacle
    assert result.metrics["arm_clearance_proof"] == "clear"
    assert {"left", "right"} <= set(result.whole_arm.executed)
    assert result.metrics["final_translation_error_m"] < 5e-4


BAD = {
    "goal out of reach": (
        ("task.yaml", "translation: [60, 15, 50]", "translation: [60, 15, -950]"),
        (2, "teach.initial_T_goal: flange pose at .* the arm reaches 0.84. m from its first axis"),
    ),
    "start in an obstacle": (
        (
            "task.yaml",
            "planning:",
            "planning:\n  obstacles: [{type: sphere, center: [0, 0, -60], radius: 10}]",
        ),
        (1, "no path: infeasible: the start pose is not free: camera and obstacle 0 overlap by "),
    ),
    "limits narrower than the start": (
        ("my_arm.urdf", 'lower="-2.9"', 'lower="0.5"'),
        (2, r"task.yaml: start.joints: pan at 0.0 deg; legal: 28.6 … 166.2 deg"),
    ),
    "no limits": (
        ("my_arm.urdf", '<limit lower="-2.9" upper="2.9" velocity="2.0" effort="120"/>', ""),
        (2, "my_arm.urdf: line .*: joint 'pan': no <limit>; legal: <limit lower="),
    ),
    "a finger as the flange": (
        ("task.yaml", "flange: tool0", "flange: left"),
        (2, "joint 'slide_a': is of type 'prismatic' and carries the flange 'left'"),
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("fault", BAD)
def test_what_is_wrong_with_an_own_arm_is_one_message(capsys, file, fault):
    (name, given, instead), (wanted, message) = BAD[fault]
    text = (file.parent / name).read_text()
    assert given in text
    (file.parent / name).write_text(text.replace(given, instead, 1))
    code, out, err = call(capsys, "run", file, "--out", file.parent / "result", "--quiet")
    assert (code, out) == (wanted, "")
    assert re.search(message, err)
    assert len(err.splitlines()) == 1
    assert not (file.parent / "result").exists()
