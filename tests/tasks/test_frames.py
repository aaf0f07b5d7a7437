"""Places in a task are stated in the initial camera's frame, the arm's base frame, or the goal camera's."""

import copy
import json
import re

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.errors import InputError
from omniservo.robots import load_arm
from omniservo.runs.arm_setting_of import arm_setting_of
from omniservo.runs.plan_task import problem_of
from omniservo.scenes.scene_of_task import scene_of_task
from omniservo.simulation import World
from omniservo.tasks import load_task
from omniservo.whole_arm import plan_with_arm

JOINTS = [0.0, 43.0, -64.0, 0.0, 111.0, 20.0]
FOOT = [100.0, -50.0, 300.0]
MOUNT = RigidTransform.from_components([0.0, 0.02, 0.0905], Rotation.from_rotvec([0.0, 0.1, 1.2]))
GOAL = RigidTransform.from_components([0.05, 0.02, 0.03], Rotation.from_rotvec([0.1, -0.2, 0.1]))


def pose(transform):
    vector = np.rad2deg(transform.rotation.as_rotvec())
    return {"translation": (1e3 * transform.translation).tolist(), "rotation_vector": vector.tolist()}


def base_T_initial():
    return load_arm("rx60").base_T_flange(np.deg2rad(JOINTS)) * MOUNT


INITIAL_T = {"initial": RigidTransform.identity(), "base": base_T_initial().inv(), "goal": GOAL}

BLOCK = (
    RigidTransform.from_components([0.1, 0.05, 0.3], Rotation.from_rotvec([0.2, 0.3, -0.1])),
    [50, 20, 10],
)
NORMAL = np.array([0.6, 0.0, 0.8])
SPOTS = {
    "sphere": [[0.1, 0.2, 0.3]],
    "capsule": [[0.1, 0.2, 0.3], [-0.1, 0.1, 0.5]],
    "mesh": [[0.3, 0.2, 0.1], [0.4, 0.2, 0.1], [0.3, 0.3, 0.1], [0.3, 0.2, 0.2]],
    "cloud": [[0.3, 0.2, 0.1], [0.1, 0.25, 0.4], [0.0, -0.4, 0.4]],
}


def block(initial_T, spot=BLOCK):
    """Fields of a box, as seen in another frame."""
    seen = initial_T.inv() * spot[0]
    vector = np.rad2deg(seen.rotation.as_rotvec()).tolist()
    return {"center": (1e3 * seen.translation).tolist(), "half_extents": spot[1], "rotation_vector": vector}


def ellipsoid(initial_T):
    fields = block(initial_T)
    return {"radii": fields.pop("half_extents"), **fields}


def known(frame, initial_T):
    """One obstacle of every kind."""
    spots = {kind: (1e3 * initial_T.inv().apply(rows)).tolist() for kind, rows in SPOTS.items()}
    normal = initial_T.inv().rotation.apply(NORMAL)
    offset = -0.4 + normal @ initial_T.inv().translation
    return [
        {"frame": frame, **obstacle}
        for obstacle in (
            {"center": spots["sphere"][0], "radius": 5},
            {"type": "capsule", "from": spots["capsule"][0], "to": spots["capsule"][1], "radius": 7},
            {"type": "cylinder", "from": spots["capsule"][0], "to": spots["capsule"][1], "radius": 7},
            {"type": "ellipsoid", **ellipsoid(initial_T)},
            {"type": "cloud", "points": spots["cloud"], "radius": 3},
            {"type": "mesh", "vertices": spots["mesh"]},
            {"type": "half_space", "normal": normal.tolist(), "offset": float(1e3 * offset)},
            {"type": "box", **block(initial_T)},
        )
    ]


def tags(initial_T):
    seen = block(initial_T)
    panel = {"id": 3, "edge": 40, "center": seen["center"], "rotation_vector": seen["rotation_vector"]}
    return {"tags": {"dictionary": "tag36h11", "panels": [panel]}, "boards": [seen]}


def dots(initial_T):
    center, normal = (
        1e3 * initial_T.inv().apply([0.0, 0.1, 0.4]),
        initial_T.inv().rotation.apply([0, 0.6, -0.8]),
    )
    return {"dot_radius": 5, "dots": [{"center": center.tolist(), "normal": normal.tolist()}]}


