"""Where the estimate improves on the way, the camera goes on if clearance and image limits can be kept."""

import pytest

from omniservo.studies import load_study, run_row


@pytest.mark.slow
@pytest.mark.parametrize(
    ("study", "row", "what"),
    [
        ("quick", 208, "the goal is nearer to a ball than the plan keeps at its risk"),
        ("paper-benchmark", 864, "the way is nearer to the image's limit than the plan keeps"),
    ],
)
def test_what_a_plan_keeps_besides_stops_no_camera_on_its_way(study, row, what):
    found = run_row(load_study(study), row).row
    assert (found.method, found.arm) == ("certified", "none")
    assert found.status == "converged", what
    assert found.success
    assert not found.collision


@pytest.mark.slow
def test_a_scene_s_methods_follow_each_a_plan_of_its_own_planner():
    study = load_study("quick")
    certified, paper = (run_row(study, number).row for number in (160, 161))
    assert (certified.method, paper.method, paper.scene) == ("certified", "paper", certified.scene)
    assert (certified.status, certified.collision) == ("converged", False)
    assert (paper.status, paper.collision) == ("converged", True)
