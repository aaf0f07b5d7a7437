"""Plans for uncertain estimates: what the servo makes of a wrong structure, and margins that allow for it."""

import math
import sys
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from tests.cli.valid_output import check_output

from omniservo.errors import InputError
from omniservo.estimation import EstimateSamples, estimate_two_view
from omniservo.planning import PlanningProblem, Sphere, plan_path
from omniservo.risk import plan_with_risk
from omniservo.risk.executions import IMAGE, Executions, _columns
from omniservo.risk.safe_path import (
    CONFIDENCE,
    EACH,
    STRICTER,
    allowed_violations,
    joint_shift,
    upper_bound,
)
from omniservo.risk.servo_response import servo_response
from omniservo.servoing import RestToRestLaw
from omniservo.tracking import PathTracker, TrackerOptions
from omniservo.verification import verify_plan


def estimated(problem, noise=0.05, seed=3, **options):
    """An estimate of the problem's own motion and points from two noisy images."""
    rng = np.random.default_rng(seed)
    views = [problem.points, problem.initial_T_goal.inv().apply(problem.points)]
    pixels = [problem.camera.project(p)[0] for p in views]
    noisy = [p + noise * rng.standard_normal(p.shape) for p in pixels]
    length = float(np.linalg.norm(problem.initial_T_goal.translation))
    return estimate_two_view(problem.camera, *noisy, **({"scale": length} | options))


def rest(camera, plan, points, w):
    """Where PathTracker leads a camera that may take all the time it needs, by its own twists."""
    law = RestToRestLaw(4.0)
    times = np.linspace(0.0, 4.0, 4001)
    time = float(times[np.argmin([abs(law(t)[0] - w) for t in times])])
    tracker = PathTracker(plan, camera, options=TrackerOptions(gate_px=1e3), time_law=law)
    pose = plan.path(w)
    planned = law(time)[1] * plan.path(w, 1)
    for _ in range(50):
        pixels, _ = camera.project(pose.inv().apply(points))
        twist = tracker.step(time, pixels) - planned  # the reference stands still: only the feedback acts
        pose = pose * RigidTransform.from_exp_coords(np.concatenate((twist[3:], twist[:3])) * 0.1)
    return pose


def executed_pose(problem, plan, points, w):
    """The pose that the risk's first-order response predicts."""
    response = servo_response(problem.camera, problem.points, plan.path, np.array([w]), 0)
    planned = plan.path(w)
    seen = planned.inv().apply(points)
    gap = seen / np.linalg.norm(seen, axis=1, keepdims=True) - response.planned[0]
    twist = -response.inverse[0] @ gap.ravel()
    return planned * RigidTransform.from_components(twist[:3], Rotation.from_rotvec(twist[3:]))


@pytest.mark.parametrize("w", [0.3, 0.5])
def test_the_servo_rests_where_the_response_says(paper, w):
    problem = paper(1)
    plan = plan_path(problem)
    rng = np.random.default_rng(91)
    points = problem.points + 0.002 * rng.standard_normal(problem.points.shape)
    found, expected = rest(problem.camera, plan, points, w), executed_pose(problem, plan, points, w)
    moved = np.linalg.norm(found.translation - plan.path(w).translation)
    assert moved > 1e-3
    # One step to a place some millimetres off, over distances of 0.3 m: the rest is of second order.
    assert np.linalg.norm(found.translation - expected.translation) < 0.1 * moved


@pytest.mark.parametrize("factor", [0.95, 1.05])
def test_a_scale_error_scales_the_executed_translation(paper, factor):
    problem = paper(2)
    plan = plan_path(problem)
    for w in (0.25, 0.5):
        executed = rest(problem.camera, plan, factor * problem.points, w)
        planned = plan.path(w)
        np.testing.assert_allclose(executed.translation, factor * planned.translation, atol=2e-4)
        assert (planned.rotation.inv() * executed.rotation).magnitude() < 1e-3
        predicted = executed_pose(problem, plan, factor * problem.points, w)
        np.testing.assert_allclose(predicted.translation, factor * planned.translation, atol=1e-3)


def test_margins_of_an_exact_structure_are_those_of_the_path(paper):
    problem = paper(3)
    plan = plan_path(problem)
    samples = EstimateSamples(
        RigidTransform.from_components(np.zeros((3, 3)), Rotation.identity(3)),
        np.repeat(problem.points[None], 3, axis=0),
        np.zeros((3, 0)),
    )
    runs = Executions.of(problem, samples, np.ones(9, dtype=np.bool_))
    found = runs.margins(plan.path, np.array([c.w for c in plan.certificate.constraints]))
    certified = {c.name.split(" (")[0]: c.margin for c in plan.certificate.constraints if c.unit == "m"}
    for g, name in enumerate(runs.constraints):
        if name != IMAGE:
            assert found[0, g] == pytest.approx(certified[name], abs=2e-4), name
    np.testing.assert_allclose(found, np.repeat(found[:1], 3, axis=0))


