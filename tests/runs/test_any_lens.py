"""Whole runs with real lenses whose model is not the unified one, seen through that very model."""

import numpy as np
import pytest
from benchmarks.lens_conversions import PUBLISHED
from tests.runs.changed_task import DrawnCell, PlainCell, shipped, written
from tests.runs.test_looks import BOX

from omniservo.camera_files import load_model
from omniservo.cameras.conversion import to_unified
from omniservo.cameras.models import KannalaBrandt
from omniservo.runs import run_task, teach_goal
from omniservo.simulation import SimulatedCell
from omniservo.tasks import TaughtGoal, load_task
from omniservo.verification import verify_plan

PAPER, WALL = "paper-example-1", "perspective-wall"


def run_shortly(task, cell=PlainCell):
    """A short run with few images, each of one instant: they take most of the time."""
    sensor = task.sensor.model_copy(update={"rate": 3.0, "exposure": 0.0, "readout": 0.0})
    servo = task.servo.model_copy(update={"duration": 2.5})
    task = task.model_copy(update={"sensor": sensor, "servo": servo})
    return run_task(task, cell, filmed=False)


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


@pytest.mark.slow
def test_a_run_with_a_published_lens_is_certified_and_converges():
    lens = PUBLISHED["RealSense, colour"]
    keeps_its_promises(run_shortly(load_task(WALL, camera=lens)), lens)


@pytest.mark.slow
def test_a_run_with_a_file_of_ocamcalib_is_certified_and_converges(shared_data):
    path = shared_data / "calibrations/ocamcalib/premnirmal_Homing-in-Scale-Space__calib_results.txt"
    result = run_shortly(load_task(PAPER, camera=path), DrawnCell)
    assert result.task.camera.to_dict()["model"] == load_model(path).to_dict()["model"] == "ocam"
    keeps_its_promises(result, result.task.camera)


@pytest.mark.slow
def test_a_run_that_looks_again_does_so_with_the_camera_s_own_model(tmp_path):
    """As `test_looks` has it: at a risk of 1% there is no plan before the look.

    The lens has a T265's coefficients, and the image of that task's own camera.
    """
    document = shipped("whole-arm-1")
    document["obstacles"] = [BOX]
    box = {"type": "box", **BOX}
    document["planning"] |= {"obstacles": [box], "clearance": 20, "risk": 0.01}
    document["scale"] = {"displacement": 223.557, "sigma": 0.15}
    lens = KannalaBrandt(130.0, 130.0, 316.8, 254.9, 659, 432, k=PUBLISHED["RealSense T265, fisheye"].k)
    assert to_unified(lens).residual.largest_px > 1.0
    result = run_shortly(load_task(written(tmp_path, document), camera=lens), DrawnCell)
    keeps_its_promises(result, lens)
    (look,) = result.looks
    assert look.after.goal_m < 0.1 * look.before.goal_m


@pytest.mark.slow
def test_a_taught_goal_keeps_the_camera_as_it_is(tmp_path):
    lens = PUBLISHED["RealSense T265, fisheye"]
    task = load_task(PAPER, camera=lens)
    goal = teach_goal(task, SimulatedCell(task, 0))
    goal.save(tmp_path / "goal.json")
    assert TaughtGoal.load(tmp_path / "goal.json").camera == lens == goal.camera
