"""Half-spaces of the workspace: the camera centre stays on their free side, without clearance."""

import re

import numpy as np
import pytest

from omniservo.cameras import preset
from omniservo.errors import InputError
from omniservo.planning import CameraPath, HalfSpace, Plan, PlanningProblem, Workspace, certify, plan_path
from omniservo.verification import verify_plan

FINE = np.linspace(0.0, 1.0, 5001)
FLOOR = {"normal": [0.0, 0.6, 0.8], "offset": -0.05}


def problem(**changes: object) -> PlanningProblem:
    fields = {
        "format": "omniservo.problem/1",
        "camera": preset("fe185").to_dict(),
        "points": [[0.0, 0.0, 0.6]],
        "goal": {"translation": [0.2, 0.0, 0.1], "quaternion": [0.0, 0.0, 0.0, 1.0]},
    }
    return PlanningProblem.from_dict(fields | changes)


def bent(dip: float) -> CameraPath:
    """A path that dips against the floor's normal halfway."""
    bend = -dip * np.array(FLOOR["normal"])
    rotation = np.array([[0.0, 0.0]] * 3 + [[0.0, 1.0]])
    goal = np.array([0.2, 0.0, 0.1])
    return CameraPath(rotation, np.column_stack([-4.0 * bend, goal + 4.0 * bend, np.zeros(3)]))


def margin(certificate, name: str) -> float:
    return next(c.margin for c in certificate.constraints if c.name == name)


def test_a_half_space_of_the_workspace_is_decided_on_either_side_of_the_truth():
    path = bent(0.12)
    normal = np.array(FLOOR["normal"])
    # n·t along the path is a parabola in w with n·t(1) = 0.08 and the bend 4 w (1 − w) · 0.12.
    a, b = 0.48, 0.08 - 0.48
    truth = -b * b / (4 * a)
    assert truth == pytest.approx((path.positions(FINE) @ normal).min(), abs=1e-7)
    obstacle = [{"type": "half_space", "normal": [0.0, 0.0, 1.0], "offset": -1.0}]
    for off in (1e-3, 1e-6, 1e-9, 1e-12):
        for sign, expected in ((-1, "certified"), (1, "refuted")):
            side = {"normal": FLOOR["normal"], "offset": truth + sign * off}
            asked = problem(workspace={"half_spaces": [side]}, obstacles=obstacle, clearance=0.3)
            verdict, certificate = certify(asked, path)
            assert verdict == expected
            assert margin(certificate, "workspace half-space 0") == pytest.approx(-sign * off, abs=1e-8)
            claimed = Plan(asked, "certified", path, certificate, 0.0, "certified")
            assert verify_plan(claimed).status == expected


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"workspace": {"min": [-1.0, -1.0, 0.0], "max": [1.0, 1.0, 1.0]}}, "workspace z min"),
        ({"workspace": {"min": [-1.0, -1.0, -1.0], "max": [0.2, 1.0, 1.0]}}, "workspace x max"),
        (
            {"obstacles": [{"type": "sphere", "center": [-0.5, 0.0, 0.0], "radius": 0.5}]},
            "clearance obstacle 0",
        ),
    ],
)
def test_an_end_pose_that_just_meets_a_constraint_is_named(changes, says):
    plan = plan_path(problem(**changes))
    assert plan.status == "not_found"
    pose = "goal" if "max" in says else "start"
    assert re.search(rf"fails {says}: .*; the {pose} pose just meets it, .* leave it room$", plan.reason)


def test_a_path_that_the_straight_line_leaves_is_found_inside(look):
    sphere = [{"type": "sphere", "center": [0.1, 0.0, 0.05], "radius": 0.05}]
    half_spaces = [
        FLOOR,
        {"normal": [0.0, -1.0, 0.0], "offset": -0.03},
        {"normal": [0.0, 1.0, 0.0], "offset": -0.03},
    ]
    asked = problem(obstacles=sphere, clearance=0.02, workspace={"half_spaces": half_spaces})
    plan = plan_path(asked)
    assert plan.status == "certified", plan.reason
    seen = look(asked, plan.path, FINE)
    assert 0.0 <= seen["workspace"] < 0.05
    names = [c.name for c in plan.certificate.constraints]
    assert [n for n in names if n.startswith("workspace")] == [f"workspace half-space {i}" for i in range(3)]
    assert verify_plan(plan).status == "certified"


@pytest.mark.parametrize(
    ("side", "says"),
    [
        ({"normal": [1.0, 0.0, 0.0], "offset": 0.1}, r"start pose \(w = 0\) violates workspace half-space 0"),
        ({"normal": [-0.6, 0.0, 0.8], "offset": 0.0}, r"goal pose \(w = 1\) .*falls short by 0\.04 m"),
    ],
)
def test_a_half_space_that_excludes_an_end_pose_makes_the_problem_infeasible(side, says):
    plan = plan_path(problem(workspace={"half_spaces": [side]}))
    assert plan.status == "infeasible"
    assert re.search(says, plan.reason), plan.reason
    assert verify_plan(plan).reasons[0].startswith("infeasible confirmed")


def test_half_spaces_read_back_unchanged_beside_a_box(tmp_path):
    inside = {"min": [-1.0, -1.0, -1.0], "max": [1.0, 1.0, 1.0], "half_spaces": [FLOOR]}
    for workspace in (inside, {"half_spaces": [FLOOR]}):
        asked = problem(workspace=workspace)
        asked.save(tmp_path / "p.json", force=True)
        again = PlanningProblem.load(tmp_path / "p.json")
        assert again.to_dict()["workspace"] == workspace == asked.to_dict()["workspace"]


def test_wrong_python_types_are_refused():
    assert Workspace(half_spaces=[HalfSpace([0, 0, 1], -1.0)]).half_spaces[0].offset == -1.0
    for given in ([[0, 0, 1]], [HalfSpace([0, 0, 1], 0.0, clearance=0.1)]):
        with pytest.raises(InputError, match=r"half_spaces\[0\]: .* a HalfSpace without clearance"):
            Workspace(half_spaces=given)
