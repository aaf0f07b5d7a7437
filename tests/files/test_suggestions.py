"""A misspelt name is told with the one that was probably meant."""

import json
from importlib import resources
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
import yaml

from omniservo.calibration.hand_eye import load_robot_poses
from omniservo.camera_files import named_camera, save_camera
from omniservo.cameras import UnifiedCamera, preset
from omniservo.errors import InputError
from omniservo.planning import PlanningProblem
from omniservo.robots import TrackingTube, load_arm
from omniservo.robots.path_following.tracking_tube import FORMAT as TUBE
from omniservo.targets import Target
from omniservo.tasks import TaughtGoal, load_task

PROBLEM = {
    "format": "omniservo.problem/1",
    "camera": preset("fe185").to_dict(),
    "points": [[0.0, 0.0, 0.5]],
    "goal": {"translation": [0.0, 0.0, 0.1], "quaternion": [0.0, 0.0, 0.0, 1.0]},
}
POSES = {"format": "omniservo.robot_poses/1", "base_T_flange": []}


def saved(name, fields, load):
    """What reading a file with these fields gives."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_text(json.dumps(fields))
        return load(path)


BALL = {"type": "sphere", "center": [0, 1, 0], "radius": 0.1}
MISSPELT = {
    "a task": (lambda: load_task("paper-exampel-1"), "paper-example-"),
    "an arm": (lambda: load_arm("u5re"), "ur5e"),
    "a preset": (lambda: named_camera("fe186"), "fe185"),
    "a calibration format": (lambda: save_camera(preset("fe185"), "camera.yaml", "kalbir"), "kalibr"),
    "a problem's field": (
        lambda: PlanningProblem.from_dict({**PROBLEM, "visiblity_margin": 2}),
        "visibility_margin",
    ),
    "an obstacle's field": (
        lambda: PlanningProblem.from_dict({**PROBLEM, "obstacles": [{**BALL, "clearence": 1}]}),
        "clearance",
    ),
    "an obstacle's type": (
        lambda: PlanningProblem.from_dict({**PROBLEM, "obstacles": [{**BALL, "type": "shpere"}]}),
        "sphere",
    ),
    "a camera's field": (
        lambda: UnifiedCamera.from_dict({**PROBLEM["camera"], "distorsion": [0, 0, 0, 0]}),
        "distortion",
    ),
    "a field of robot poses": (lambda: saved("poses.yaml", POSES | {"unit": {}}, load_robot_poses), "units"),
    "a robot pose's field": (
        lambda: saved(
            "poses.yaml", POSES | {"base_T_flange": [{"translatoin": [0, 0, 0]}]}, load_robot_poses
        ),
        "translation",
    ),
    "a goal's field": (
        lambda: saved("goal.json", {"format": "omniservo.goal/2", "featurs": []}, TaughtGoal.load),
        "features",
    ),
    "a tracking tube's field": (
        lambda: saved("tube.json", {"format": TUBE, "singular_values": 0.1}, TrackingTube.load),
        "singular_value",
    ),
    "a target's field": (lambda: Target.from_dict({"format": "omniservo.target/1", "pionts": []}), "points"),
}


@pytest.mark.parametrize("what", MISSPELT)
def test_a_misspelt_name_is_told_with_the_one_that_was_meant(what):
    call, meant = MISSPELT[what]
    with pytest.raises(InputError, match=f"; did you mean '{meant}"):
        call()


@pytest.mark.parametrize(
    ("section", "misspelt", "meant"),
    [
        ((), "tagret", "target"),
        (("planning",), "visiblity_margin", "visibility_margin"),
        (("planning", "obstacles", 0), "raduis", "radius"),
        (("arm",), "flange_T_camara", "flange_T_camera"),
        (("target", "boards", 0), "half_extent", "half_extents"),
    ],
)
def test_a_misspelt_field_anywhere_in_a_task_is_told_with_those_of_its_place(
    section, misspelt, meant, tmp_path
):
    text = (resources.files("omniservo.tasks") / "shipped" / "paper-example-1.yaml").read_text()
    fields = yaml.safe_load(text)
    place = fields
    for part in section:
        place = place[part]
    place[misspelt] = 1
    file = tmp_path / "task.yaml"
    file.write_text(yaml.safe_dump(fields))
    with pytest.raises(InputError, match=f"{misspelt}: no such field; legal: .*did you mean '{meant}'"):
        load_task(file)


def test_what_is_like_nothing_is_told_without_a_guess():
    with pytest.raises(InputError) as refusal:
        load_arm("zzz")
    assert "did you mean" not in str(refusal.value)
