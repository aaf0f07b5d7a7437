"""Every script in examples/ runs by itself, and prints what it is there to show."""

import contextlib
import io
import json
import re
import runpy
from pathlib import Path

import pytest

FOLDER = Path(__file__).resolve().parents[2] / "examples"
SCRIPTS = sorted(FOLDER.glob("*.py"))
MOST_LINES = 60


def run(name, folder):
    """Return what the script prints; it starts in an empty folder, and pytest lets no warning pass."""
    out, err = io.StringIO(), io.StringIO()
    with pytest.MonkeyPatch.context() as patch, contextlib.chdir(folder):
        patch.syspath_prepend(str(FOLDER))  # where Python itself would have it
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            runpy.run_path(str(FOLDER / f"{name}.py"), run_name="__main__")
    assert err.getvalue() == ""
    return out.getvalue()


def numbers(pattern, text):
    """Return the numbers that a line gives, after the words that say what they are."""
    found = re.search(pattern.replace("#", r"(-?[\d.]+)"), text)
    assert found, f"{pattern!r} not in:\n{text}"
    return [float(group) for group in found.groups()]


def test_plan_path_goes_round_a_post_that_stands_in_the_straight_way(tmp_path):
    text = run("plan_path", tmp_path)
    assert text.startswith("certified")
    for body, straight_on in (("shelf", True), ("post", False), ("wedge", True)):
        straight, planned = numbers(rf"{body}: straight on # mm, planned # mm", text)
        assert planned >= 50.0
        assert (straight >= 50.0) == straight_on
    assert numbers("stay # px inside", text)[0] >= 10.0
    assert re.search(r"w = 1.0: camera at \[250. +0. 150.\] mm", text)


def test_verify_plan_refuses_what_is_falsified_and_says_why(tmp_path):
    honest, claimed, bent, meant = run("verify_plan", tmp_path).splitlines()
    held, stated = numbers("certified, # of # stated margins hold", honest)
    assert held == stated > 0
    assert re.match(
        r"5 mm more claimed: refuted: clearance obstacle 0: .* m left .* 0\.005\d* m needed", claimed
    )
    assert bent.startswith("bent by 5 mm: refuted: path end (w = 1): 0.005 m")
    assert "another problem meant: refuted: problem" in meant
    assert "clearance: 0.05 in the plan, 0.06 was meant" in meant


def test_two_lenses_keep_the_margins_that_their_end_poses_leave(tmp_path):
    text = run("two_lenses", tmp_path)
    for lens in ("perspective", "fisheye"):
        for margin in (0, 80, 120):
            assert numbers(rf"{lens}, {margin} px asked: certified, # px kept", text)[0] >= margin
        assert f"{lens}, 160 px asked: infeasible, the start pose" in text
    assert numbers("fisheye, 0 px asked: certified, # px", text) > numbers(
        "perspective, 0 .*certified, # px", text
    )


@pytest.mark.slow
def test_plan_at_risk_pays_in_clearance_for_what_the_plain_plan_risks(tmp_path):
    text = run("plan_at_risk", tmp_path)
    assert "estimate: ok" in text
    assert numbers("at 1% risk: certified, # mm planned, 40 asked", text)[0] > 45.0
    predicted, bound = numbers("violated by #% of samples, 95% bound #%", text)
    assert predicted <= bound <= 1.0
    assert numbers("taken as exact: certified, # mm planned\n  violated by #% of samples", text)[1] > 10.0


@pytest.mark.slow
def test_estimate_from_images_finds_the_motion_between_two_files(tmp_path):
    text = run("estimate_from_images", tmp_path)
    agree, matches = numbers("ok : # of # matches agree", text)
    assert 0.9 * matches <= agree
    assert agree > 100
    millimetres, nearest, farthest = numbers("off by # mm; points from # to # m ahead", text)
    assert millimetres < 0.2
    assert 0.3 < nearest < 0.4 < 0.55 < farthest < 0.65
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"initial.png", "goal.png"}


