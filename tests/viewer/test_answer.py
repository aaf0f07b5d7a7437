"""What is shown of an answer is what the planner proved, at its place in the world."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform
from tests.viewer.conftest import settled

from omniservo.cameras import preset
from omniservo.planning import PlanningProblem, Sphere, plan_path
from omniservo.robots.collision.arm_clearance import Closeness
from omniservo.viewer.along_path import arm_curves, camera_curves
from omniservo.viewer.answer import Answer
from omniservo.viewer.open_viewed import judged_again
from omniservo.viewer.situation import Situation
from omniservo.viewer.status import status_html
from omniservo.viewer.worst_place import worst_place


@pytest.fixture(scope="module")
def answer(served):
    return settled(served)


def no_path(answer, **changes):
    """The same situation with changes that leave no path."""
    situation = answer.situation.with_problem(**changes)
    return Answer(1, situation, plan_path(situation.problem))


def test_the_camera_is_shown_from_start_to_goal_and_the_arm_holds_it_there(answer):
    situation = answer.situation
    for w, pose in ((0.0, situation.world_T_initial), (1.0, situation.world_T_goal)):
        assert np.allclose(answer.world_T_camera(w).as_matrix(), pose.as_matrix(), atol=1e-9)
        assert np.allclose(answer.places(3)[round(2 * w)], pose.translation, atol=1e-9)
    for w in (0.0, 0.3, 0.7, 1.0):
        held = situation.arm.scene.world_T_camera(answer.joints(w))
        assert np.abs(held.as_matrix() - answer.world_T_camera(w).as_matrix()).max() < 1e-4


def test_the_tightest_constraint_stands_first_and_is_a_bound_only_where_it_is_proven(answer):
    tightest = answer.worst.words.partition(":")[0]
    (first, *_) = re.findall(r"<tr><td>(.*?)</td>", status_html(answer))
    assert first == tightest
    assert "≥" in status_html(answer)
    seen = replace(answer, camera_plan=replace(answer.camera_plan, status="undecided"), arm_plan=None)
    assert "≥" not in status_html(seen)


def test_without_a_path_the_nearer_end_is_shown(answer):
    situation, refused = answer.situation, no_path(answer, clearance=0.2)
    assert refused.verdict == "no path"
    for w, pose in ((0.4, situation.world_T_initial), (0.6, situation.world_T_goal)):
        assert np.allclose(refused.world_T_camera(w).as_matrix(), pose.as_matrix())


def test_a_goal_that_stands_too_near_is_shown_at_the_goal(answer):
    problem = answer.situation.problem
    box = problem.obstacles[0]
    beside = np.add(problem.goal_translation, [0.03, 0.0, 0.0])
    there = replace(box, center=beside, half_extents=[0.01, 0.01, 0.01])
    refused = no_path(answer, obstacles=(there,), clearance=0.05)
    place = worst_place(refused.situation, refused.plan, None)
    assert (place.w, place.violated, place.obstacle) == (1.0, True, 0)
    assert np.allclose(place.line[0], refused.situation.world_T_goal.translation)
    gap = there.distance(np.array([problem.goal_translation]))[0]
    assert np.linalg.norm(place.line[1] - place.line[0]) == pytest.approx(gap, abs=1e-5)


def test_an_end_at_which_the_arm_cannot_stand_is_shown_there(answer):
    situation, plan = answer.situation, replace(answer.plan, path=None, certificate=None, status="infeasible")
    for end, w, pose in (("start", 0.0, situation.world_T_initial), ("goal", 1.0, situation.world_T_goal)):
        place = worst_place(situation, replace(plan, reason=f"the {end} is out of reach"), None)
        assert (place.w, place.violated) == (w, True)
        assert np.allclose(place.line, pose.translation)


def test_what_the_arm_comes_too_near_to_is_shown_where_it_does(answer):
    situation, found = answer.situation, answer.arm_plan
    closest = Closeness(w=0.3, link="wrist", other="obstacle 0", gap=-0.002, asked=0.008)
    refused = replace(
        found,
        plan=replace(found.plan, status="not_found"),
        clearance=replace(found.clearance, status="too_close", closest=closest, proven=-np.inf),
    )
    place = worst_place(situation, refused.plan, refused)
    assert (place.w, place.violated, place.obstacle) == (0.3, True, 0)
    held = situation.arm.scene.world_T_camera(found.branch(0.3)).translation
    assert np.allclose(place.line[0], held)
    assert "wrist and obstacle 0 overlap by 2.00 mm" in place.words
    assert all(curve.certified is None for curve in arm_curves(situation, refused))


def test_a_file_without_a_path_is_never_certified(answer):
    assert judged_again(replace(answer.camera_plan, path=None)).status == "infeasible"


def test_the_distance_to_what_moves_is_drawn_where_it_then_is():
    motion = [[0.1, 0.0], [0.0, 0.0], [0.05, 0.0]]  # 0.1 m along x and 0.05 m along z, from w = 0 to 1
    points = [[x, y, 0.5] for x in (-0.1, 0.0, 0.1) for y in (-0.1, 0.0, 0.1)]
    goal = RigidTransform.from_translation([0.05, 0.0, 0.05])
    ball = Sphere([-0.2, 0.05, 0.0], 0.03, motion=motion)
    plan = plan_path(PlanningProblem(preset("fe185"), points, goal, (ball,)))
    curve = camera_curves(plan)[0]
    there = np.add([-0.2, 0.05, 0.0], curve.w[:, None] * [0.1, 0.0, 0.05])
    gaps = np.linalg.norm(plan.path.positions(curve.w) - there, axis=1) - 0.03
    assert np.allclose(curve.values, 1e3 * gaps, atol=1e-9)
    assert curve.values.min() >= curve.certified - 1e-9


def test_what_is_changed_of_an_estimate_is_one_no_more(answer):
    known: Situation = replace(answer.situation, uncertain=object(), risk=0.1)
    assert known.with_problem(clearance=0.001).risk == 0.1
    for name in ("camera", "points", "initial_T_goal"):
        changed = known.with_problem(**{name: getattr(known.problem, name)})
        assert (changed.uncertain, changed.risk) == (None, 0.0), name


def test_a_body_is_one_under_its_new_number_when_another_obstacle_is_deleted(answer):
    box = answer.situation.problem.obstacles[0]
    three = answer.situation.with_added(Sphere([0.0, 0.3, 0.0], 0.01)).with_added(box)
    assert three.bodies == {0, 2}
    assert (three.without(1).bodies, three.without(0).bodies) == ({0, 1}, {1})


def test_an_arm_s_plan_that_ran_out_of_time_is_searched_for_to_the_end_once_the_hand_rests(page, monkeypatch):
    found, budgets = settled(page).arm_plan, []

    def planned(problem, setting, *, time_budget):
        budgets.append(time_budget)
        if time_budget is None:
            return found
        return replace(found, plan=replace(found.plan, status="not_found"), seconds=time_budget)

    monkeypatch.setattr("omniservo.viewer.page.plan_with_arm", planned)
    number = page.answer.number
    page.replan()
    assert settled(page, number).verdict == "certified"
    assert budgets == [0.06, None]
