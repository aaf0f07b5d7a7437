"""The least effort: slopes against differences, the Hessian, and SciPy's SLSQP from the same path."""

import numpy as np
import pytest
from benchmarks.comparisons.planning.neutral import neutral_of
from benchmarks.comparisons.planning.path_space import PathSpace
from benchmarks.comparisons.planning.samples import Samples
from scipy.optimize import minimize

from omniservo.geometry.polynomial import bernstein_from_power
from omniservo.planning.constraints.push import ASLEEP
from omniservo.planning.search.descent import room_for
from omniservo.planning.search.economise import leads_back
from omniservo.planning.search.effort_steps import update_hessian
from omniservo.planning.search.path_family import offsets, path_family, set_uniform_samples, unknowns
from omniservo.planning.search.problem_search import ProblemSearch
from omniservo.planning.search.settle import end_values
from omniservo.planning.search.worst_rows import LOOKED_AT, Looks, look_at_samples, slope_at

KINDS = ["fisheye", "pinhole", "catadioptric", "occlusion"]
SAMPLES = 5


@pytest.mark.parametrize("kind", KINDS)
def test_the_slope_of_a_groups_worst_constraint_is_that_of_differences(random_problems, kind):
    rng = np.random.default_rng(1)
    compared = 0
    for problem in random_problems(kind, 3, 3):
        search = ProblemSearch.of(problem)
        family = path_family(search.ends, 3, 2)
        x = 0.1 * rng.normal(size=unknowns(family))
        asleep = np.full(len(end_values(search.constraints, family)), LOOKED_AT)
        room = room_for(SAMPLES, len(problem.points))
        set_uniform_samples(family, SAMPLES)

        def levels(x, constraints=search.constraints, family=family, asleep=asleep, room=room):
            found = np.empty((SAMPLES, len(asleep)))
            look_at_samples(constraints, family, x, asleep, room, found)
            return found

        h = 1e-6
        steps = [(levels(x + h * e), levels(x - h * e)) for e in np.eye(len(x))]
        here, row, scratch = levels(x), np.empty(len(x)), np.empty(len(asleep))
        quiet = np.full(len(asleep), ASLEEP)
        looks = Looks(search.constraints, family, room, np.zeros(len(asleep)), asleep)
        for s, group in np.argwhere(np.isfinite(here)):
            slope_at(looks, s, group, here[s, group], quiet, scratch, row)
            ahead = np.array([a[s, group] for a, _ in steps]) - here[s, group]
            behind = here[s, group] - np.array([b[s, group] for _, b in steps])
            if np.allclose(ahead, behind, atol=1e-9):  # no other point or end of a segment takes over
                # the dead zone's tangent turns with the point, which its slope leaves out
                off = 2e-3 if group == len(search.constraints.limits) else 1e-5
                assert np.allclose(row, (ahead + behind) / (2.0 * h), atol=off)
                compared += 1
        assert (quiet == ASLEEP).all()
    assert compared > 40


def test_a_way_back_is_clear_along_a_proven_path_alone(random_problems):
    blocked = 0
    for problem in (problem for kind in KINDS for problem in random_problems(kind, 3)):
        search = ProblemSearch.of(problem)
        path = search.run(0, search.starts, 0).path
        family = path_family(search.ends, path.rotation.shape[1] - 1, path.translation.shape[1] - 1)
        x, straight = np.empty(unknowns(family)), np.zeros((1, unknowns(family)))
        controls = bernstein_from_power(path.rotation), bernstein_from_power(path.translation)
        offsets(family, search.constraints.ell, *controls, x)
        assert leads_back(search.constraints, family, x, np.vstack([straight, x]))
        assert not leads_back(search.constraints, family, x, straight[:0])
        blocked += not leads_back(search.constraints, family, x, straight)
    assert blocked > 0


@pytest.mark.parametrize("kind", KINDS)
def test_more_starts_never_leave_more_effort(random_problems, kind):
    for problem in random_problems(kind, 3):
        search = ProblemSearch.of(problem)
        one, four, eight = (search.run(0, search.starts, k) for k in (1, 4, 8))
        assert one.proven
        assert eight.energy <= four.energy <= one.energy
        beaten = search.run(one.number, one.number + 1, 1, 0.5 * one.least_energy)
        assert beaten.proven
        assert beaten.energy >= one.energy


def test_the_hessian_stays_positive_and_learns_the_curvature():
    rng = np.random.default_rng(2)
    root = rng.normal(size=(5, 5))
    true, hessian = root @ root.T + np.eye(5), np.eye(5)
    for _ in range(5):
        for step in np.linalg.eigh(true)[1].T.copy():
            update_hessian(hessian, step, true @ step, 0.0)
            if step @ true @ step >= 0.2 * step @ hessian @ step:
                assert step @ hessian @ step == pytest.approx(step @ true @ step)
    assert np.allclose(hessian, true)
    for _ in range(50):
        step = rng.normal(size=5)
        update_hessian(hessian, step, -3.0 * step, 0.1 * step @ step)
        assert np.linalg.eigvalsh(hessian).min() > 0.0


@pytest.mark.parametrize("kind", KINDS)
def test_slsqp_from_the_same_path_finds_little_less(random_problems, kind):
    """SLSQP on 200 samples, which its optimum touches; it may leave the constraints between them."""
    for problem in random_problems(kind, 3):
        search = ProblemSearch.of(problem)
        status, rotation, translation, facts = search.kernel(0, search.starts, 1)
        assert status == 1
        if rotation.shape[1] == 2:
            continue
        space = PathSpace(neutral_of(problem), 2, 2)
        samples = Samples(space, np.linspace(0.0, 1.0, 202)[1:-1])
        start = np.concatenate(
            [
                rotation[:, 1] / 2.0 - (rotation[:, 0] + rotation[:, 1]) / 2.0,
                (translation[:, 1] - translation.sum(axis=1)) / 2.0 / space.neutral.ell,
            ]
        )
        assert space.energy(start) == pytest.approx(facts[3], rel=1e-9)
        rows = samples.values(start) < 0.3
        best = minimize(
            space.energy,
            start,
            jac=lambda x, space=space: 2.0 * space.bending @ x,
            method="SLSQP",
            constraints={
                "type": "ineq",
                "fun": lambda x, samples=samples, rows=rows: samples.values(x)[rows],
                "jac": lambda x, samples=samples, rows=rows: samples.linearised(x)[1][rows],
            },
            options={"maxiter": 50, "ftol": 1e-8},
        )
        assert facts[3] <= 1.01 * best.fun or samples.values(best.x).min() < -1e-3