def test_a_lens_error_that_estimate_and_servo_share_leaves_the_start_where_it_is(paper):
    """The true points are seen through the true camera: at w = 0 they look as in the initial picture."""
    problem = paper(1)
    estimate = estimated(problem, noise=0.0, calibration_covariance=np.diag([1.0, 1.0, 4.0, 4.0, 1e-4]))
    samples = estimate.sample(np.random.default_rng(0), 200, ("calibration",))
    asked = replace(problem, points=estimate.points, initial_T_goal=estimate.initial_T_goal)
    plan = plan_path(asked)
    runs = Executions.of(asked, samples, estimate.inliers)
    obstacle = runs.constraints.index("clearance obstacle 0")
    at_start = runs._run(
        runs._response(plan.path, np.array([0.0])),
        np.ones((1, len(_columns(problem))), dtype=np.bool_), runs.points, runs.camera, 1,
    )[:, 0]  # fmt: skip
    along = runs.margins(plan.path, np.empty(0))[:, obstacle]
    clearances = at_start[:, 0]
    assert np.ptp(clearances) < 0.1 * np.ptp(along)


def test_the_plan_keeps_the_widened_margins_by_the_independent_verifier(paper):
    problem = paper(1)
    found = plan_with_risk(problem, estimated(problem, scale_sigma=0.03))
    assert found.ok
    assert found.plan.status == "certified"
    assert found.extra_clearance > 1e-3
    assert found.plan.problem.obstacles[0].clearance == pytest.approx(
        problem.clearance + found.margins["clearance obstacle 0"].extra
    )
    assert verify_plan(found.plan).status == "certified"
    assert found.predicted_bound <= 0.01


def test_a_plan_is_ok_by_the_bound_on_its_risk_and_not_by_what_the_samples_show(paper, monkeypatch):
    """Few enough samples violate anything; what so few of them leave possible is more than the risk."""
    for bound, ok in ((0.01, True), (0.0101, False)):
        doubted = sys.modules["omniservo.risk.plan_with_risk"]
        monkeypatch.setattr(doubted, "upper_bound", lambda *_, bound=bound: bound)
        found = plan_with_risk(paper(1), estimated(paper(1), noise=1e-4), risk=0.01)
        assert found.predicted < 0.01
        assert (found.ok, found.plan.status) == (ok, "certified" if ok else "not_found")


def test_less_risk_takes_more_margin(paper):
    problem = paper(1)
    estimate = estimated(problem, scale_sigma=0.05)
    extras = [plan_with_risk(problem, estimate, risk=r).extra_clearance for r in (0.3, 0.05, 0.005)]
    assert extras[0] < extras[1] < extras[2]


def test_fresh_samples_violate_as_seldom_as_predicted(paper):
    problem = paper(1)
    estimate = estimated(problem, noise=0.1, scale_sigma=0.03)
    found = plan_with_risk(problem, estimate, risk=0.05)
    asked = replace(problem, points=estimate.points, initial_T_goal=estimate.initial_T_goal)
    samples = estimate.sample(np.random.default_rng(12345), 4000, camera=problem.camera)
    margins = Executions.of(asked, samples, estimate.inliers).margins(found.plan.path, np.empty(0))
    share = (margins < 0.0).any(axis=1).mean()
    assert share < 0.05
    assert share == pytest.approx(found.predicted, abs=0.015)


@pytest.mark.parametrize(("noise", "sigma", "dominant"), [(0.01, 0.2, "scale"), (0.6, 0.001, "noise")])
def test_advice_names_the_source_without_which_there_is_a_path(paper, noise, sigma, dominant):
    problem = paper(1)
    found = plan_with_risk(problem, estimated(problem, noise=noise, seed=5, scale_sigma=sigma), risk=0.01)
    words = {"scale": "a known length", "noise": "more points"}
    assert not found.ok
    assert found.plan.status == "not_found"
    assert words[dominant] in found.advice
    other = words["noise" if dominant == "scale" else "scale"]
    assert other not in found.advice
    assert found.advice in found.plan.reason


def test_a_problem_without_a_path_says_that_uncertainty_is_not_the_reason(paper):
    problem = paper(1)
    blocked = replace(problem, clearance=1.0)
    found = plan_with_risk(blocked, estimated(problem))
    assert not found.ok
    assert found.plan.status == "infeasible"
    assert "without uncertainty" in found.advice


def test_the_bound_is_that_of_clopper_and_pearson():
    from scipy.stats import binomtest

    for bad, count in ((0, 2000), (12, 2000), (30, 400)):
        interval = binomtest(bad, count, alternative="less").proportion_ci(EACH, method="exact")
        assert upper_bound(bad, count) == pytest.approx(interval.high, rel=1e-9)
    assert upper_bound(allowed_violations(0.01, 2000), 2000) <= 0.01
    assert upper_bound(allowed_violations(0.01, 2000) + 1, 2000) > 0.01


