"""The paper's first example from pixels to the goal, against the simulator's truth."""

import numpy as np
import pytest
from tests.runs.changed_task import PlainCell

from omniservo.runs import estimate_in_cell, run_task
from omniservo.simulation import SimulatedCell
from omniservo.tasks import load_task

TRUE_TRANSLATION = np.array([0.0497, -99.9782, 199.9552]) * 1e-3


@pytest.fixture(scope="module")
def certified():
    return run_task(slower("paper-example-1", 6.0), PlainCell, method="certified", filmed=False)


def slower(name, rate):
    """A shipped task with fewer images a second, each of one instant: they take most of the time."""
    task = load_task(name)
    sensor = task.sensor.model_copy(update={"rate": rate, "exposure": 0.0, "readout": 0.0})
    return task.model_copy(update={"sensor": sensor})


@pytest.mark.slow
def test_the_certified_run_reaches_the_goal_without_touching_anything(certified):
    metrics = certified.metrics
    assert (metrics["status"], metrics["contacts"]) == ("converged", [])
    assert metrics["final_translation_error_m"] <= 0.3e-3
    assert metrics["final_rotation_error_rad"] <= np.deg2rad(0.05)
    assert metrics["final_error_px"] <= 0.1


def test_the_certified_run_keeps_its_promises(certified):
    metrics = certified.metrics
    assert metrics["clearance_planned_m"] >= 0.065 - 1e-9
    assert metrics["clearance_executed_m"] >= 0.055
    assert metrics["arm_clearance_executed_m"] >= 0.005
    assert metrics["visibility_planned_px"] > 0
    assert metrics["visibility_executed_px"] > 0
    assert metrics["lost_points"] == 0
    assert metrics["path_deviation_m"] <= 0.001


def test_the_visibility_filter_leaves_a_good_plan_alone(certified):
    assert certified.metrics["filtered_frames"] == 0
    assert not certified.log.column("filter_change").any()
    assert certified.log.column("held_back")[1:].sum() == 0  # the first command has no time to be reached in


def test_the_log_agrees_with_the_metrics(certified):
    rows = certified.log.rows
    obstacles = np.array([[-10, -65, 85], [-5, -80, 90]]) * 1e-3
    positions = np.array([row.true_position for row in rows])
    nearest = np.linalg.norm(positions[:, None] - obstacles, axis=2).min()
    assert certified.metrics["clearance_executed_m"] == pytest.approx(nearest, abs=1e-12)
    assert np.linalg.norm(positions[-1] - TRUE_TRANSLATION) <= 0.3e-3
    assert certified.metrics["frames"] == len(rows)


def test_classical_servoing_touches_the_box():
    metrics = run_task(slower("paper-example-1", 6.0), PlainCell, method="ibvs", filmed=False).metrics
    assert metrics["status"] == "contact"
    assert any("obstacle 0" in pair for pair in metrics["contacts"])
    assert metrics["planning_seconds"] is None


@pytest.mark.slow
def test_a_distorted_calibration_of_a_real_lens_estimates_the_same_motion(shared_data):
    camera = shared_data / "calibrations" / "mei_yaml" / "KITTI-360__image_02.yaml"
    estimate = estimate_in_cell("paper-example-1", SimulatedCell, camera=str(camera)).estimate
    assert estimate.status == "ok"
    assert estimate.initial_T_goal.translation == pytest.approx(TRUE_TRANSLATION, abs=0.5e-3)
