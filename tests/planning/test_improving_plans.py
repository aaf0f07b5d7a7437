"""The first plan, then better ones, within a time budget."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import preset
from omniservo.errors import InputError
from omniservo.planning import (
    Box,
    Degrees,
    HalfSpace,
    PlanningProblem,
    Sphere,
    Workspace,
    improving_plans,
    plan_path,
)
from omniservo.planning.end_poses import end_margins
from omniservo.planning.improving_plans import first_proven
from omniservo.planning.more_margin import angle_units, tightened
from omniservo.planning.search.problem_search import STARTS, ProblemSearch
from omniservo.planning.search.search import FEW, scheduled
from omniservo.planning.time_budget import TimeBudget
from omniservo.verification import verify_plan


def energy(plan):
    """∫‖t″‖²/ℓ² + ‖φ″‖² dw by Gauss–Legendre quadrature."""
    ell = np.linalg.norm(plan.problem.points, axis=1).mean()
    x, weights = np.polynomial.legendre.leggauss(12)
    total = 0.0
    for coefficients, unit in ((plan.path.rotation, 1.0), (plan.path.translation, ell)):
        for row in coefficients:
            total += float(0.5 * weights @ np.polyval(np.polyder(row, 2), 0.5 + 0.5 * x) ** 2) / unit**2
    return total


def worst(plan):
    """The smallest margin as an angle, the domain and ‖φ‖ left out."""
    units = angle_units(plan.problem)
    found = plan.certificate.constraints
    return min(c.margin / units[c.unit] for c in found if not c.name.startswith(("domain", "rotation")))


def closed_wall(**changes):
    """No path: a wall of spheres that overlap fills the workspace."""
    wall = [Sphere([0.1, y, z], 0.1) for y in np.arange(-1.2, 1.3, 0.12) for z in np.arange(-1.2, 1.3, 0.12)]
    goal = RigidTransform.from_components([0.25, 0.0, 0.1], Rotation.identity())
    walls = Workspace([-1, -1, -1], [1, 1, 1])
    return PlanningProblem(preset("fe185"), [[0.0, 0.0, 0.6]], goal, tuple(wall), workspace=walls, **changes)


class Clock:
    """A clock that goes on by one second whenever it is read."""

    def __init__(self):
        self.now = 0.0

    def __call__(self):
        self.now += 1.0
        return self.now


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["fisheye", "occlusion"])
def test_every_plan_is_certified_and_takes_less_effort_than_the_one_before(random_problems, kind):
    more_than_one = 0
    for problem in random_problems(kind, 6):
        plans = list(improving_plans(problem))
        energies = [energy(plan) for plan in plans]
        assert all(plan.status == "certified" for plan in plans)
        assert all(b < a for a, b in pairwise(energies))
        assert verify_plan(plans[-1]).status == "certified"
        assert energies[-1] <= energy(plan_path(problem)) * 1.0011
        more_than_one += len(plans) > 1
    assert more_than_one >= 4


@pytest.mark.parametrize("quality", ["effort", "margin"])
def test_the_same_problem_and_seed_give_the_same_plans(random_problems, quality):
    problem = random_problems("fisheye", 2)[1]
    first, again = ([p.path for p in improving_plans(problem, quality=quality, seed=2)] for _ in range(2))
    assert len(first) == len(again) > 1
    for a, b in zip(first, again, strict=True):
        assert np.array_equal(a.rotation, b.rotation)
        assert np.array_equal(a.translation, b.translation)


def test_a_budget_ends_a_hopeless_search_and_says_so(monkeypatch):
    """By a clock that runs a second a look: 7 looks, the first of which starts the budget."""
    monkeypatch.setattr("omniservo.planning.time_budget.time.perf_counter", Clock())
    plan = plan_path(closed_wall(), time_budget=5.0)
    assert plan.status == "not_found"
    assert plan.path is not None
    assert plan.reason.startswith("no path was found: time budget of 5 s used up after 5 starts; the best")
    assert "clearance obstacle" in plan.reason


def test_without_an_end_a_hopeless_search_tries_every_start():
    plan = plan_path(closed_wall(degrees=Degrees(2, 3)))
    assert f"no path was found in {1 + FEW + STARTS} starts" in plan.reason


def test_a_small_budget_still_makes_one_start(random_problems):
    problem = random_problems("fisheye", 1)[0]
    plan = plan_path(problem, time_budget=1e-9)
    assert plan.status in ("certified", "not_found")
    assert plan.path.degrees == (1, 1)


@pytest.mark.slow
def test_the_best_attempt_start_by_start_is_that_of_all_at_once():
    search = ProblemSearch.of(closed_wall())
    together, tried = first_proven(search, TimeBudget(None))
    single, tried_alone = first_proven(search, TimeBudget(1e6))
    at_once = search.run(0, search.starts, 0)
    assert not together.proven
    assert tried == tried_alone == at_once.tried == search.starts
    for found in (together, single):
        assert 0 < found.number == at_once.number
        assert np.array_equal(found.path.translation, at_once.path.translation)


@pytest.mark.parametrize("moving", [False, True])
def test_starts_are_counted_over_all_degrees(random_problems, moving):
    velocity = np.full(6, 0.1) if moving else None
    problem = closed_wall(degrees=Degrees(3, 5), initial_velocity=velocity)
    search = ProblemSearch.of(problem)
    stiff = 2 if moving else 1
    expected = [(stiff, 0)]
    for degree in range(stiff + 1, 6):
        expected += [(degree, k) for k in range(STARTS if degree == 5 else FEW)]
    assert search.starts == len(expected)
    found = [scheduled(search.ends, search.degrees, k) for k in range(search.starts)]
    assert found == expected


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf"), "1", True])
def test_a_budget_that_is_none_is_refused(value):
    with pytest.raises(InputError, match="time_budget"):
        TimeBudget(value)


def test_arguments_that_do_not_fit_are_refused(paper):
    with pytest.raises(InputError, match="quality: 'speed' given"):
        plan_path(paper(1), quality="speed")
    with pytest.raises(InputError, match="quality: 'speed' given"):
        improving_plans(paper(1), quality="speed")
    with pytest.raises(InputError, match="neither quality nor time_budget"):
        plan_path(paper(1), method="paper", time_budget=1.0)


def test_an_infeasible_problem_is_one_plan_that_says_so():
    start = Sphere([0.0, 0.0, 0.0], 0.1)
    goal = RigidTransform.from_components([0.25, 0.0, 0.1], Rotation.identity())
    problem = PlanningProblem(preset("fe185"), [[0.0, 0.0, 0.6]], goal, (start,))
    (plan,) = improving_plans(problem)
    assert plan.status == "infeasible"
    assert "clearance obstacle 0" in plan.reason


@pytest.mark.parametrize("kind", ["fisheye", "pinhole", "occlusion"])
def test_the_margin_is_at_least_that_of_least_effort(random_problems, look, kind):
    gained = 0
    for problem in random_problems(kind, 6):
        thrifty, wide = plan_path(problem), plan_path(problem, quality="margin")
        assert wide.status == "certified"
        assert worst(wide) >= worst(thrifty) - 2e-6
        steps = [worst(plan) for plan in improving_plans(problem, quality="margin")]
        assert all(b >= a - 2e-6 for a, b in pairwise(steps))
        assert min(look(problem, wide.path, np.linspace(0, 1, 2001)).values()) >= 0.0
        gained += worst(wide) > worst(thrifty) + 1e-3
    assert gained >= 3


def test_the_margin_is_as_large_as_a_corridor_leaves():
    """Between two walls 0.2 m apart, ends in the middle but 0.08 m from one of them: 0.08 is all there is."""
    walls = (HalfSpace([0.0, 1.0, 0.0], -0.12), HalfSpace([0.0, -1.0, 0.0], -0.08))
    post = Sphere([0.15, 0.0, 0.0], 0.02)
    goal = RigidTransform.from_components([0.3, 0.0, 0.0], Rotation.identity())
    problem = PlanningProblem(preset("fe185"), [[0.1, 0.0, 0.8]], goal, (*walls, post))
    plan = plan_path(problem, quality="margin")
    left = {c.name: c.margin for c in plan.certificate.constraints}
    assert left["clearance obstacle 1"] >= 0.9 * 0.08 - 1e-3
    assert left["clearance obstacle 2"] >= 0.09
    assert verify_plan(plan).status == "certified"


def test_a_tightened_problem_asks_for_so_much_more():
    goal = RigidTransform.from_components([0.3, 0.0, 0.0], Rotation.identity())
    obstacles = (
        Sphere([0.15, 0.0, 0.3], 0.02, 0.01),
        Box([0.15, 0.4, 0.0], [0.1, 0.1, 0.1], [0, 0, 0, 1]),
        HalfSpace([0.0, 1.0, 0.0], -0.6),
    )
    workspace = Workspace([-1, -1, -1], [1, 1, 1], (HalfSpace([1.0, 0.0, 0.0], -0.5),))
    problem = PlanningProblem(
        preset("fe185"), [[0.1, 0.0, 0.8]], goal, obstacles, occlusion=True, workspace=workspace
    )
    before = end_margins(problem)
    units = angle_units(problem)
    after = end_margins(tightened(problem, dict.fromkeys(before, 0.01)))
    for name, (margin, unit) in before.items():
        if name.startswith(("domain", "rotation", "occlusion obstacle 1")):
            continue
        assert after[name][0] == pytest.approx(margin - 0.01 * units[unit], abs=2e-3 * units[unit]), name
