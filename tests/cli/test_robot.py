"""``omniservo robot show``: any arm's joints, links and reach, its picture; one message for a bad file."""

import json
import math

import numpy as np
import pytest
import yaml
from PIL import Image
from scipy.spatial.transform import Rotation
from tests.cli.calling import call
from tests.robots.urdf_arms import urdf

from omniservo.robots import load_arm, shipped_arms


@pytest.mark.slow
@pytest.mark.parametrize("name", shipped_arms())
def test_a_shipped_arm_is_shown_as_json(capsys, name):
    code, out, err = call(capsys, "robot", "show", name, "--json")
    assert (code, err) == (0, "")
    shown, arm = json.loads(out), load_arm(name)
    assert shown["name"] == name
    assert [joint["name"] for joint in shown["joints"]] == list(arm.joint_names)
    assert {joint["type"] for joint in shown["joints"]} == {"revolute"}
    np.testing.assert_allclose([[j["lower"], j["upper"]] for j in shown["joints"]], arm.joint_range)
    np.testing.assert_allclose([j["speed"] for j in shown["joints"]], arm.joint_speed)
    assert shown["reach"] == pytest.approx(arm.reach)
    assert len(shown["links"]) == arm.dof + 1
    assert all(link["shapes"] for link in shown["links"])


@pytest.mark.slow
def test_an_arm_is_shown_to_people_with_degrees_and_drawn(capsys, tmp_path):
    code, out, err = call(capsys, "robot", "show", "rx60", "--out", tmp_path / "drawn")
    assert (code, err) == (0, "")
    assert "-160.0 …  160.0 deg   287.0 deg/s" in out
    assert "0.667 m from the axis of j1" in out
    picture = np.asarray(Image.open(tmp_path / "drawn" / "arm.png").convert("RGB")).astype(int)
    yellow = picture[..., :2].min(axis=-1) > picture[..., 2] + 50
    assert yellow[:, : picture.shape[1] // 2].mean() > 0.05
    assert (tmp_path / "drawn" / "arm.svg").read_text().startswith("<?xml")


def test_the_flange_can_be_chosen(capsys):
    _, out, _ = call(capsys, "robot", "show", "rx60", "--flange", "flange", "--json")
    assert math.isclose(json.loads(out)["flange"]["link_T_flange"][2][3], 0.065)
    code, out, err = call(capsys, "robot", "show", "rx60", "--flange", "shoulder")
    assert (code, out) == (2, "")
    assert "flange 'shoulder': carried by 1 joint (j1); legal: 6 or 7 in a row, which carry flange" in err


def test_the_flange_is_still_found_under_its_option_of_before(capsys):
    code, out, _ = call(capsys, "robot", "show", "rx60", "--tool", "flange")
    assert code == 0
    assert "--tool is called --flange now" in out
    assert "--tool" not in call(capsys, "robot", "show", "--help")[1]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rpy", "rotation_vector"),
    [
        ("0 0 0.5", [0, 0, 0]),
        ("3.141592653589793 0 0", [180, 0, 0]),
        ("0 -1.5707963267948966 0", [0, 90, 0]),
        ("0.5235987755982988 0 0", [-30, 0, 0]),
    ],
)
def test_a_mount_is_suggested_that_looks_along_the_hand(capsys, tmp_path, rpy, rotation_vector):
    path = tmp_path / "arm.urdf"
    path.write_text(urdf().replace('rpy="0 0 0.5"', f'rpy="{rpy}"'))
    code, out, _ = call(capsys, "robot", "show", path)
    assert code == 0
    line = next(line for line in out.splitlines() if line.startswith("mount "))
    mount = yaml.safe_load(line.removeprefix("mount").partition(" mm, deg")[0])
    assert mount["rotation_vector"] == rotation_vector
    ahead = np.linalg.norm(mount["translation"])
    assert 90.5 <= ahead <= 150.1
    turned = Rotation.from_rotvec(rotation_vector, degrees=True).apply([0.0, 0.0, ahead])
    np.testing.assert_allclose(turned, mount["translation"], atol=0.1)


def test_a_bad_file_is_one_message_and_exit_code_2(capsys, tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text('<!DOCTYPE a [<!ENTITY b SYSTEM "file:///etc/hostname">]><robot name="a">&b;</robot>')
    code, out, err = call(capsys, "robot", "show", path, "--out", tmp_path / "drawn")
    assert (code, out) == (2, "")
    assert err == f"omniservo: {path}: line 1: document types (DOCTYPE) are not read\n"
    assert not (tmp_path / "drawn").exists()
    code, _, err = call(capsys, "robot", "show", "kr6")
    assert code == 2
    assert "neither a file nor one of the shipped arms: panda, rx60, ur5e" in err
