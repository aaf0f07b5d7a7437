"""``omniservo verify``: plans and problems as files, and what is no file at all."""

import json
import os

import pytest
import yaml
from tests.cli.calling import call
from tests.cli.test_command_line import problem

from omniservo.camera_files import save_camera
from omniservo.cameras import UnifiedCamera


@pytest.fixture
def planned(capsys, tmp_path):
    """A problem whose camera is a file, and its plan."""
    fields = problem()
    save_camera(UnifiedCamera.from_dict(fields["camera"]), tmp_path / "camera.yaml", "kalibr")
    source, plan = tmp_path / "problem.yaml", tmp_path / "plan.json"
    source.write_text(yaml.safe_dump({**fields, "camera": "camera.yaml"}))
    assert call(capsys, "plan", source, "--out", plan, "--quiet")[0] == 0
    return source, plan


def test_a_plan_is_verified_for_the_problem_that_was_meant(capsys, planned):
    source, plan = planned
    code, out, err = call(capsys, "verify", plan, "--problem", source)
    assert (code, err) == (0, "")
    assert f"the plan's problem is that of {source}" in out
    assert json.loads(call(capsys, "verify", plan, "--problem", source, "--json")[1])["differences"] == []
    assert json.loads(call(capsys, "verify", plan, "--json")[1])["differences"] is None


def test_a_plan_for_another_problem_is_exit_code_1_and_says_what_differs(capsys, planned):
    source, plan = planned
    fields = yaml.safe_load(source.read_text())
    fields["obstacles"][0]["radius"] = 0.021
    fields["visibility_margin"] = 1.0
    source.write_text(yaml.safe_dump(fields))
    code, out, err = call(capsys, "verify", plan, "--problem", source, "--json")
    assert (code, err.count("\n")) == (1, 1)
    assert err == (
        "omniservo: refuted: problem.obstacles[0].radius: 0.02 in the plan, 0.021 was meant; "
        "problem.visibility_margin: 0.0 in the plan, 1.0 was meant; "
        "next: omniservo plan makes another; do not move along this one\n"
    )
    assert json.loads(out)["differences"] == [
        {"field": "obstacles[0].radius", "plan": 0.02, "problem": 0.021},
        {"field": "visibility_margin", "plan": 0.0, "problem": 1.0},
    ]


def test_an_obstacle_left_out_of_a_plan_consistently_is_found(capsys, planned):
    """The problem and the certificate of the plan agree; what was asked for had one obstacle more."""
    source, plan = planned
    document = json.loads(plan.read_text())
    document["problem"]["obstacles"] = []
    lines = document["certificate"]["constraints"]
    document["certificate"]["constraints"] = [c for c in lines if "obstacle" not in c["name"]]
    document["certificate"]["worst"] = None
    plan.write_text(json.dumps(document))
    assert call(capsys, "verify", plan)[0] == 0
    code, _, err = call(capsys, "verify", plan, "--problem", source)
    assert code == 1
    assert "refuted: problem.obstacles[0]: none in the plan, {'" in err


def test_a_wrong_problem_file_is_exit_code_2(capsys, tmp_path, planned):
    _, plan = planned
    (tmp_path / "none.json").write_text("{}")
    for file in ("none.json", "missing.json"):
        code, _, err = call(capsys, "verify", plan, "--problem", tmp_path / file)
        assert (code, err.count("\n")) == (2, 1)


def test_what_is_no_regular_file_is_one_line_and_never_waited_for(capsys, tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for path in ("/dev/zero", "/dev/stdin", tmp_path / "pipe", tmp_path):
        code, _, err = call(capsys, "verify", path)
        assert (code, err) == (2, f"omniservo: {path}: a directory, device or pipe; a file is needed\n")
    assert call(capsys, "verify", tmp_path / "none")[::2] == (
        2,
        f"omniservo: {tmp_path / 'none'}: no such file\n",
    )
    large = tmp_path / "large"
    with large.open("wb") as file:
        file.truncate(17 << 20)
    assert call(capsys, "verify", large)[2] == f"omniservo: {large}: at most 16777216 bytes are read\n"
