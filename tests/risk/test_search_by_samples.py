"""Plans are searched with few samples and the worst ones; what is said of a risk rests on all others."""

import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from tests.risk.test_plan_with_risk import estimated

from omniservo.planning import CameraPath, HalfSpace, plan_path
from omniservo.risk import Executions, plan_with_risk
from omniservo.risk.plan_with_risk import problem_of_estimate
from omniservo.risk.safe_path import (
    WORST,
    _Search,
    allowed_violations,
    critical_places,
    joint_shift,
    safe_path,
    upper_bound,
    worst_samples,
)
from omniservo.risk.samples import RiskSamples


@pytest.fixture
def samples(paper):
    """Of an estimate whose scale is 3% off (1σ): some margins have to be widened."""
    problem = paper(1)
    estimate = estimated(problem, scale_sigma=0.03)
    rows = np.flatnonzero(estimate.inliers)
    return RiskSamples(problem_of_estimate(problem, estimate, rows), estimate, rows, 0.01, 0)


def test_no_sample_is_drawn_where_there_is_no_plan(samples, monkeypatch):
    monkeypatch.setattr(type(samples), "_drawn", lambda *_: pytest.fail("drawn"))
    blocked = replace(samples.problem, clearance=1.0)
    assert safe_path(blocked, samples.draws, 0.01, 0).plan.status == "infeasible"


def test_all_samples_are_drawn_only_where_a_few_miss_something(samples):
    alike = replace(samples.few, points=np.repeat(samples.problem.points[None], 500, axis=0))
    draws = (lambda: alike, lambda: pytest.fail("drawn"))
    found = safe_path(samples.problem, draws, 0.01, 0)
    assert found.ok
    assert not found.extra.any()
    assert safe_path(samples.problem, samples.draws, 0.01, 0).extra.any()


def test_the_worst_samples_give_the_shift_and_the_verdict_of_all(samples):
    """As long as each constraint's worst are among them; here those of another path."""
    plan = safe_path(samples.problem, samples.draws, 0.3, 0).plan
    tighter = safe_path(samples.problem, samples.draws, 0.01, 0).plan
    every = samples.every
    allowed = allowed_violations(0.01, samples.count)
    of_other = every.margins(plan.path, critical_places(plan))
    rows = worst_samples(of_other, WORST * (allowed + 1))
    assert len(rows) < 0.5 * samples.count
    margins = every.margins(tighter.path, critical_places(tighter))
    misses = np.flatnonzero((margins < 0.0).any(axis=1))
    assert np.isin(misses, rows).all()
    np.testing.assert_array_equal(joint_shift(margins[rows], allowed), joint_shift(margins, allowed))


def test_the_worst_samples_are_the_lowest_of_every_constraint():
    margins = np.random.default_rng(95).standard_normal((300, 3))
    rows = worst_samples(margins, 20)
    for column in margins.T:
        assert np.isin(np.argsort(column)[:20], rows).all()
    np.testing.assert_array_equal(worst_samples(margins, 300), np.arange(300))


def test_a_plan_that_the_worst_samples_allow_is_judged_by_all(samples, monkeypatch):
    """RiskSamples that miss, but were not among the worst of the path before, are not passed over."""
    plan = safe_path(samples.problem, samples.draws, 0.01, 0).plan
    other = safe_path(samples.problem, samples.draws, 0.3, 0).plan
    search, allowed = _Search(samples.draws[-1:], 0.01), allowed_violations(0.01, samples.count)
    search.missed(search.judged(other, other.path))
    assert search.judged(plan, plan.path).ok
    shares = []

    def judge(executions, places):
        shares.append(len(executions.points))
        return np.arange(len(executions.points)) < (100 if executions is samples.every else 0)

    monkeypatch.setattr(Executions, "violated_at", judge)
    found = search.judged(plan, plan.path)
    assert (found.ok, found.violations, found.allowed) == (False, 100, allowed)
    assert shares[0] < shares[1] == samples.count


