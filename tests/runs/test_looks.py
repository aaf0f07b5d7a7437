"""Runs on rendered images that look again before they plan; and what a task may say about it."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform
from tests.runs.changed_task import PlainCell, shipped, written

from omniservo.errors import InputError, NoSolutionError
from omniservo.reporting.looks import looks_section
from omniservo.runs.begun_elsewhere import begun_elsewhere
from omniservo.runs.run_task import run_task
from omniservo.scenes.scene_of_task import scene_of_task
from omniservo.tasks import load_task

BOX = {"center": [-150, -34, 60], "half_extents": [60, 10, 10]}


def task_with(folder, **planning):
    """The paper's target past a box, its displacement known to 15%, at a risk of 1%."""
    document = shipped("whole-arm-1")
    document["obstacles"] = [BOX]
    document["sensor"]["rate"] = 8  # images take most of the time
    document["planning"] |= {"obstacles": [{"type": "box", **BOX}], "clearance": 20, "risk": 0.01} | planning
    document["scale"] = {"displacement": 223.557, "sigma": 0.15}
    return load_task(written(folder, document))


def test_a_task_without_a_plan_at_its_risk_has_one_after_a_look(tmp_path):
    with pytest.raises(NoSolutionError, match="no path") as refused:
        run_task(task_with(tmp_path, looks=0), PlainCell, filmed=False)
    assert "look" not in str(refused.value)
    result = run_task(task_with(tmp_path), PlainCell, filmed=False)
    metrics = result.metrics
    assert metrics["status"] == "converged"
    assert metrics["final_translation_error_m"] < 5e-4
    assert metrics["contacts"] == []
    assert metrics["clearance_executed_m"] > metrics["clearance_asked_m"]
    assert result.risk.ok
    (look,) = result.looks
    assert metrics["looks"] == 1
    assert look.leads_to_plan
    assert look.before.outcome
    assert look.after.outcome == ""
    assert look.after.goal_m < 0.1 * look.before.goal_m
    assert look.gained == pytest.approx(look.expected, rel=0.5)
    goal_error = RigidTransform.from_matrix(result.truth.initial_T_goal).translation
    off = result.estimate.initial_T_goal.translation - goal_error
    assert off @ np.linalg.solve(result.estimate.covariance[:3, :3], off) < 25.0
    page = looks_section(result).html
    assert "look 1" in page
    assert "→" in page
    assert page.count("<img") == 1


def test_a_start_near_a_singularity_is_left_instead_of_being_refused(tmp_path):
    document = shipped("whole-arm-1")
    document["sensor"]["rate"] = 8
    document["start"] = {"joints": [10, 20, 70, 5, 0.4, 0]}  # axes 4 and 6 are all but parallel
    document["teach"] = {"initial_T_goal": {"translation": [60, -40, 90], "rotation_vector": [5, -8, 10]}}
    document["target"]["boards"][-1]["half_extents"] = [160, 160, 10]  # none of it where the arm stands
    document["scale"], document["obstacles"] = {"odometry": True}, []
    document["planning"] |= {"obstacles": [], "looks": 0}
    with pytest.raises(NoSolutionError, match="singular"):
        run_task(load_task(written(tmp_path, document)), PlainCell, filmed=False)
    document["planning"]["looks"] = 1
    result = run_task(load_task(written(tmp_path, document)), PlainCell, filmed=False)
    assert "singular" in result.looks[0].before.outcome
    assert result.metrics["status"] == "converged"
    assert result.metrics["final_translation_error_m"] < 5e-4
    assert result.motion.joints.singular_values.min() > 0.02
    assert result.log.column("joints")[0] == pytest.approx(result.motion.joints.positions[0], abs=1e-3)


def test_where_no_look_helps_it_says_what_would_have_to_be_better(tmp_path):
    task = task_with(tmp_path, clearance=20, risk=0.01, looks=1, visibility_margin=150)
    with pytest.raises(NoSolutionError, match=r"(better|exactly)"):
        run_task(task, PlainCell, filmed=False)


@pytest.mark.parametrize("looks", [-1, 11, 1.5, "two", True])
def test_a_number_of_looks_that_is_not_legal_is_refused_by_name(tmp_path, looks):
    with pytest.raises(InputError, match=r"planning\.looks"):
        task_with(tmp_path, looks=looks)


def test_a_task_that_begins_elsewhere_has_everything_where_it_was_in_the_world(tmp_path):
    task = task_with(tmp_path, workspace={"min": [-300, -300, -300], "max": [300, 300, 300]})
    scene = scene_of_task(task)
    joints = scene.start_joints + np.array([0.1, -0.05, 0.08, 0.02, -0.1, 0.2])
    begun, there = begun_elsewhere(task, scene, joints, 0.002)
    before, now = (t.start.world_T_camera.transform for t in (task, begun))
    assert now.as_matrix() == pytest.approx(scene.world_T_camera(joints).as_matrix())
    assert there.start_joints == pytest.approx(joints)
    for places in (
        lambda t: np.array([dot.center for dot in t.target.dots]),
        lambda t: np.array([t.planning.obstacles[0].center, t.obstacles[0].center]),
        lambda t: t.teach.initial_T_goal.transform.translation[None],
    ):
        assert now.apply(places(begun)) == pytest.approx(before.apply(places(task)), abs=1e-9)
    assert begun.planning.tracking_margin == pytest.approx(task.planning.tracking_margin + 0.002)
    workspace = begun.planning.workspace.workspace
    inside = now.inv().apply(before.apply([[0.29, -0.29, 0.29], [0.31, 0.0, 0.0]]))
    kept = [min(np.array(s.normal) @ x - s.offset for s in workspace.half_spaces) for x in inside]
    assert kept == pytest.approx([0.01, -0.01])
    low, high = begun.planning.workspace.bounds
    assert (low < -0.3).all()
    assert (high > 0.3).all()