@pytest.mark.slow
def test_estimate_from_several_files_finds_every_motion_within_what_it_states(tmp_path):
    text = run("estimate_from_several_files", tmp_path)
    assert "ok, 4 of 4 views" in text
    for view in (1, 2, 3):
        off, sigma = numbers(f"view-{view}.png: off by # mm, sigma # mm", text)
        assert off <= 3.0 * sigma + 0.01
        assert sigma < 0.2
    assert "one more image, at best: FurtherView" in text


@pytest.mark.slow
def test_calibrate_camera_finds_the_lens_that_took_the_pictures(tmp_path):
    text = run("calibrate_camera", tmp_path)
    assert "ok: 8 of 8 images" in text
    for name in ("fx", "fy", "cx", "cy", "xi"):
        value, sigma, true = numbers(rf"{name}: # ± #, true #", text)
        assert abs(value - true) <= 4.0 * sigma + 0.001
        assert sigma < 0.005 * true
    assert numbers("right to # px", text)[0] < 0.5
    assert (tmp_path / "out" / "camera.yaml").exists()


@pytest.mark.slow
def test_calibrate_hand_eye_finds_the_mount_and_says_which_view_is_none(tmp_path):
    text = run("calibrate_hand_eye", tmp_path)
    assert numbers("ok : # of 10 views used", text)[0] >= 7
    assert "not view" in text
    assert numbers("off by # mm", text)[0] < 1.0
    assert (tmp_path / "out" / "hand-eye.json").exists()


@pytest.mark.slow
def test_render_scene_sees_more_through_wider_lenses(tmp_path):
    text = run("render_scene", tmp_path)
    angles = [
        numbers(rf"{name}: #% of .*; \w+ is nearest, # mm; things up to # deg", text)[2]
        for name in ("perspective", "fe185", "hyper-catadioptric")
    ]
    assert angles[0] < 50.0 < 85.0 < angles[1]
    assert angles[2] > 85.0
    assert len(list((tmp_path / "out").glob("*.png"))) == 3


def test_load_arm_reads_kinematics_limits_and_bodies(tmp_path):
    text = run("load_arm", tmp_path)
    assert "Arm(made-up, 6 joints, flange turn_link, reaches 0.7 m)" in text
    assert "pan: -166 … 166 deg, 115 deg/s" in text
    # by hand: 300 mm up, then 300 at 40 degrees from upright, 300 at 110, 100 at 160, all turned by 10
    assert "flange at [501.2  88.4 333.2] mm" in text
    assert numbers("mm; # postures reach it", text)[0] >= 2
    assert "pan_link to the table: 67 mm" in text  # 60 mm beside it, 30 mm above


def test_plan_whole_arm_proves_every_link_and_refuses_what_the_forearm_would_touch(tmp_path):
    text = run("plan_whole_arm", tmp_path)
    assert numbers("certified, camera # mm from the post", text)[0] >= 30.0
    assert numbers("links clear: .*at least # mm beyond the 10 mm asked", text)[0] >= 0.0
    assert re.search(r"w = 0.0: joints \[ *0. +20. 110. +0. +50. +0.\] deg", text)
    assert re.search(
        r"crate behind the goal: infeasible: the goal pose .* forearm and obstacle 1 overlap", text
    )


def test_follow_path_ends_on_the_goal_image(tmp_path):
    text = run("follow_path", tmp_path)
    assert "done: True" in text
    millimetres, degrees, nearest = numbers("# mm and # deg from the goal, never nearer than # mm", text)
    assert millimetres < 0.5
    assert degrees < 0.1
    assert nearest > 49.5


def test_replan_takes_other_ways_and_never_comes_nearer_than_asked(tmp_path):
    text = run("replan", tmp_path)
    assert text.count("another way") >= 1
    assert "done: True" in text
    assert numbers("# mm from the goal", text)[0] < 0.5
    assert numbers("never nearer to the ball than # mm; 30 mm were asked", text)[0] >= 30.0


