"""Planning: what is found, what is proven, what is said when there is none."""

import re

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import UnifiedCamera, preset
from omniservo.errors import InputError
from omniservo.planning import CameraPath, Degrees, Plan, PlanningProblem, Sphere, Workspace, plan_path
from omniservo.verification import verify_plan

FINE = np.linspace(0.0, 1.0, 5001)


def energy(plan: Plan) -> float:
    """∫‖t″‖²/ℓ² + ‖φ″‖² dw by Gauss–Legendre quadrature."""
    ell = np.linalg.norm(plan.problem.points, axis=1).mean()
    x, weights = np.polynomial.legendre.leggauss(12)
    w, weights = 0.5 * (x + 1.0), 0.5 * weights
    total = 0.0
    for coefficients, unit in ((plan.path.rotation, 1.0), (plan.path.translation, ell)):
        for row in coefficients:
            total += float(weights @ np.polyval(np.polyder(row, 2), w) ** 2) / unit**2
    return total


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "count", "degree", "share"),
    [
        ("fisheye", 50, 2, 1.0),
        ("pinhole", 50, 2, 1.0),
        ("catadioptric", 30, 2, 1.0),
        ("occlusion", 30, 4, 0.96),
    ],
)
def test_random_problems_are_certified_and_hold_everywhere(random_problems, look, kind, count, degree, share):
    certified, bent = 0, 0
    for problem in random_problems(kind, count, degree):
        plan = plan_path(problem)
        if plan.status != "certified":
            continue
        certified += 1
        bent += plan.path.degrees != (1, 1)
        assert plan.reason == ""
        assert min(look(problem, plan.path, FINE).values()) >= 0.0
        assert min(c.margin for c in plan.certificate.constraints) >= 0.0
    assert certified >= share * count
    assert bent > 0.8 * count


@pytest.mark.parametrize("kind", ["fisheye", "pinhole", "catadioptric", "occlusion"])
def test_the_independent_verifier_accepts_the_plans(random_problems, kind):
    for problem in random_problems(kind, 3):
        plan = plan_path(problem)
        verdict = verify_plan(plan)
        assert (verdict.status, verdict.reasons) == ("certified", ())


@pytest.mark.parametrize("example", [1, 2, 3])
def test_the_papers_examples_are_certified(paper, look, example):
    problem = paper(example)
    plan = plan_path(problem)
    assert plan.status == "certified"
    assert plan.path.degrees == (2, 2)
    assert verify_plan(plan).status == "certified"
    assert min(look(problem, plan.path, FINE).values()) >= 0.0
    ends = plan.path([0.0, 1.0])
    assert np.allclose(ends.as_matrix()[0], np.eye(4), atol=1e-12)
    assert np.allclose(ends.as_matrix()[1], problem.initial_T_goal.as_matrix(), atol=1e-12)


def test_the_second_example_without_occlusion_backs_off_and_with_it_goes_over(paper):
    """The paper's q₂: with the box in the way of the view, the camera passes at +y."""
    plain, aware = plan_path(paper(2)), plan_path(paper(3))
    assert aware.path.positions(0.5)[1] > plain.path.positions(0.5)[1] + 0.01
    hidden = paper(3).to_dict() | {"clearance": 0.07}
    plan = Plan(PlanningProblem.from_dict(hidden), "undecided", plain.path, None, 0.0, "certified")
    assert verify_plan(plan).status == "refuted"


def test_a_free_straight_line_is_the_plan():
    goal = RigidTransform.from_components([0.1, 0.0, 0.1], Rotation.from_rotvec([0.0, 0.1, 0.0]))
    problem = PlanningProblem(preset("fe185"), [[0.0, 0.0, 0.6]], goal, degrees=Degrees(4, 4))
    plan = plan_path(problem)
    assert plan.status == "certified"
    assert plan.path.degrees == (1, 1)
    assert energy(plan) == 0.0


def test_the_same_call_gives_the_same_path_and_another_seed_may_give_another(random_problems):
    differ = 0
    for problem in random_problems("occlusion", 10):
        first, again, other = (plan_path(problem, seed=s) for s in (3, 3, 4))
        assert np.array_equal(first.path.rotation, again.path.rotation)
        assert np.array_equal(first.path.translation, again.path.translation)
        differ += not np.array_equal(first.path.translation, other.path.translation)
    assert differ > 0


def test_higher_degrees_are_used_only_where_lower_ones_fail(random_problems):
    for problem in random_problems("fisheye", 5, 5):
        assert max(plan_path(problem).path.degrees) <= 2


