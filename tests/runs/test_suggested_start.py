"""What `robot show` suggests is a start with which the documentation's first task can be planned."""

import re
from dataclasses import replace

import numpy as np
import pytest
from tests.robots.urdf_arms import SEVEN, SIX, fingers, urdf
from tests.runs.test_own_arm import EXAMPLE

from omniservo.robots import Arm, load_arm, shipped_arms, suggested_mount, suggested_posture, suggested_table
from omniservo.runs.arm_setting_of import arm_setting_of
from omniservo.runs.plan_task import problem_of
from omniservo.scenes.scene_of_task import scene_of_task
from omniservo.tasks import load_task
from omniservo.whole_arm import plan_with_arm

QUARTER, HALF = np.pi / 2, np.pi
UR3E, UR5E, UR10E = (
    (0.15185, 0.24355, 0.2132, 0.13105, 0.08535, 0.0921),
    (0.1625, 0.425, 0.3922, 0.1333, 0.0997, 0.0996),
    (0.1807, 0.6127, 0.57155, 0.17415, 0.11985, 0.11655),
)
"""d1, -a2, -a3, d4, d5, d6 [m] of the makers' tables"""


def universal(d1, a2, a3, d4, d5, d6):
    """Joints of an arm of Universal Robots: name, place and turn of its frame, lower and upper end."""
    return (
        ("pan", (0, 0, d1), (0, 0, HALF), -6.28, 6.28),
        ("lift", (0, 0, 0), (QUARTER, 0, 0), -6.28, 6.28),
        ("elbow", (-a2, 0, 0), (0, 0, 0), -3.14, 3.14),
        ("wrist_1", (-a3, 0, d4), (0, 0, 0), -6.28, 6.28),
        ("wrist_2", (0, -d5, 0), (QUARTER, 0, 0), -6.28, 6.28),
        ("wrist_3", (0, d6, 0), (-QUARTER, 0, 0), -6.28, 6.28),
    )


def dressed(rows, radius):
    """The URDF of joints whose links are cylinders from each to the next."""
    ends = [np.array(row[1]) for row in rows[1:]] + [np.zeros(3)]
    parts = [_link("base_link", np.array([0.0, 0.0, rows[0][1][2] - 2 * radius]), 1.3 * radius)]
    for row, parent, end in zip(rows, ["base_link", *(r[0] + "_link" for r in rows)], ends, strict=False):
        name, xyz, rpy, low, high = row
        parts.append(
            f'<joint name="{name}" type="revolute"><origin xyz="{_words(xyz)}" rpy="{_words(rpy)}"/>'
            f'<parent link="{parent}"/><child link="{name}_link"/><axis xyz="0 0 1"/>'
            f'<limit lower="{low}" upper="{high}" velocity="2" effort="100"/></joint>'
        )
        parts.append(_link(f"{name}_link", end, radius))
    return "\n".join(['<robot name="written">', *parts, "</robot>"])


def _link(name, end, radius):
    length, middle = np.linalg.norm(end), 0.5 * end
    shape = ""
    if length > 1e-3:
        along = 0.0, np.arccos(end[2] / length), np.arctan2(end[1], end[0])
        shape = (
            f'<collision><origin xyz="{_words(middle)}" rpy="{_words(along)}"/>'
            f'<geometry><cylinder radius="{radius}" length="{length}"/></geometry></collision>'
        )
    return f'<link name="{name}">{shape}</link>'


def _words(values):
    return " ".join(f"{value:.9g}" for value in values)


WRITTEN = {
    "ur3e": dressed(universal(*UR3E), 0.04),
    "ur5e": dressed(universal(*UR5E), 0.05),
    "ur10e": dressed(universal(*UR10E), 0.055),
    "six with fingers": urdf(SIX, extra=fingers()),
    "seven": urdf(SEVEN),
}


def suggested(folder, arm):
    """The documentation's task with what is suggested for an arm, and the suggested joints."""
    mount, joints = suggested_mount(arm), suggested_posture(arm)
    table = suggested_table(arm, mount, joints)
    text = re.sub(r"model: .*", f"model: {arm.path.name}", EXAMPLE).replace(
        "flange: tool0", f"flange: {arm.flange}"
    )
    text = re.sub(r"joints: \[.*?\]", f"joints: {np.rad2deg(joints).round().tolist()}", text)
    rows = (1e3 * mount.translation).tolist(), np.rad2deg(mount.rotation.as_rotvec()).tolist()
    stated = "{{translation: {}, rotation_vector: {}}}".format(*rows)
    text = re.sub(r"flange_T_camera: \{.*?\}", f"flange_T_camera: {stated}", text)
    if table is None:
        text = re.sub(r"surroundings:.*?\n  - .*?\n", "", text)
    else:
        places = [(1e3 * row).round().tolist() for row in (table.pose.translation, table.size)]
        text = re.sub(
            r"center: .*?, frame: base", "center: {}, half_extents: {}, frame: base".format(*places), text
        )
    (folder / "task.yaml").write_text(text)
    return load_task(folder / "task.yaml"), joints


@pytest.mark.parametrize("name", [*shipped_arms(), *WRITTEN])
def test_the_first_task_is_planned_with_what_is_suggested(tmp_path, name):
    if name in WRITTEN:
        (tmp_path / "arm.urdf").write_text(WRITTEN[name])
        arm = Arm(tmp_path / "arm.urdf")
    else:
        shipped = load_arm(name)
        (tmp_path / shipped.path.name).write_text(shipped.path.read_text())
        arm = Arm(tmp_path / shipped.path.name)
    task, joints = suggested(tmp_path, arm)
    assert np.rad2deg(joints) == pytest.approx(np.rad2deg(joints).round(), abs=1e-9)
    corners = 0.5 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    points = np.concatenate([tag.transform.apply(tag.edge * corners) for tag in task.target.tags.panels])
    problem = problem_of(task, task.teach.initial_T_goal.transform, points)
    setting = arm_setting_of(task, scene_of_task(task))
    for asked in (problem, replace(problem, occlusion=True)):
        plan = plan_with_arm(asked, setting).plan
        assert (plan.status, plan.reason) == ("certified", "")
