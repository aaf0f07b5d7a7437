"""The paper's own search: literal where its text is defined, and said where it is not."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import UnifiedCamera, preset
from omniservo.planning import Degrees, PlanningProblem, Sphere, plan_path
from omniservo.planning.paper_search import SAMPLES, paper_path, virtual_box
from omniservo.verification import verify_plan


def pinhole_problem(**changes: object) -> PlanningProblem:
    camera = UnifiedCamera(420.0, 420.0, 319.5, 239.5, 0.0, 640, 480)
    points = [[0.0, 0.0, 0.8], [0.1, 0.05, 0.9], [-0.1, 0.05, 0.85]]
    goal = RigidTransform.from_components([0.2, 0.0, 0.1], Rotation.from_rotvec([0.0, -0.2, 0.0]))
    given = {"obstacles": (Sphere([0.1, 0.01, 0.05]),), "clearance": 0.05} | changes
    return PlanningProblem(camera, points, goal, **given)  # type: ignore[arg-type]


def test_30_is_undefined_for_the_papers_own_camera():
    """At the corner (659, 432): δ is imaginary."""
    camera = preset("fe185")
    assert virtual_box(camera) is None
    x = (camera.width - camera.cx) / camera.fx
    y = (camera.height - camera.cy) / camera.fy
    assert 1.0 + (1.0 - camera.xi**2) * (x * x + y * y) < 0.0


def test_the_box_of_30_for_a_perspective_camera_is_its_corner():
    zx, zy, hole = virtual_box(UnifiedCamera(420.0, 420.0, 319.5, 239.5, 0.0, 640, 480))
    assert (zx, zy, hole) == pytest.approx((320.5 / 420.0, 240.5 / 420.0, 0.0))


@pytest.mark.parametrize("xi", [0.5, 0.8])
def test_the_box_of_30_is_the_virtual_plane_point_of_the_corner(xi):
    """The bearing of the corner pixel, carried to the plane Z = 1."""
    camera = UnifiedCamera(600.0, 600.0, 320.0, 240.0, xi, 640, 480)
    zx, zy, _ = virtual_box(camera)
    (x, y, z), valid = camera.unproject([640.0, 480.0])
    assert valid
    assert (zx, zy) == pytest.approx((x / z, y / z), rel=1e-12)


@pytest.mark.parametrize("example", [1, 2])
def test_the_papers_examples_are_solved_and_the_departure_is_said(paper, example):
    plan = plan_path(paper(example), method="paper")
    assert plan.method == "paper"
    assert "(30) is undefined" in plan.reason
    assert plan.status in ("certified", "refuted", "undecided")
    assert plan.certificate is not None
    assert verify_plan(plan).status == plan.status


def test_the_paper_has_no_occlusion_constraint_and_its_plan_is_judged_with_it(paper):
    plan = plan_path(paper(3), method="paper")
    assert plan.status == "refuted"
    assert "occlusion" in plan.reason or "clearance" in plan.reason
    assert verify_plan(plan).status == "refuted"


def test_v_equal_to_zero_is_the_straight_line_with_zero_initial_speed():
    problem = pinhole_problem(obstacles=())
    path, note = paper_path(problem)
    assert note == ""
    assert np.array_equal(path.translation[:, 0], problem.goal_translation)
    assert not path.translation[:, 1:].any()
    assert not path(0.0, 1).any()


def test_the_search_stops_as_soon_as_the_samples_are_satisfied():
    problem = pinhole_problem()
    path, note = paper_path(problem)
    assert note == ""
    w = np.linspace(0.0, 1.0, SAMPLES)
    apart = np.linalg.norm(path.positions(w) - problem.obstacles[0].center, axis=1)
    assert apart.min() > problem.clearance
    assert plan_path(problem, method="paper").status == "certified"


def test_degree_one_has_no_freedom_and_is_judged_as_it_is():
    plan = plan_path(pinhole_problem(degrees=Degrees(1, 1)), method="paper")
    assert plan.status == "refuted"
    assert "clearance obstacle 0" in plan.reason


def test_the_papers_plan_is_the_same_every_time(paper):
    first, again = (plan_path(paper(1), method="paper") for _ in range(2))
    assert np.array_equal(first.path.translation, again.path.translation)