def test_a_plan_whose_risk_is_too_large_passes_any_of_all_verdicts_with_at_most_the_stated_chance():
    """A search that begins anew after a verdict is judged by the same samples again, and so are the links."""
    from scipy.stats import binom

    for risk, count in ((0.01, 2000), (0.05, 2000), (0.001, 20_000)):
        passes = binom.cdf(allowed_violations(risk, count), count, risk)
        assert 2 * len(STRICTER) * passes <= 1.0 - CONFIDENCE


def test_margins_that_fail_together_are_paid_for_once():
    rng = np.random.default_rng(92)
    common = rng.standard_normal((2000, 1))
    together = joint_shift(np.repeat(common, 4, axis=1), 20)
    apart = joint_shift(rng.standard_normal((2000, 4)), 20)
    assert together.max() == pytest.approx(2.33, abs=0.25)
    assert apart.min() > together.max()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"scale": None}, "is_metric: false given"),
        ({"risk": 0.0}, "risk"),
        ({"risk": 0.9}, "risk"),
    ],
)
def test_what_cannot_be_planned_with_is_named(paper, change, said):
    problem = paper(1)
    options = {"risk": 0.01} | {k: v for k, v in change.items() if k == "risk"}
    estimate = estimated(problem, **{k: v for k, v in change.items() if k != "risk"})
    with pytest.raises(InputError, match=said):
        plan_with_risk(problem, estimate, **options)


def test_points_that_are_not_followed_may_leave_the_image(paper):
    problem = paper(1)
    estimate = estimated(problem, noise=0.02)
    some = np.array([0, 2, 5, 7])
    found = plan_with_risk(problem, estimate, risk=0.05, points=some)
    assert found.ok
    np.testing.assert_array_equal(found.plan.problem.points, estimate.points[some])


@pytest.mark.parametrize("points", [[], [0.5, 1.0], [[0, 1]], [0, 99], [-1]])
def test_points_to_follow_are_rows_of_inliers(paper, points):
    with pytest.raises(InputError, match="points: "):
        plan_with_risk(paper(1), estimated(paper(1)), points=points)


@pytest.mark.parametrize("points", [[0], [0, 4, 8], [0, 1, 2, 2], [0, 0, 4, 4], [0, 1, 2, 3, 3]])
def test_points_to_follow_are_as_many_as_a_servo_needs_and_each_counts_once(paper, points):
    with pytest.raises(InputError, match="points: .* given; at least 4, each once, are needed"):
        plan_with_risk(paper(1), estimated(paper(1)), points=points)


def test_a_seed_is_a_whole_number_as_for_a_plan(paper):
    problem = paper(1)
    estimate = estimated(problem)
    first, same = (plan_with_risk(problem, estimate, risk=0.05, seed=seed) for seed in (1, 1.0))
    assert first.predicted == same.predicted
    with pytest.raises(InputError, match="seed: -1 given"):
        plan_with_risk(problem, estimate, risk=0.05, seed=-1)


def test_the_command_takes_an_estimate_and_reports_the_risk(paper, tmp_path, capsys):
    from omniservo.cli.main import main

    problem = paper(1)
    problem.save(tmp_path / "problem.json")
    estimated(problem, scale_sigma=0.03).save(tmp_path / "estimate.json")
    files = [str(tmp_path / "problem.json"), "--estimate", str(tmp_path / "estimate.json")]
    with pytest.raises(SystemExit) as end:
        main(["plan", *files, "--risk", "0.02", "--json"])
    assert end.value.code == 0
    report = check_output(capsys.readouterr().out)
    assert report["status"] == "certified"
    assert report["risk"]["predicted_bound"] <= 0.02
    assert set(report["risk"]["margins"]["clearance obstacle 0"]["parts"]) == {"noise", "scale"}


def test_moved_points_behind_an_obstacle_count_as_hidden():
    """An occlusion that the plan just avoids is violated by half of the samples."""
    from omniservo.cameras import preset

    points = np.array([[x, y, 0.5] for x in (-0.1, 0.0, 0.1) for y in (-0.1, 0.0, 0.1)])
    goal = RigidTransform.from_components([0.05, 0.0, 0.1], Rotation.identity())
    problem = PlanningProblem(
        preset("perspective"), points, goal, (Sphere([0.0, -0.0, 0.9], 0.05, 0.0),), occlusion=True
    )
    plan = plan_path(problem)
    rng = np.random.default_rng(93)
    moved = points + np.array([0.0, 0.0, 0.6]) * rng.integers(0, 2, (200, 1, 1))
    samples = EstimateSamples(goal, moved, np.zeros((200, 0)))
    runs = Executions.of(problem, samples, np.ones(9, dtype=np.bool_))
    margins = runs.margins(plan.path, np.empty(0))[:, runs.constraints.index("occlusion obstacle 0")]
    behind = moved[:, 0, 2] > 0.9
    assert (margins[behind] < 0.0).all()
    assert (margins[~behind] > 0.0).all()
    assert not math.isnan(margins.sum())
