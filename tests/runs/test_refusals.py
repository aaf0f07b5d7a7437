"""What a run cannot do is said in one message: exit code 2 for a wrong task, 1 for a computed no."""

import copy
import re
from dataclasses import replace

import numpy as np
import pytest
from changed_task import shipped, written
from PIL import Image

from omniservo.cameras import preset
from omniservo.cli.main import main
from omniservo.errors import InputError, NoSolutionError
from omniservo.runs import run_task, teach_goal
from omniservo.simulation import SimulatedCell
from omniservo.tasks import TaughtGoal, load_task


@pytest.fixture
def document():
    return copy.deepcopy(shipped("paper-example-1"))


def taught(task):
    """The task's goal, taught in the simulator."""
    return teach_goal(task, SimulatedCell(task))


def refusal(capsys, folder, document):
    """Exit code and message of ``run``; the folder of results must not appear."""
    results = folder / "results"
    with pytest.raises(SystemExit) as end:
        main(["run", str(written(folder, document)), "--out", str(results), "--quiet"])
    captured = capsys.readouterr()
    assert captured.out == ""
    assert not results.exists()
    assert len(captured.err.splitlines()) == 1
    return end.value.code, captured.err


def test_an_arm_that_something_pushes_at_the_goal_is_a_wrong_task_that_names_it(tmp_path, document):
    elbow = {"center": [300, -50, 450], "half_extents": [50, 50, 50], "frame": "base"}
    document["surroundings"] = [*document.get("surroundings", []), elbow]
    with pytest.raises(InputError, match="while it was taken: .*surroundings.* touch; legal: an arm that"):
        taught(load_task(written(tmp_path, document)))


def test_a_target_of_seven_dots_is_a_wrong_task(capsys, tmp_path, document):
    document["target"]["dots"] = document["target"]["dots"][:7]
    code, message = refusal(capsys, tmp_path, document)
    assert code == 2
    assert "7 of the target's 7 dots lie wholly in the initial image" in message
    assert "at least 8" in message


def test_nine_dots_on_one_board_are_refused_as_planar(capsys, tmp_path, document):
    for dot in document["target"]["dots"]:
        dot["center"][2], dot["normal"] = 380, [0, 0, -1]
    document["target"]["boards"] = [{"center": [0, -80, 386], "half_extents": [140, 140, 4]}]
    code, message = refusal(capsys, tmp_path, document)
    assert code == 1
    assert "planar" in message


def test_a_goal_that_looks_past_the_target_is_a_wrong_task(capsys, tmp_path, document):
    document["teach"]["initial_T_goal"]["rotation_vector"] = [0, 150, 0]
    code, message = refusal(capsys, tmp_path, document)
    assert code == 2
    assert "0 of the target's 9 dots lie wholly in the goal image" in message


def test_dots_outside_the_field_are_counted(capsys, tmp_path, document):
    for dot in document["target"]["dots"][:2]:
        dot["center"][0] -= 30_000
        dot["center"][2] = -9_000
    code, message = refusal(capsys, tmp_path, document)
    assert code == 2
    assert "7 of the target's 9 dots lie wholly in the initial image" in message


def test_a_dot_cut_by_the_border_is_not_in_view(document, tmp_path):
    task = load_task("paper-example-1", camera="perspective")
    low, high = 0.0, 3.0
    for _ in range(40):  # how far aside a dot's centre may be to be just inside the image
        middle = 0.5 * (low + high)
        pixel, valid = task.camera.project(np.array([middle, 0.0, 0.4]))
        low, high = (middle, high) if valid and task.camera.in_image(pixel) else (low, middle)
    for dot, aside in zip(document["target"]["dots"][:2], (1e3 * low, 1e3 * low - 5.0), strict=True):
        dot["center"] = [aside, 0, 400]
        dot["normal"] = [0, 0, -1]
    document["camera"] = "perspective"
    with pytest.raises(InputError, match="7 of the target's 9 dots"):
        run_task(load_task(written(tmp_path, document)), SimulatedCell)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("place", "pose"), [([0, 0, 0], "start"), ([0.0497, -99.9782, 199.9552], "goal")], ids=["start", "goal"]
)
def test_an_obstacle_at_an_end_of_the_path_is_infeasible_and_named(capsys, tmp_path, document, place, pose):
    document["planning"]["obstacles"].append({"center": place, "radius": 10})
    code, message = refusal(capsys, tmp_path, document)
    assert code == 1
    assert "infeasible" in message
    assert f"the {pose} pose" in message
    assert "obstacle 2" in message


def test_a_block_in_front_of_the_target_leaves_too_few_dots(capsys, tmp_path, document):
    document["obstacles"].append({"center": [0, -60, 250], "half_extents": [60, 60, 5]})
    code, message = refusal(capsys, tmp_path, document)
    assert code == 2
    assert re.search(r"[0-7] of the target's 9 dots can be seen in the goal image; at least 8", message)
    assert "hidden by obstacle 1" in message


def test_a_block_before_the_camera_at_the_start_only_is_named(capsys, tmp_path, document):
    document["obstacles"].append({"center": [0, 20, 60], "half_extents": [80, 80, 2]})
    document["teach"]["initial_T_goal"]["translation"] = [0, -110, 120]
    code, message = refusal(capsys, tmp_path, document)
    assert code == 2
    assert "0 of the target's 9 dots can be seen in the initial image" in message
    assert "hidden by obstacle 1" in message


