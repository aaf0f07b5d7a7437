"""Whole runs with real lenses whose model is not the unified one, rendered through that very model."""

import numpy as np
import pytest
from benchmarks.lens_conversions import PUBLISHED

from omniservo.camera_files import load_model
from omniservo.cameras.conversion import to_unified
from omniservo.runs import run_task, teach_goal
from omniservo.simulation import SimulatedCell
from omniservo.tasks import TaughtGoal, load_task
from omniservo.verification import verify_plan

PAPER, WALL = "paper-example-1", "perspective-wall"
LENSES = {
    "RealSense T265, fisheye": PAPER,
    "TUM VI at 1024 px": PAPER,
    "Kodak, OCam, 235°": PAPER,
    "RealSense, colour": WALL,
}


def run_with(lens, name):
    """A run of a shipped task with another camera, and fewer images a second, which take most of the time."""
    task = load_task(name, camera=lens)
    task = task.model_copy(update={"sensor": task.sensor.model_copy(update={"rate": 8.0})})
    return run_task(task, SimulatedCell, filmed=False)


def keeps_its_promises(result, lens):
    metrics = result.metrics
    assert (metrics["status"], metrics["plan_status"], metrics["contacts"]) == ("converged", "certified", [])
    assert metrics["final_translation_error_m"] < 0.3e-3
    assert metrics["final_rotation_error_rad"] < np.deg2rad(0.05)
    conversion = to_unified(lens)
    assert result.plan.problem.camera == conversion.camera
    assert result.notices[0] == conversion.cost
    certified = metrics["visibility_planned_px"]
    assert metrics["visibility_executed_px"] > certified - 1.0, "in the camera's own pixels"
    assert verify_plan(result.plan).status == "certified"


@pytest.mark.parametrize("name", LENSES)
def test_a_run_with_a_published_lens_is_certified_and_converges(name):
    keeps_its_promises(run_with(PUBLISHED[name], LENSES[name]), PUBLISHED[name])


def test_a_run_with_a_file_of_ocamcalib_is_certified_and_converges(shared_data):
    path = shared_data / "calibrations/ocamcalib/premnirmal_Homing-in-Scale-Space__calib_results.txt"
    result = run_with(path, PAPER)
    assert result.task.camera.to_dict()["model"] == load_model(path).to_dict()["model"] == "ocam"
    keeps_its_promises(result, result.task.camera)


def test_a_taught_goal_keeps_the_camera_as_it_is(tmp_path):
    lens = PUBLISHED["RealSense T265, fisheye"]
    task = load_task(PAPER, camera=lens)
    goal = teach_goal(task, SimulatedCell(task, 0))
    goal.save(tmp_path / "goal.json")
    assert TaughtGoal.load(tmp_path / "goal.json").camera == lens == goal.camera
