"""Robot files: what they say, and what is wrong with them in one message."""

import pickle
import re
from pathlib import Path

import numpy as np
import pytest
import yaml

from omniservo.errors import InputError
from omniservo.tasks import load_robot

FIELDS = {
    "format": "omniservo.robot/1",
    "driver": "rtde",
    "address": "192.168.1.10",
    "arm": {"model": "ur5e", "flange_T_camera": {"translation": [0.0, 0.05, 0.03]}},
    "camera": {"source": "v4l2:0", "calibration": "fe185"},
}


def written(tmp_path, **changes):
    path = tmp_path / "robot.yaml"
    path.write_text(yaml.safe_dump({**FIELDS, **changes}))
    return path


def test_a_first_run_takes_a_tenth_of_the_joints_speeds(tmp_path):
    robot = load_robot(written(tmp_path))
    fast = load_robot(written(tmp_path), speed=1.0).loaded_arm()
    assert robot.speed == 0.1
    assert robot.loaded_arm().joint_speed == pytest.approx(0.1 * fast.joint_speed)
    assert robot.loaded_arm().joint_acceleration == pytest.approx(fast.joint_acceleration)


def test_joints_are_called_by_their_own_names_unless_the_file_says_otherwise(tmp_path):
    robot = load_robot(written(tmp_path, joints={"elbow": "elbow_joint"}))
    arm = robot.loaded_arm()
    names = robot.driver_names(arm)
    assert names[arm.joint_names.index("elbow")] == "elbow_joint"
    others = [(a, b) for a, b in zip(arm.joint_names, names, strict=True) if a != "elbow"]
    assert all(a == b for a, b in others)


def test_lengths_and_angles_are_in_the_units_that_the_file_states(tmp_path):
    mount = {"translation": [0.0, 50.0, 30.0], "rotation_vector": [0.0, 0.0, 90.0]}
    robot = load_robot(
        written(
            tmp_path,
            units={"length": "mm", "angle": "deg"},
            arm={"model": "ur5e", "flange_T_camera": mount},
            workspace={"min": [-500.0, -500.0, 0.0], "max": [500.0, 500.0, 900.0]},
        )
    )
    assert robot.arm.flange_T_camera.transform.translation == pytest.approx([0.0, 0.05, 0.03])
    assert robot.arm.flange_T_camera.transform.rotation.magnitude() == pytest.approx(np.pi / 2)
    assert robot.workspace.max == pytest.approx([0.5, 0.5, 0.9])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format": "omniservo.robot/9"}, r"format: 'omniservo.robot/9' given; legal: 'omniservo.robot/1'"),
        ({"sped": 0.1}, r"sped: no such field; legal: .*speed.*did you mean 'speed'"),
        ({"speed": 0.0}, r"speed: .*greater than 0; 0.0 given"),
        ({"speed": float("nan")}, r"speed"),
        ({"speed": 1.5}, r"speed: .*less than or equal to 1; 1.5 given"),
        ({"watchdog": -1.0}, r"watchdog: .*greater than 0; -1.0 given"),
        (
            {"arm": {**FIELDS["arm"], "foot": [0, 0, 0]}},
            r"arm.foot: where the arm stands",
        ),
        (
            {"arm": {"model": "ur5e", "flange_T_camera": {"translation": [0.0, 50.0, 30.0]}}},
            r"arm.flange_T_camera: .*the camera is 58.3095 m from the flange.*units: {length: mm}",
        ),
        (
            {"arm": {"model": "ur55"}},
            r"arm.model: 'ur55' is neither a file nor .*did you mean",
        ),
        ({"camera": {"calibration": "fe185"}}, r"camera.source: Field required"),
        ({"camera": {"source": "0", "calibration": "fe18"}}, r"camera.calibration: 'fe18' is neither"),
        ({"camera": {**FIELDS["camera"], "rate": 0}}, r"camera.rate: .*greater than 0; 0 given"),
        ({"options": {"x": [1]}}, r"options.x"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, changes, message):
    with pytest.raises(InputError, match=message):
        load_robot(written(tmp_path, **changes))


def test_a_joint_that_the_arm_does_not_have_is_named_with_those_it_has(tmp_path):
    robot = load_robot(written(tmp_path, joints={"elbow_joint": "elbow"}))
    with pytest.raises(InputError, match=r"robot.yaml: joints: elbow_joint: .* no such joint; legal: should"):
        robot.loaded_arm()


def test_two_joints_of_one_name_are_refused(tmp_path):
    robot = load_robot(written(tmp_path, joints={"elbow": "wrist_1"}))
    with pytest.raises(InputError, match="robot.yaml: joints: wrist_1: the name of two"):
        robot.driver_names(robot.loaded_arm())


def test_a_robot_file_reads_nothing_outside_its_folder(tmp_path):
    inner = tmp_path / "inner"
    inner.mkdir()
    (tmp_path / "camera.yaml").write_text("anything")
    path = written(inner, camera={"source": "0", "calibration": "../camera.yaml"})
    with pytest.raises(InputError, match=r"camera.calibration: .*--allow-outside"):
        load_robot(path)


def test_the_camera_source_and_the_speed_can_be_replaced(tmp_path):
    robot = load_robot(written(tmp_path), camera_source="rtsp://camera/1", speed=0.5)
    assert (robot.camera.source, robot.speed) == ("rtsp://camera/1", 0.5)


def test_the_robot_file_of_the_docs_is_legal(tmp_path):
    page = (Path(__file__).resolve().parents[2] / "docs" / "real-robot.md").read_text()
    (block,) = re.findall(r"```yaml\n(format: omniservo.robot.*?)```", page, re.DOTALL)
    fields = yaml.safe_load(block)
    fields["arm"] |= {"model": "ur5e", "flange_T_camera": FIELDS["arm"]["flange_T_camera"]}
    fields["camera"]["calibration"] = "fe185"
    fields["joints"] = {name.removesuffix("_joint"): called for name, called in fields["joints"].items()}
    robot = load_robot(written(tmp_path, **fields))
    assert robot.driver_names(robot.loaded_arm())[0] == "arm_shoulder_pan_joint"


def test_another_process_gets_the_slow_arm_slow(tmp_path):
    arm = load_robot(written(tmp_path)).loaded_arm()
    assert pickle.loads(pickle.dumps(arm)).joint_speed == pytest.approx(arm.joint_speed)  # noqa: S301
    assert arm.slowed(0.5).joint_speed == pytest.approx(0.5 * arm.joint_speed)