@pytest.mark.parametrize(("sigma", "tau"), [(1, 2), (2, 1), (1, 3), (4, 3)])
def test_degrees_are_never_exceeded(random_problems, sigma, tau):
    for problem in random_problems("fisheye", 6):
        fields = problem.to_dict() | {"degrees": {"rotation": sigma, "translation": tau}}
        plan = plan_path(PlanningProblem.from_dict(fields))
        assert plan.path.degrees[0] <= sigma
        assert plan.path.degrees[1] <= tau
        if tau > 1:
            assert plan.status == "certified"


def test_the_path_takes_little_more_effort_than_the_best_of_a_general_solver(paper, look):
    """SLSQP on 200 samples from our path as a start; its optimum touches the constraints at the samples."""
    for example in (1, 2):
        problem = paper(example)
        plan = plan_path(problem)
        w = np.linspace(0.0, 1.0, 201)

        def path(v, plan=plan, move=problem.goal_translation):
            u, free = v[:4], v[4:]
            total = plan.path.rotation[:, 0] + plan.path.rotation[:, 1]
            rotation = np.column_stack([total - u, u, [0, 0, 0, 1]])
            return CameraPath(rotation, np.column_stack([move - free, free, np.zeros(3)]))

        def effort(v, path=path, problem=problem):
            return energy(Plan(problem, "certified", path(v), None, 0.0, ""))

        def left(v, path=path, problem=problem, w=w):
            t = path(v).positions(w)
            return np.concatenate(
                [np.linalg.norm(t - o.center, axis=1) / problem.clearance - 1.0 for o in problem.obstacles]
            )

        start = np.concatenate([plan.path.rotation[:, 1], plan.path.translation[:, 1]])
        best = minimize(effort, start, method="SLSQP", constraints={"type": "ineq", "fun": left})
        assert best.success
        assert min(look(problem, path(best.x), w).values()) > -1e-6
        assert energy(plan) <= 1.01 * best.fun


INFEASIBLE = {
    "obstacle at the start": (
        {"obstacles": [{"type": "sphere", "center": [0, 0, -0.03], "radius": 0.01}], "clearance": 0.05},
        r"start pose \(w = 0\) violates clearance obstacle 0: falls short by 0.03 m",
    ),
    "obstacle at the goal": (
        {"obstacles": [{"type": "sphere", "center": [0.2, 0, 0.1], "radius": 0.02}]},
        r"goal pose \(w = 1\) violates clearance obstacle 0: falls short by 0.02 m",
    ),
    "too close to a point": (
        {"least_distance": 0.55},
        r"goal pose \(w = 1\) violates least_distance \(point 0\): falls short by 0.0114835 m",
    ),
    "workspace without the start": (
        {"workspace": {"min": [0.1, -1, -1], "max": [1, 1, 1]}},
        r"start pose \(w = 0\) violates workspace x min: falls short by 0.1 m",
    ),
    "workspace without the goal": (
        {"workspace": {"min": [-1, -1, -1], "max": [0.15, 1, 1]}},
        r"goal pose \(w = 1\) violates workspace x max: falls short by 0.05 m",
    ),
    "point outside the image": (
        {"points": [[0.0, 0.0, 0.6], [0.0, 0.6, 0.1]]},
        r"start pose \(w = 0\) violates visibility bottom edge \(point 1\): falls short by .* px",
    ),
    "hidden at the start": (
        {
            "occlusion": True,
            "obstacles": [{"type": "sphere", "center": [0.0, 0.01, 0.3], "radius": 0.05}],
        },
        r"start pose \(w = 0\) violates occlusion obstacle 0 \(point 0\): falls short by 0.04 m",
    ),
    "target inside an obstacle": (
        {
            "occlusion": True,
            "obstacles": [{"type": "sphere", "center": [0.0, 0.01, 0.6], "radius": 0.05}],
        },
        r"start pose \(w = 0\) violates occlusion obstacle 0 \(point 0\)",
    ),
}


def small_problem(**changes: object) -> PlanningProblem:
    fields = {
        "format": "omniservo.problem/1",
        "camera": preset("fe185").to_dict(),
        "points": [[0.0, 0.0, 0.6]],
        "goal": {"translation": [0.2, 0.0, 0.1], "quaternion": [0.0, 0.0, 0.0, 1.0]},
    }
    return PlanningProblem.from_dict(fields | changes)


@pytest.mark.parametrize("name", INFEASIBLE)
def test_an_end_pose_that_violates_a_constraint_is_named(name):
    change, message = INFEASIBLE[name]
    plan = plan_path(small_problem(**change))
    assert (plan.status, plan.path, plan.certificate) == ("infeasible", None, None)
    assert re.search(message, plan.reason), plan.reason
    confirmed = verify_plan(plan)
    assert confirmed.reasons[0].startswith("infeasible confirmed")


