"""Runs of a whole arm among what a depth camera saw."""

import numpy as np
import pytest
from changed_task import DrawnCell, shipped, written

from omniservo.errors import NoSolutionError
from omniservo.reporting.path_3d import path_3d
from omniservo.runs import run_task
from omniservo.tasks import load_task

MIDDLE, HALF = np.array([-191.0, -34.0, -55.0]), np.array([150.0, 10.0, 10.0])
"""The box of whole-arm-1 [mm]."""


def seen(count, shift=(0.0, 0.0, 0.0)):
    """Points on the box and on the wall behind the target [mm]."""
    random = np.random.default_rng(0)
    box = random.uniform(-1.0, 1.0, (count // 2, 3))
    side = random.choice(3, len(box), p=[1 / 31, 15 / 31, 15 / 31])
    box[np.arange(len(box)), side] = np.sign(box[np.arange(len(box)), side])
    wall = random.uniform([-900, -780, 539.5], [900, 620, 540.5], (count - len(box), 3))
    return np.vstack([MIDDLE + box * HALF + shift, wall])


def cloud_task(folder, points):
    """whole-arm-1 for a planner that knows a cloud of the box and of the wall."""
    np.save(folder / "seen.npy", points)
    document = shipped("whole-arm-1")
    document["planning"]["obstacles"] = [{"type": "cloud", "file": "seen.npy", "radius": 1}]
    document["planning"]["arm_clearance"] = 1
    document["sensor"]["rate"] = 12
    return written(folder, document)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return run_task(
        load_task(cloud_task(tmp_path_factory.mktemp("cloud"), seen(20_000))), DrawnCell, filmed=False
    )


@pytest.mark.slow
def test_a_run_among_a_cloud_keeps_every_link_off_what_the_cloud_was_seen_of(run):
    metrics = run.metrics
    assert (metrics["status"], metrics["contacts"]) == ("converged", [])
    assert metrics["arm_clearance_proof"] == "clear"
    assert metrics["link_clearance_planned_m"] >= 0.004 - 1e-6
    assert metrics["link_clearance_executed_m"] >= 0.001
    assert metrics["arm_clearance_executed_m"] >= metrics["link_clearance_executed_m"]
    (cloud,) = (section.obstacle for section in run.task.planning.obstacles)
    positions = np.array([row.true_position for row in run.log.rows])
    nearest = np.linalg.norm(positions[:, None] - cloud.points, axis=2).min()
    assert metrics["clearance_executed_m"] == pytest.approx(nearest - 0.001, abs=1e-9)


@pytest.mark.slow
def test_a_cloud_is_drawn_as_some_of_its_points_and_has_one_name_in_all_that_is_told(run):
    drawing = path_3d(run)
    assert "Dots: points of clouds" in drawing.caption
    for axes in drawing.figure.axes:
        dots = [line for line in axes.lines if line.get_label() == "points of a cloud"]
        assert sum(len(line.get_xdata()) for line in dots) <= 2000
        assert len(axes.collections) + len(axes.lines) + len(axes.patches) < 150
    assert set(run.whole_arm.executed) == {
        "shoulder", "upper_arm", "elbow", "forearm", "wrist", "flange", "camera",
    }  # fmt: skip


def test_a_task_whose_cloud_touches_the_arm_at_the_start_is_refused_by_the_clouds_name(tmp_path):
    path = cloud_task(tmp_path, seen(2000, shift=(60.0, 0.0, 0.0)))
    with pytest.raises(NoSolutionError, match="the start pose is not free: camera and obstacle 0 overlap"):
        run_task(load_task(path), DrawnCell, filmed=False)