def test_what_is_said_of_the_risk_rests_on_all_samples_that_have_no_part_in_the_search(paper, monkeypatch):
    """Drawn with a seed of their own; what they show is all that counts."""
    problem, drawn = paper(1), []
    estimate = estimated(problem, scale_sigma=0.03)
    sample = type(estimate).sample

    def spied(self, random, count, *others):
        state = repr(random.bit_generator.state["state"])
        drawn.append((state, count))
        return sample(self, random, count, *others)

    monkeypatch.setattr(type(estimate), "sample", spied)
    found = plan_with_risk(problem, estimate, risk=0.01)
    assert found.ok
    assert [count for _, count in drawn] == [500, 2000, 2000], "more is drawn for reasons that nobody reads"
    assert len({state for state, _ in drawn}) == 3
    rows = np.flatnonzero(estimate.inliers)
    check = RiskSamples(problem_of_estimate(problem, estimate, rows), estimate, rows, 0.01, 0).check
    margins = check.margins(found.plan.path, critical_places(found.plan))
    violations = int((margins < 0.0).any(axis=1).sum())
    assert found.predicted == violations / 2000
    assert found.predicted_bound == upper_bound(violations, 2000)


def repeating(estimate, monkeypatch, repeats):
    """As if a sample's motion were so often among all."""
    sample = type(estimate).sample
    monkeypatch.setattr(type(estimate), "sample", lambda *given: replace(sample(*given), repeats=repeats))


def test_samples_that_repeat_motions_say_as_much_as_fewer_independent_ones(paper, monkeypatch):
    problem = paper(1)
    estimate = estimated(problem, scale_sigma=0.03)
    repeating(estimate, monkeypatch, 2.0)
    found = plan_with_risk(problem, estimate, risk=0.01)
    assert found.ok
    violations = round(2000 * found.predicted)
    assert found.predicted_bound == upper_bound(violations, 2000, 2.0) > upper_bound(violations, 2000)
    assert upper_bound(10, 2000, 2.0) == pytest.approx(upper_bound(5, 1000))
    assert [allowed_violations(0.01, 2000, repeats) for repeats in (1.0, 2.0, 5.0)] == [9, 5, -1]


def test_samples_of_too_few_motions_show_no_risk_however_few_miss(paper, monkeypatch):
    estimate = estimated(paper(1), noise=1e-4)
    repeating(estimate, monkeypatch, 20.0)
    found = plan_with_risk(paper(1), estimate, risk=0.01)
    assert not found.ok
    assert found.predicted < 0.005
    assert "an effective sample size of 100" in found.plan.reason


def test_after_a_verdict_against_it_a_plan_begins_with_the_margins_it_had(paper, monkeypatch):
    searched, module = [], sys.modules["omniservo.risk.plan_with_risk"]

    def spied(problem, draws, risk, seed, planner, begin=None):
        found = safe_path(problem, draws, risk, seed, planner, begin)
        searched.append((len(draws), risk, begin, found))
        return found

    monkeypatch.setattr(module, "safe_path", spied)
    monkeypatch.setattr(module, "upper_bound", lambda *_: 0.0101 if len(searched) < 2 else 0.0099)
    assert plan_with_risk(paper(1), estimated(paper(1), scale_sigma=0.03), risk=0.01).ok
    (few, risk, begin, first), (every, less, again, _) = searched
    assert (few, every, begin) == (2, 1, None)
    assert less < risk
    np.testing.assert_array_equal(again, first.extra)
    assert first.extra.any()


def unmet_anywhere(runs, places):
    """Which samples leave any constraint unmet at any place."""
    everything = np.ones(places.planned.shape, dtype=np.bool_)
    found = runs._run(places.response, everything, runs.points, runs.camera, 1)
    return (runs._grouped(found[:, 0]) < 0.0).any(axis=1)