def test_a_target_below_the_floor_is_hidden_by_it(tmp_path):
    document = copy.deepcopy(shipped("ur5e-table"))
    document["target"]["boards"] = []
    for dot in document["target"]["dots"]:
        dot["center"][2] += 120  # the floor is 430 mm ahead
    with pytest.raises(InputError, match="0 of the .* can be seen in the goal image; .*; hidden by floor$"):
        taught(load_task(written(tmp_path, document)))


def test_a_tag_is_hidden_where_half_of_it_is(tmp_path):
    document = copy.deepcopy(shipped("panda-table"))
    panels = document["target"]["tags"]["panels"] = document["target"]["tags"]["panels"][:1]
    x, y, z = panels[0]["center"]
    half = 0.25 * panels[0]["edge"]
    document["obstacles"].append({"center": [x + 2 * half, y, z - 10], "half_extents": [half, 4 * half, 1]})
    with pytest.raises(InputError, match="0 of the target's 1 tags can be seen .* hidden by obstacle 1"):
        taught(load_task(written(tmp_path, document)))


@pytest.mark.slow
def test_one_tag_of_known_size_is_enough_to_teach(tmp_path):
    document = copy.deepcopy(shipped("panda-table"))
    document["target"]["tags"]["panels"] = document["target"]["tags"]["panels"][:1]
    assert taught(load_task(written(tmp_path, document))).features.shape == (4, 2)
    document["scale"] = {"odometry": True}
    with pytest.raises(
        InputError, match="4 tag corners found; at least 8|1 of the target's 1 tags .* at least 2"
    ):
        taught(load_task(written(tmp_path, document)))


def test_a_goal_file_without_dots_is_refused():
    task = load_task("paper-example-1")
    empty = np.full((task.camera.height, task.camera.width), 180, dtype=np.uint8)
    goal = TaughtGoal(task.camera, empty, np.zeros((0, 2)), None)
    with pytest.raises(InputError, match="the goal image: 0 dots found; at least 8 .*state target.tags"):
        run_task(task, SimulatedCell, goal=goal)


def test_a_goal_taught_with_another_camera_is_refused():
    goal = taught(load_task("paper-example-1"))
    with pytest.raises(InputError, match="taught with another camera"):
        run_task(load_task("paper-example-1", camera="perspective"), SimulatedCell, goal=goal)


def test_a_goal_taught_with_an_arm_of_other_joints_is_refused():
    goal = TaughtGoal(preset("fe185"), np.zeros((494, 659), np.uint8), np.zeros((9, 2)), np.zeros(7))
    task = load_task("paper-example-1")
    with pytest.raises(InputError, match="taught with 7 joints; the task's arm has 6; teach it again"):
        run_task(task, SimulatedCell, goal=replace(goal, camera=task.camera))


def test_a_goal_picture_of_another_target_is_not_matched(tmp_path, document):
    rng = np.random.default_rng(5)
    for dot in document["target"]["dots"]:
        dot["center"] = [*rng.uniform(-90, 90, 2), 380 + rng.uniform(-20, 20)]
        dot["normal"] = [0, 0, -1]
    document["target"]["dot_radius"] = 6
    document["target"]["boards"] = [{"center": [0, -80, 550], "half_extents": [900, 700, 10]}]
    goal = taught(load_task(written(tmp_path, document)))
    with pytest.raises(InputError, match=r"taught of another target: distances .*; teach it again"):
        run_task(load_task("paper-example-1"), SimulatedCell, goal=goal)
    with pytest.raises(NoSolutionError, match="cannot be matched"):
        run_task(load_task("paper-example-1"), SimulatedCell, goal=replace(goal, target=None))


def test_a_start_out_of_reach_names_its_field(capsys, tmp_path, document):
    document["start"]["world_T_camera"]["translation"] = [2000, 0, 500]
    code, message = refusal(capsys, tmp_path, document)
    assert code == 2
    assert "start.world_T_camera" in message


def test_a_camera_file_that_is_none_is_refused(capsys, tmp_path):
    path = tmp_path / "camera.yaml"
    path.write_text("just: words\n")
    with pytest.raises(SystemExit) as end:
        main(["run", "paper-example-1", "--camera", str(path), "--out", str(tmp_path / "results"), "--quiet"])
    assert end.value.code == 2
    assert "camera.yaml" in capsys.readouterr().err


def test_a_task_that_is_refused_at_planning_is_drawn_beside_its_folder(capsys, tmp_path, document):
    document["planning"]["obstacles"].append({"center": [0, 0, 0], "radius": 10})
    code, message = refusal(capsys, tmp_path, document)
    assert code == 1
    drawn = tmp_path / "results-refused.png"
    assert message.endswith(f"; drawn: {drawn}\n")
    picture = np.asarray(Image.open(drawn).convert("RGB")).astype(int)
    red = (picture[..., 0] > 150) & (picture[..., 1] < 60) & (picture[..., 2] < 80)
    assert red.sum() > 50  # what keeps too little is marked


def test_an_arm_that_stands_where_the_goal_was_taught_is_told_so(tmp_path, document):
    document["scale"] = {"odometry": True}
    task = load_task(written(tmp_path, document))
    goal = replace(taught(task), joints=SimulatedCell(task).scene.start_joints)
    with pytest.raises(InputError, match="0 mm from where the goal was taught: it stands there already"):
        run_task(task, SimulatedCell, goal=goal)
