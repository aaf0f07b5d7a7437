"""Paths that leave with a given velocity."""

import numpy as np
import pytest
from scipy.interpolate import BPoly

from omniservo.errors import InputError
from omniservo.planning import CameraPath, Plan, PlanningProblem, certify, plan_path
from omniservo.planning.search.bending import least_bent
from omniservo.planning.search.path_family import offsets, path_controls, path_energy, path_family, unknowns
from omniservo.planning.search.problem_search import ends_of
from omniservo.verification import verify_plan

FINE = np.linspace(0.0, 1.0, 2001)


def moving(problem: PlanningProblem, velocity: np.ndarray, degree: int = 4) -> PlanningProblem:
    degrees = {"rotation": degree, "translation": degree}
    fields = problem.to_dict() | {"initial_velocity": list(velocity), "degrees": degrees}
    return PlanningProblem.from_dict(fields)


def velocity_toward(problem: PlanningProblem, rng: np.random.Generator) -> np.ndarray:
    """Towards the goal, and some way off it."""
    linear = problem.goal_translation * rng.uniform(0.3, 1.5) + 0.05 * rng.normal(size=3)
    angular = problem.initial_T_goal.rotation.as_rotvec() * rng.uniform(0.0, 1.2) + 0.1 * rng.normal(size=3)
    return np.array([*linear, *angular])


@pytest.mark.parametrize("kind", ["fisheye", "pinhole"])
def test_paths_leave_with_the_velocity_and_hold_everywhere(random_problems, look, kind):
    rng = np.random.default_rng(5)
    certified = 0
    for problem in random_problems(kind, 15):
        asked = moving(problem, velocity_toward(problem, rng))
        plan = plan_path(asked)
        assert np.allclose(plan.path(0.0, 1), asked.initial_velocity, rtol=0.0, atol=1e-9)
        assert np.allclose(plan.path(1.0).as_matrix(), asked.initial_T_goal.as_matrix(), atol=1e-9)
        if plan.status == "certified":
            certified += 1
            assert min(look(asked, plan.path, FINE).values()) >= 0.0
            assert verify_plan(plan).status == "certified"
    assert certified >= 12


def test_a_velocity_survives_the_file(random_problems):
    problem = moving(random_problems("fisheye", 1)[0], np.arange(6) * 0.01)
    again = PlanningProblem.from_dict(problem.to_dict())
    assert np.array_equal(again.initial_velocity, np.arange(6) * 0.01)
    assert random_problems("fisheye", 1)[0].initial_velocity is None


@pytest.mark.parametrize("order", [0, 1, 3, 5])
def test_a_path_with_another_velocity_is_no_path_of_the_problem(random_problems, order):
    problem = random_problems("fisheye", 1)[0]
    path = plan_path(problem).path
    twist = path(0.0, 1)
    kept = moving(problem, twist)
    assert certify(kept, path)[0] == "certified"
    twist[order] += 1.1e-9
    other = moving(problem, twist)
    with pytest.raises(InputError, match="velocity at w = 0 misses initial_velocity"):
        certify(other, path)
    assert verify_plan(Plan(other, "undecided", path, None, 0.0, "certified")).status == "refuted"


def test_degree_two_leaves_the_one_path_and_degree_one_none(random_problems):
    problem = random_problems("fisheye", 1)[0]
    velocity = np.array([0.1, 0.0, 0.2, 0.0, 0.3, 0.0])
    plan = plan_path(moving(problem, velocity, 2))
    assert plan.path.degrees == (2, 2)
    assert np.allclose(plan.path.translation[:, 1], velocity[:3])
    with pytest.raises(InputError, match="degrees.rotation: 1 given with an initial_velocity"):
        moving(problem, velocity, 1)


@pytest.mark.parametrize(
    "value", [[0.0] * 5, [0.0] * 7, [0, 0, 0, 0, 0, np.nan], [0, 0, 0, 0, 0, 2e6], "fast"]
)
def test_a_velocity_that_is_none_is_refused(random_problems, value):
    problem = random_problems("fisheye", 1)[0]
    with pytest.raises(InputError, match="initial_velocity"):
        PlanningProblem(problem.camera, problem.points, problem.initial_T_goal, initial_velocity=value)


def test_the_papers_search_refuses_a_velocity(random_problems):
    problem = moving(random_problems("fisheye", 1)[0], np.zeros(6))
    with pytest.raises(InputError, match="initial_velocity"):
        plan_path(problem, method="paper")


def powers(controls: np.ndarray) -> np.ndarray:
    """Power coefficients, highest first, by interpolation at Chebyshev points."""
    n = controls.shape[1] - 1
    w = 0.5 - 0.5 * np.cos(np.pi * (np.arange(n + 1) + 0.5) / (n + 1))
    values = BPoly(controls.T[:, None, :], [0.0, 1.0])(w)
    return np.array([np.polyfit(w, row, n) for row in values.T])


def bent(controls: np.ndarray) -> float:
    """∫‖p″‖² by Gauss–Legendre quadrature."""
    nodes, weights = np.polynomial.legendre.leggauss(12)
    second = BPoly(controls.T[:, None, :], [0.0, 1.0]).derivative(2)(0.5 + 0.5 * nodes)
    return float(0.5 * weights @ (second**2).sum(axis=1))


@pytest.mark.parametrize("degree", [2, 3, 4, 7])
def test_the_base_bends_least_and_energies_add(random_problems, degree):
    """Against quadrature, and against offsets in all directions: none lowers the energy."""
    rng = np.random.default_rng(degree)
    problem = moving(random_problems("fisheye", 1)[0], rng.normal(size=6), degree)
    family = path_family(ends_of(problem), degree, degree)
    free = unknowns(family)
    assert free == 7 * (degree - 2)
    for size in (0.0, 1e-3, 1.0):
        x = size * rng.normal(size=free)
        phi, t = path_controls(family, 0.5, x)
        expected = bent(phi) + bent(t) / 0.25
        assert path_energy(family, 0.5, x) == pytest.approx(expected, rel=1e-12)
        assert path_energy(family, 0.5, x) >= path_energy(family, 0.5, np.zeros(free))
        back = np.empty(free)
        offsets(family, 0.5, phi, t, back)
        assert np.allclose(back, x, rtol=0.0, atol=1e-14)
        path = CameraPath(powers(phi), powers(t))
        assert np.allclose(path(0.0, 1), problem.initial_velocity, atol=1e-12)


@pytest.mark.parametrize("degree", [2, 5])
def test_the_velocity_of_the_straight_path_gives_the_straight_path(random_problems, degree):
    problem = random_problems("fisheye", 1)[0]
    angular = 2.0 * problem.goal_quaternion[:3]
    straight = moving(problem, np.array([*problem.goal_translation, *angular]), degree)
    family = path_family(ends_of(straight), degree, degree)
    assert path_energy(family, 0.5, np.zeros(unknowns(family))) == pytest.approx(0.0, abs=1e-30)


def test_a_straight_line_bends_nothing():
    controls = np.zeros((3, 6))
    end = np.array([0.1, -0.2, 0.7])
    assert least_bent(end, end - controls[:, 0], controls) == 0.0
    assert np.allclose(controls, np.outer(end, np.linspace(0.0, 1.0, 6)), atol=1e-16)