@pytest.mark.parametrize("scene", [1, 2, 3])
def test_no_sample_that_violates_anything_anywhere_is_passed_over(paper, scene):
    """A verdict looks at few constraints in few places: those that a few samples show to be in danger."""
    problem = paper(scene)
    estimate = estimated(problem, noise=0.2, scale_sigma=0.05)
    rows = np.flatnonzero(estimate.inliers)
    runs = RiskSamples(problem_of_estimate(problem, estimate, rows), estimate, rows, 0.01, 0).every
    plan = plan_path(runs.problem)
    places = runs.places(plan.path, critical_places(plan))
    missing = unmet_anywhere(runs, places)
    assert 10 < missing.sum() < 0.9 * len(missing)
    np.testing.assert_array_equal(runs.violated_at(places), missing)
    assert places.in_danger.mean() < 0.7


def test_samples_unlike_the_few_that_show_where_to_look_are_judged_where_constraints_are_tightest(samples):
    """The few take a thousandth of a millimetre; behind them come structures some centimetres off."""
    rng, plan = np.random.default_rng(96), safe_path(samples.problem, samples.draws, 0.01, 0).plan
    points = np.repeat(samples.problem.points[None], 300, axis=0)
    points += 1e-6 * rng.standard_normal(points.shape)
    points[200:] += 0.05 * rng.standard_normal((100, 1, 3))
    runs = Executions(samples.problem, points, np.zeros((300, 0)))
    places = runs.places(plan.path, critical_places(plan))
    missing = (runs.margins_at(places) < 0.0).any(axis=1)
    assert missing.sum() > 5
    np.testing.assert_array_equal(runs.violated_at(places), missing)


def test_where_a_constraint_is_tightest_nothing_may_be_taken_and_much_where_it_leaves_more(paper):
    """The camera leaves a wall, then goes along it: what is turned about the start is taken at the end."""
    rng, start = np.random.default_rng(97), paper(1)
    goal = RigidTransform.from_translation([0.2, 0.014, 0.0])
    wall = HalfSpace([0.0, 1.0, 0.0], -0.031)
    problem = replace(start, initial_T_goal=goal, obstacles=(wall,), clearance=0.03, visibility_margin=0.0)
    angles = np.concatenate([0.008 * rng.standard_normal(100), -0.09 * np.ones(20)])
    turns = [Rotation.from_rotvec([0.0, 0.0, angle]).as_matrix() for angle in angles]
    runs = Executions(problem, problem.points @ np.transpose(turns, (0, 2, 1)), np.zeros((120, 0)))
    path = CameraPath(np.eye(4)[:, 3:], [[0.0, 0.2, 0.0], [-0.014, 0.028, 0.0], np.zeros(3)])
    places = runs.places(path, np.empty(0))
    assert (np.argmin(places.planned[:, 0]), places.planned[0, 0]) == (0, pytest.approx(1e-3))
    missing = unmet_anywhere(runs, places)
    assert missing[100:].all()
    np.testing.assert_array_equal((runs.margins_at(places) < 0.0).any(axis=1), missing)
    np.testing.assert_array_equal(runs.violated_at(places), missing)


def test_an_exact_camera_has_no_parameters_and_leaves_the_same_margins(paper):
    problem = paper(1)
    estimate = estimated(problem, noise=0.2)
    drawn = estimate.sample(np.random.default_rng(1), 300, camera=problem.camera)
    assert drawn.camera.shape[1] == 5
    assert not drawn.camera.any()
    exact = Executions.of(problem, drawn)
    assert exact.camera.shape == (300, 0)
    plan = plan_path(problem)
    stated = replace(exact, camera=drawn.camera).margins(plan.path, np.empty(0))
    np.testing.assert_allclose(exact.margins(plan.path, np.empty(0)), stated, rtol=0.0, atol=1e-12)


def test_what_would_help_is_looked_for_when_it_is_read(paper, monkeypatch):
    module, asked = sys.modules["omniservo.risk.plan_with_risk"], []
    helpful = module.what_would_help
    monkeypatch.setattr(module, "what_would_help", lambda *given: asked.append(given) or helpful(*given))
    found = plan_with_risk(paper(1), estimated(paper(1), noise=0.6, seed=5, scale_sigma=0.001), risk=0.01)
    assert not found.ok
    assert not asked
    assert found.plan.reason.endswith(found.advice)
    assert found.plan.status == "not_found"
    assert len(asked) == 1