def test_a_point_in_the_dead_zone_is_named():
    camera = preset("para-catadioptric")
    below = [[0.0, 0.0, 0.6], [0.5, 0.0, 0.3]]
    plan = plan_path(small_problem(camera=camera.to_dict(), points=below))
    assert plan.status == "infeasible"
    assert "dead_zone (point 0)" in plan.reason
    assert verify_plan(plan).reasons[0].startswith("infeasible confirmed")


def test_a_point_outside_the_models_domain_is_named():
    camera = UnifiedCamera(300, 300, 320, 240, 0.0, 640, 480)
    plan = plan_path(small_problem(camera=camera.to_dict(), points=[[0.0, 0.0, -0.6]]))
    assert plan.status == "infeasible"
    assert "outside the model's domain" in plan.reason


@pytest.mark.slow
def test_a_closed_wall_is_not_found_with_the_best_attempt_and_what_stopped_it():
    wall = [
        {"type": "sphere", "center": [0.1, y, z], "radius": 0.1}
        for y in np.arange(-3.0, 3.01, 0.12)
        for z in np.arange(-3.0, 3.01, 0.12)
    ]
    inside = {"min": [-1, -1, -1], "max": [1, 1, 1]}
    plan = plan_path(small_problem(obstacles=wall, workspace=inside))
    assert plan.status == "not_found"
    assert plan.path is not None
    assert "clearance obstacle" in plan.reason
    assert "m left at w = 0." in plan.reason
    assert plan.certificate.worst.name.startswith("clearance obstacle")


def test_a_workspace_that_leaves_only_a_detour_is_kept(look):
    walls = {"min": [-0.05, -0.02, -0.01], "max": [0.25, 0.3, 0.11]}
    sphere = [{"type": "sphere", "center": [0.1, 0.0, 0.05], "radius": 0.05}]
    problem = small_problem(workspace=walls, obstacles=sphere, clearance=0.02)
    plan = plan_path(problem)
    assert plan.status == "certified"
    assert plan.path.positions(0.5)[1] > 0.05
    assert look(problem, plan.path, FINE)["workspace"] >= 0.0
    assert verify_plan(plan).status == "certified"


def test_a_wall_with_one_hole_is_passed_through_the_hole():
    hole = np.array([0.05, 0.12])
    wall = [
        {"type": "sphere", "center": [0.1, y, z], "radius": 0.03}
        for y in np.arange(-0.6, 0.61, 0.05)
        for z in np.arange(-0.6, 0.61, 0.05)
        if np.hypot(y - hole[0], z - hole[1]) > 0.075
    ]
    plan = plan_path(small_problem(obstacles=wall, workspace={"min": [-0.3] * 3, "max": [0.5, 0.4, 0.4]}))
    assert plan.status == "certified"


def test_bad_arguments_are_refused(paper):
    with pytest.raises(InputError, match="method: 'fast' given; legal: 'certified', 'paper'"):
        plan_path(paper(1), method="fast")
    with pytest.raises(InputError, match="seed"):
        plan_path(paper(1), seed=float("nan"))
    with pytest.raises(InputError, match=r"visibility_margin: 400 px given: .*half the image"):
        plan_path(paper(1, visibility_margin=400.0))


def test_a_point_is_an_obstacle_but_hides_nothing():
    on_the_line = [{"type": "sphere", "center": [0.0, 0.0, 0.3], "radius": 0.0}]
    plan = plan_path(small_problem(obstacles=on_the_line, occlusion=True))
    assert plan.status == "certified"
    names = [c.name for c in plan.certificate.constraints]
    assert "clearance obstacle 0" in names
    assert not any(name.startswith("occlusion") for name in names)


def test_an_obstacles_own_clearance_replaces_the_problems():
    own = [{"type": "sphere", "center": [0.1, 0.0, 0.05], "radius": 0.0, "clearance": 0.05}]
    plan = plan_path(small_problem(obstacles=own, clearance=0.3))
    assert plan.status == "certified"
    apart = np.linalg.norm(plan.path.positions(FINE) - [0.1, 0.0, 0.05], axis=1).min()
    assert 0.05 <= apart < 0.051


def test_workspace_and_sphere_come_from_python_as_from_files():
    goal = RigidTransform.from_components([0.2, 0.0, 0.1], Rotation.identity())
    by_hand = PlanningProblem(
        preset("fe185"),
        [[0.0, 0.0, 0.6]],
        goal,
        (Sphere([0.1, 0.0, 0.05], 0.02),),
        workspace=Workspace([-1, -1, -1], [1, 1, 1]),
    )
    from_file = small_problem(
        obstacles=[{"type": "sphere", "center": [0.1, 0.0, 0.05], "radius": 0.02}],
        workspace={"min": [-1, -1, -1], "max": [1, 1, 1]},
    )
    assert by_hand.to_dict() == from_file.to_dict()