def document(frame, target=tags):
    """The same task, everything with a place stated in one frame."""
    initial_T = INITIAL_T[frame]
    return {
        "format": "omniservo.task/1",
        "name": "framed",
        "summary": "one scene",
        "units": {"length": "mm", "angle": "deg"},
        "camera": "fe185",
        "arm": {"model": "rx60", "foot": FOOT, "flange_T_camera": pose(MOUNT)},
        "start": {"joints": JOINTS},
        "target": {"frame": frame, **target(initial_T)},
        "obstacles": [{"frame": frame, **block(initial_T)}],
        "surroundings": [{"frame": frame, **block(initial_T)}],
        "teach": {"initial_T_goal": pose(GOAL)},
        "scale": {"displacement": 100},
        "planning": {"obstacles": known(frame, initial_T)},
    }


def loaded(tmp_path, written):
    (tmp_path / "task.yaml").write_text(json.dumps(written))  # JSON is YAML
    return load_task(tmp_path / "task.yaml")


def numbers(value):
    """Every number of a section, in order."""
    if isinstance(value, dict):
        return [n for name in value for n in numbers(value[name])]
    if isinstance(value, list | tuple):
        return [n for part in value for n in numbers(part)]
    return [value] if isinstance(value, int | float) else []


@pytest.mark.parametrize("target", [tags, dots])
@pytest.mark.parametrize("frame", ["base", "goal"])
def test_one_scene_stated_in_two_frames_is_one_task(tmp_path, frame, target):
    stated = loaded(tmp_path, document("initial", target))
    other = loaded(tmp_path, document(frame, target))
    for name in ("target", "obstacles", "surroundings", "planning"):
        sections = [getattr(task, name) for task in (stated, other)]
        one, same = (
            numbers([part.model_dump() for part in (s if isinstance(s, tuple) else [s])]) for s in sections
        )
        assert len(one) > 5
        np.testing.assert_allclose(same, one, atol=1e-12)
    points = np.array([[0.0, 0.0, 0.4], [0.1, 0.2, 0.5]])
    for here, there in zip(
        *(problem_of(task, GOAL, points).obstacles for task in (stated, other)), strict=True
    ):
        np.testing.assert_allclose(there.distance(points), here.distance(points), atol=1e-12)


def test_the_base_frame_is_the_one_that_the_arm_reports_in(tmp_path):
    written = document("initial")
    written["surroundings"] = [{"center": [450, 0, 20], "half_extents": [150, 150, 20], "frame": "base"}]
    task = loaded(tmp_path, written)
    (table,) = scene_of_task(task).surroundings
    np.testing.assert_allclose(1e3 * table.world_T_box.translation, np.add(FOOT, [450, 0, 20]), atol=1e-9)
    np.testing.assert_allclose(table.world_T_box.rotation.as_matrix(), np.eye(3), atol=1e-12)


def standing(tmp_path, center):
    """A task with dots that an RX60 can work on, and a block that stands around, in the base frame."""
    written = document("initial", dots)
    written["planning"], written["obstacles"] = {}, []
    written["surroundings"] = [{"center": center, "half_extents": [60, 60, 60], "frame": "base"}]
    return loaded(tmp_path, written)


def planned(task):
    points = np.array([[x, y, 0.35 + x * y] for x in (-0.05, 0.0, 0.05) for y in (-0.04, 0.0, 0.04)])
    problem = problem_of(task, task.teach.initial_T_goal.transform, points)
    return plan_with_arm(problem, arm_setting_of(task, scene_of_task(task))).plan


def test_the_whole_arm_keeps_off_what_stands_around(tmp_path):
    arm = load_arm("rx60")
    middle = arm.base_T_flange(np.deg2rad(JOINTS)).translation / 2.0  # between the foot and the flange
    assert planned(standing(tmp_path, [-700, 0, 100])).status == "certified"
    blocked = planned(standing(tmp_path, (1e3 * middle).tolist()))
    assert blocked.status == "infeasible"
    assert "surroundings 0" in blocked.reason


def test_what_stands_around_can_be_touched_in_the_simulator(tmp_path):
    middle = load_arm("rx60").base_T_flange(np.deg2rad(JOINTS)).translation / 2.0
    scene = scene_of_task(standing(tmp_path, (1e3 * middle).tolist()))
    world = World(scene)
    touching = world.touching(world.data_at(scene.start_joints))
    assert any("surroundings 0" in pair for pair in touching)


@pytest.mark.parametrize("field", ["target", "obstacles", "surroundings", "planning.obstacles"])
def test_an_unknown_frame_is_one_message_with_what_is_legal(tmp_path, field):
    written = copy.deepcopy(document("initial"))
    section = written
    for name in field.split("."):
        section = section[name]
    (section[0] if isinstance(section, list) else section)["frame"] = "world"
    with pytest.raises(InputError) as error:
        loaded(tmp_path, written)
    message = str(error.value)
    assert re.search(
        rf"task\.yaml: {field}\S*\.?frame: .*'initial', 'base' or 'goal'; 'world' given", message
    )