@pytest.mark.slow
def test_closed_loop_reaches_the_goal_and_touches_nothing(tmp_path):
    text = run("closed_loop", tmp_path)
    assert "estimate: ok, 9 dots" in text
    assert numbers("plan: certified, # mm kept", text)[0] >= 60.0
    assert "servo: done" in text
    assert numbers("# mm from the goal, contacts: none", text)[0] < 0.3
    assert numbers("never nearer than # mm; 60 mm were asked", text)[0] > 59.0


def test_own_feature_is_matched_estimated_from_and_followed(tmp_path):
    text = run("own_feature", tmp_path)
    assert numbers("9 marks of the grid: estimate ok, # mm off", text)[0] < 3.0
    assert numbers("9 found near predictions, # px off", text)[0] < 0.1


def test_own_method_reaches_the_goal_later_than_the_one_that_turns_and_moves_at_once(tmp_path):
    first, at_once = run("own_method", tmp_path).splitlines()
    for line in (first, at_once):
        assert numbers("# mm and .* deg from the goal", line)[0] < 1.0
    assert numbers("turn first: # s", first)[0] > numbers("pbvs: # s", at_once)[0] + 2.0


@pytest.mark.slow
def test_a_wrong_depth_reaches_as_many_goals_as_the_true_one_but_later(tmp_path):
    pbvs, wrong = run("wrong_depth", tmp_path).splitlines()
    assert wrong.startswith("wrong_depth.WrongDepth: ")
    reached, of, seconds = numbers("# of # reach the goal, after # s", pbvs)
    assert of == 8
    assert numbers("# of 8 reach", wrong) == [reached]
    assert numbers("after # s", wrong)[0] > seconds + 0.5


@pytest.mark.slow
def test_own_robot_is_driven_to_the_goal(tmp_path):
    text = run("own_robot", tmp_path)
    assert numbers("servo done, # mm from the goal", text)[0] < 0.3


def test_own_driver_moves_an_arm_by_name_that_stops_in_silence(tmp_path):
    text = run("own_driver", tmp_path)
    assert numbers("^turn turned by # rad, and stopped when commands ended$", text)[0] >= 0.05


def test_own_controller_shows_its_protocol(tmp_path):
    said = json.loads(run("own_controller", tmp_path))
    assert (
        said["q"] == said["qd"] == dict.fromkeys(("base", "shoulder", "elbow", "roll", "bend", "turn"), 0.0)
    )


def test_every_script_is_listed_and_tested_and_fits_a_screen():
    listed = re.findall(r"^\| .+ \| \[(\w+\.py)\]\((\w+\.py)\) \|$", (FOLDER / "README.md").read_text(), re.M)
    assert all(shown == leads_to for shown, leads_to in listed)
    assert sorted(shown for shown, _ in listed) == [script.name for script in SCRIPTS]
    run_here = re.findall(r'run\("(\w+)", tmp_path\)', Path(__file__).read_text())
    assert sorted(run_here) == [script.stem for script in SCRIPTS]


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.name)
def test_a_script_is_short_and_says_what_it_is_for(script):
    text = script.read_text()
    assert 20 <= text.count("\n") <= MOST_LINES
    assert text.startswith('"""')
    assert "Prints" in text.split('"""')[1]


def public_names(module):
    """Return what a room's `__all__` has, or, of a single file, its classes and functions."""
    path = (FOLDER.parent / "src").joinpath(*module.split("."))
    if path.is_dir():
        return set(
            re.findall(r'"(\w+)"', (path / "__init__.py").read_text().split("__all__ =")[1].split("]")[0])
        )
    return set(re.findall(r"^(?:class|def) ([a-zA-Z]\w*)", path.with_suffix(".py").read_text(), re.M))


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.name)
def test_a_script_uses_public_names_alone(script):
    for module, names in re.findall(r"^from (omniservo[\w.]*) import (.+)$", script.read_text(), re.M):
        assert set(names.split(", ")) <= public_names(module), f"{module}: {names}"
