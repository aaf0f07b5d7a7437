"""Runs on rendered images that look again before they plan; and what a task may say about it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform
from tests.runs.changed_task import DrawnCell, PlainCell, shipped, written

from omniservo.cameras import UnifiedCamera
from omniservo.errors import InputError, NoSolutionError
from omniservo.reporting.looks import looks_section
from omniservo.reporting.run_summary import run_summary
from omniservo.runs.begun_elsewhere import begun_elsewhere
from omniservo.runs.joined_views import MOST_JOINED
from omniservo.runs.run_task import run_task
from omniservo.scenes.scene_of_task import scene_of_task
from omniservo.tasks import load_task

BOX = {"center": [-150, -34, 60], "half_extents": [60, 10, 10]}


def task_with(folder, **planning):
    """The paper's target past a box, its displacement known to 15%, at a risk of 1%."""
    document = shipped("whole-arm-1")
    document["obstacles"] = [BOX]
    document["sensor"]["rate"], document["servo"]["duration"] = 8, 2.5
    document["planning"] |= {"obstacles": [{"type": "box", **BOX}], "clearance": 20, "risk": 0.01} | planning
    document["scale"] = {"displacement": 223.557, "sigma": 0.15}
    return load_task(written(folder, document))


@pytest.mark.slow
def test_a_task_without_a_plan_at_its_risk_has_one_after_a_look(tmp_path):
    with pytest.raises(NoSolutionError, match="no path") as refused:
        run_task(task_with(tmp_path, looks=0), DrawnCell, filmed=False)
    assert "look" not in str(refused.value)
    result = run_task(task_with(tmp_path), DrawnCell, filmed=False)
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


class CoveredLens:
    """A camera whose lens is covered at so many stops of the arm away from where it stood first."""

    def __init__(self, robot, stops):
        self.robot, self.stops, self.start = robot, stops, robot.read().joint_positions
        self.covered = []
        """joints (n,) of the stops at which it was [rad]"""

    def image(self):
        image, joints = self.robot.image(), self.robot.read().joint_positions
        away = np.abs(joints - self.start).max() > 0.02
        known = any(np.abs(joints - q).max() < 1e-2 for q in self.covered)
        if image is None or not away or not (known or len(self.covered) < self.stops):
            return image
        if not known and not np.any(np.abs(self.robot.read().joint_velocities) > 1e-4):
            self.covered.append(joints)
        return replace(image, pixels=np.zeros_like(image.pixels))


class CoveredCell(DrawnCell):
    """Its camera's lens is covered at the first stop of a look."""

    opened = ()
    stops = 1

    def __init__(self, task, seed=0):
        super().__init__(task, seed)
        self.lens = CoveredLens(self.robot, self.stops)
        CoveredCell.opened += (self,)

    @property
    def camera(self):
        return self.lens

    def bring_arm_to(self, joints):
        super().bring_arm_to(joints)
        self.lens.start = joints


@pytest.mark.slow
def test_a_look_whose_image_shows_nothing_is_gone_back_from_and_another_one_taken(tmp_path):
    result = run_task(task_with(tmp_path), CoveredCell, filmed=False)
    metrics = result.metrics
    assert metrics["status"] == "converged"
    assert metrics["contacts"] == []
    failed, look = result.looks
    assert "dots" in failed.nothing
    assert (failed.gained, failed.after) == (1.0, failed.before)
    assert not look.nothing
    assert look.gained < 0.5
    assert look.after.outcome == ""
    assert (metrics["looks"], metrics["looks_for_nothing"]) == (2, 1)
    assert failed.image.max() == 0
    assert look.moved_m != failed.moved_m or look.turned_rad != failed.turned_rad
    page = looks_section(result).html
    assert "gave nothing" in page
    assert "the arm went back" in page
    assert any("1 × for nothing" in line for line in run_summary(metrics))


@pytest.mark.slow
def test_where_every_look_shows_nothing_the_arm_stands_where_it_stood_and_that_is_said(tmp_path):
    CoveredCell.opened = ()
    with pytest.raises(NoSolutionError, match=r"no path.*look 1: .*dots.*after 1 more image"):
        run_task(task_with(tmp_path, looks=1), CoveredCell, filmed=False)
    cell = CoveredCell.opened[-1]
    assert len(cell.lens.covered) == 1
    assert cell.robot.read().joint_positions == pytest.approx(cell.scene.start_joints, abs=3e-4)


@pytest.mark.slow
def test_a_start_near_a_singularity_is_left_instead_of_being_refused(tmp_path):
    document = shipped("whole-arm-1")
    document["sensor"]["rate"], document["servo"]["duration"] = 8, 2.5
    document["start"] = {"joints": [10, 20, 70, 5, 0.4, 0]}  # axes 4 and 6 are all but parallel
    document["teach"] = {"initial_T_goal": {"translation": [60, -40, 90], "rotation_vector": [5, -8, 10]}}
    document["target"]["boards"][-1]["half_extents"] = [160, 160, 10]  # none of it where the arm stands
    document["scale"], document["obstacles"] = {"odometry": True}, []
    document["planning"] |= {"obstacles": [], "looks": 0}
    with pytest.raises(NoSolutionError, match="singular"):
        run_task(load_task(written(tmp_path, document)), DrawnCell, filmed=False)
    document["planning"]["looks"] = 1
    result = run_task(load_task(written(tmp_path, document)), DrawnCell, filmed=False)
    assert "singular" in result.looks[0].before.outcome
    assert result.metrics["status"] == "converged"
    assert result.metrics["final_translation_error_m"] < 5e-4
    assert result.motion.joints.singular_values.min() > 0.02
    assert result.log.column("joints")[0] == pytest.approx(result.motion.joints.positions[0], abs=1e-3)


@pytest.mark.slow
def test_natural_features_are_joined_over_a_look_s_images_and_the_run_ends_at_its_goal(tmp_path):
    document = shipped("textured-object")
    document["sensor"]["rate"], document["servo"]["duration"] = 3, 2.5  # pictures take most of the time
    document["planning"]["visibility_margin"] = 8
    document["scale"]["sigma"] = 0.05  # so that at a risk of 1% there is no path before
    smaller = UnifiedCamera(270.0, 270.0, 223.5, 167.5, 0.0, 448, 336)  # half of the pixels
    result = run_task(load_task(written(tmp_path, document), camera=smaller), PlainCell, filmed=False)
    metrics = result.metrics
    assert (metrics["status"], metrics["contacts"]) == ("converged", [])
    assert metrics["final_translation_error_m"] < 5e-4
    (look,) = result.looks
    assert "no path" in look.before.outcome
    assert look.after.outcome == ""
    assert look.after.goal_m < 0.3 * look.before.goal_m
    assert look.gained == pytest.approx(look.expected, rel=0.5)
    assert 0.7 * MOST_JOINED < result.estimate.inliers.sum() <= MOST_JOINED < len(result.seen.matched)
    off = result.estimate.initial_T_goal.translation - result.truth.initial_T_goal[:3, 3]
    assert off @ np.linalg.solve(result.estimate.covariance[:3, :3], off) < 25.0


@pytest.mark.slow
def test_where_no_look_helps_it_says_what_would_have_to_be_better(tmp_path):
    task = task_with(tmp_path, clearance=20, risk=0.01, looks=1, visibility_margin=150)
    with pytest.raises(NoSolutionError, match=r"(better|exactly)"):
        run_task(task, DrawnCell, filmed=False)


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
