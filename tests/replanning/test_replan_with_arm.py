"""A plan on the way for the whole arm: joints go on as they move, and everything is proven again."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from tests.whole_arm.arm_scenes import led_tasks, random_task

from omniservo.errors import Blocked, InputError
from omniservo.planning import (
    Box,
    CameraPath,
    Capsule,
    Cloud,
    Cylinder,
    Ellipsoid,
    HalfSpace,
    Mesh,
    Sphere,
    Workspace,
)
from omniservo.planning.search.problem_search import ProblemSearch
from omniservo.planning.time_budget import TimeBudget
from omniservo.planning.widened import widened
from omniservo.replanning import replan_with_arm
from omniservo.replanning.replan_with_arm import with_room
from omniservo.robots import arm_clearance, load_arm
from omniservo.servoing import RestToRestLaw
from omniservo.tracking import FollowingArm, PathTracker, Replanner
from omniservo.verification import verify_plan
from omniservo.whole_arm import plan_with_arm
from omniservo.whole_arm.arm_descent import LEAP
from omniservo.whole_arm.arm_equations import lead_onto
from omniservo.whole_arm.arm_planner import NEAR, ArmPlanner
from omniservo.whole_arm.part_of_joints import part_of_joints


def moved(problem, random, size):
    """Every ball moved by ``size`` [m]."""
    steps = random.normal(size=(len(problem.obstacles), 3))
    balls = tuple(
        replace(o, center=o.center + size * step / np.linalg.norm(step))
        for o, step in zip(problem.obstacles, steps, strict=True)
    )
    return replace(problem, obstacles=balls)


@pytest.fixture(scope="module")
def planned():
    """A certified plan with its arm."""
    problem, setting = random_task(load_arm("rx60"), np.random.default_rng(5))
    found = plan_with_arm(problem, setting)
    assert found.certified
    return problem, setting, found


def test_a_camera_path_is_followed_as_it_is_unless_what_the_flange_carries_hits_something(planned):
    problem, setting, found = planned
    path = found.plan.path

    def as_it_is(asked):
        planner = ArmPlanner(asked, setting, setting.bodies(asked.obstacles), 0, TimeBudget(None))
        return planner.as_they_are([path], found.branch(np.linspace(0.0, 1.0, NEAR)))

    assert as_it_is(problem).certified
    assert as_it_is(problem).attempts == 1
    in_the_way = Sphere(path(0.5).apply([0.0, 0.0, -0.05]), 0.01)
    assert as_it_is(replace(problem, obstacles=(in_the_way,))) is None


def test_a_path_in_which_the_housing_hits_is_moved_from_joints_near_those_that_follow_it(planned):
    problem, setting, found = planned
    path = found.plan.path
    beside = Sphere(path(0.5).apply([-0.06, 0.0, -0.05]), 0.01)
    asked = replace(problem, obstacles=(*problem.obstacles, beside))
    planner = ArmPlanner(asked, setting, setting.bodies(asked.obstacles), 0, TimeBudget(None))
    near = found.branch(np.linspace(0.0, 1.0, NEAR))
    assert planner.rules_out(path, near)
    led = planner.moved_from(path, near)
    assert led.certified
    np.testing.assert_allclose(led.branch.positions[0], setting.start, atol=1e-9)
    assert np.abs(led.branch(0.5) - found.branch(0.5)).max() < 0.5
    bodies = setting.bodies(asked.obstacles)
    assert arm_clearance(bodies, led.branch, clearance=setting.clearance_around).status == "clear"
    assert verify_plan(led.plan).status == "certified"


def test_a_path_is_ruled_out_by_joints_led_onto_it_that_do_not_keep_what_is_asked(planned):
    problem, setting, found = planned
    path, near = found.plan.path, found.branch(np.linspace(0.0, 1.0, NEAR))

    def planner_of(setting):
        return ArmPlanner(problem, setting, setting.bodies(problem.obstacles), 0, TimeBudget(None))

    planner = planner_of(setting)
    assert not planner.rules_out(path, near + 0.05)
    np.testing.assert_allclose(planner.led_onto(path, near + 0.05), near, atol=1e-6)
    least = found.branch.singular_values.min()
    regular = replace(setting, singular_value=0.9 * least), replace(setting, singular_value=1.1 * least)
    assert [planner_of(each).rules_out(path, near) for each in regular] == [False, True]
    lost = near.copy()
    lost[-1] = np.nan
    assert planner_of(setting).rules_out(path, lost)
    away = CameraPath(path.rotation, 9.0 * path.translation)
    assert planner.led_onto(away, near) is None
    assert planner.rules_out(away, near)


def test_joints_are_carried_far_along_little_by_little_but_not_at_once():
    arm, places = load_arm("panda"), np.linspace(0.0, 1.0, 9)
    begin = np.array([0.0, -0.3, 0.0, -2.0, 0.0, 2.0, 0.7])
    near = begin + np.outer(places, [0.2, 0.1, -0.2, 0.1, 0.1, -0.1, 0.2])
    turned = near + np.outer(places, [2.4, 0.0, 0.0, 0.0, 0.0, 0.0, 1.8])
    goals = np.array([arm.base_T_flange(q).as_matrix() for q in turned])
    carried = near.copy()
    assert lead_onto(arm.chain, goals, LEAP, True, carried)
    np.testing.assert_allclose([arm.base_T_flange(q).as_matrix() for q in carried], goals, atol=1e-8)
    assert np.abs(carried - near).max() > LEAP
    assert not lead_onto(arm.chain, goals, LEAP, False, near.copy())
    assert not lead_onto(arm.chain, goals[[0, -1]], LEAP, True, near[[0, -1]].copy())
    assert lead_onto(arm.chain, goals[:3], LEAP, False, near[:3].copy())


def test_the_old_way_itself_is_moved_where_joints_cannot_be_led_onto_one_near_it():
    random = np.random.default_rng(31)
    problem, setting = random_task(load_arm("rx60"), random)
    found = plan_with_arm(problem, setting)
    now = replace(problem, obstacles=(Sphere([-0.0242, 0.1598, 0.0058], 0.0267),))
    rest = replan_with_arm(found.plan, found.branch, 0.3177, now, setting)
    assert rest.certified
    assert rest.attempts == 1
    assert verify_plan(rest.plan).status == "certified"


@pytest.mark.slow
def test_joints_go_on_and_the_whole_arm_is_clear_of_where_things_are_now():
    arm, certified, elsewhere = load_arm("rx60"), 0, 0
    for seed in range(12):
        random = np.random.default_rng(seed)
        problem, setting = random_task(arm, random)
        found = plan_with_arm(problem, setting)
        if not found.certified:
            continue
        w, now = random.uniform(0.1, 0.7), moved(problem, random, 0.03)
        rest = replan_with_arm(found.plan, found.branch, w, now, setting)
        if not rest.certified:
            assert rest.plan.reason
            continue
        certified += 1
        assert verify_plan(rest.plan).status == "certified"
        assert rest.branch(0.0) == pytest.approx(found.branch(w), abs=1e-5)
        assert rest.branch(0.0, 1) == pytest.approx((1.0 - w) * found.branch(w, 1), abs=1e-4)
        bodies = setting.bodies(now.obstacles)
        for s in np.linspace(0.0, 1.0, 40):
            q = rest.branch(s)
            camera = setting.base_T_initial.inv() * arm.base_T_flange(q) * setting.flange_T_camera
            off = (found.plan.path(w) * rest.plan.path(s)).inv() * camera
            assert np.linalg.norm(off.translation) < 2e-6
            bodies.place(q)
            for near in bodies.near(0.05):
                asked = setting.clearance if bodies.is_around(near.pair) else setting.self_clearance
                assert near.gap >= asked - 1e-9
        old = found.plan.path(w + (1 - w) * 0.5).translation
        elsewhere += np.linalg.norm((found.plan.path(w) * rest.plan.path(0.5)).translation - old) > 1e-3
    assert certified >= 4
    assert elsewhere >= 1


def test_demands_with_room_are_those_of_obstacles_that_ask_for_more(planned):
    problem, _, _ = planned
    vertices = [[0.4, 0, 0], [0.5, 0, 0], [0.4, 0.1, 0], [0.4, 0, 0.1]]
    obstacles = (
        Sphere([0.1, 0.5, 0.2], 0.03),
        HalfSpace([0.0, 1.0, 0.0], -0.8),
        Box([0.3, 0.4, 0.0], [0.02, 0.03, 0.04], [0, 0, 0, 1], clearance=0.005),
        Capsule([0.5, 0.5, 0.1], [0.5, 0.6, 0.1], 0.02),
        Cylinder([0.5, 0.7, 0.1], [0.5, 0.8, 0.1], 0.02),
        Ellipsoid([0.5, 0.7, 0.3], [0.02, 0.03, 0.04], [0, 0, 0, 1]),
        Mesh(vertices),
        Cloud(np.random.default_rng(0).uniform(0.6, 0.7, (30, 3)), 0.01),
    )
    walls = Workspace([-2, -2, -2], [2, 2, 2], (HalfSpace([1.0, 0.0, 0.0], -1.5),))
    asked = replace(problem, obstacles=obstacles, workspace=walls)
    more = widened(asked, {f"clearance obstacle {i}": 0.02 for i in range(len(obstacles))}, 0.0)
    found = with_room(ProblemSearch.of(asked).constraints, 1, 0.02)
    for own, other in zip(found, ProblemSearch.of(more).constraints, strict=True):
        for mine, theirs in zip(own, other, strict=True) if isinstance(own, tuple) else [(own, other)]:
            np.testing.assert_allclose(mine, theirs, atol=1e-12)


def test_a_way_that_is_shut_is_said_with_what_shuts_it(planned):
    problem, setting, found = planned
    here = Sphere(found.plan.path(0.4).translation, 0.02)
    rest = replan_with_arm(found.plan, found.branch, 0.4, replace(problem, obstacles=(here,)), setting)
    assert rest.plan.status == "infeasible"
    assert "start pose" in rest.plan.reason


def test_a_link_that_touches_something_where_the_arm_is_now_is_said(planned):
    problem, setting, found = planned
    elbow = setting.base_T_initial.inv().apply([0.0, 0.0, 0.45])
    touched = replace(problem, obstacles=(Sphere(elbow, 0.05),))
    rest = replan_with_arm(found.plan, found.branch, 0.4, touched, setting)
    assert rest.plan.status == "infeasible"
    assert "the start pose is not free" in rest.plan.reason
    assert "obstacle 0" in rest.plan.reason


def test_a_link_that_touches_something_where_the_arm_is_to_go_is_said(planned):
    """A ball that the housing would be in at the goal, where the camera's centre keeps its clearance."""
    problem, setting, found = planned
    there = Sphere(problem.initial_T_goal.apply([0.0, 0.0, -0.075]), 0.01)
    touched = replace(problem, obstacles=(there,), clearance=0.01)
    rest = replan_with_arm(found.plan, found.branch, 0.4, touched, setting)
    assert rest.plan.status == "infeasible"
    assert "the goal pose is not free" in rest.plan.reason
    assert rest.attempts == 0


def test_joints_that_stand_nearer_to_the_end_of_a_range_than_is_kept_are_said_and_not_refused(planned):
    """They came there by a way that kept less, where there was no other."""
    problem, setting, found = planned
    room = float(setting.arm.limit_margins(found.branch(0.5)).min())
    stricter = replace(setting, start=None, limit_reserve=room + 0.01)
    rest = replan_with_arm(found.plan, found.branch, 0.5, problem, stricter)
    assert rest.plan.status == "infeasible"
    assert "are kept at both ends" in rest.plan.reason


def test_bodies_that_are_given_are_those_that_are_kept_off(planned):
    problem, setting, found = planned
    elbow = setting.base_T_initial.inv().apply([0.0, 0.0, 0.45])
    for obstacles, status in (((Sphere(elbow, 0.05),), "infeasible"), (problem.obstacles, "certified")):
        bodies = setting.bodies(obstacles)
        rest = replan_with_arm(found.plan, found.branch, 0.4, problem, setting, bodies=bodies)
        assert rest.plan.status == status


def test_camera_and_joints_go_on_from_the_pose_that_is_known(planned):
    """The camera is 1 mm and 0.2° beside the old path: the new one begins there, and the arm stands there."""
    problem, setting, found = planned
    pose = found.plan.path(0.4) * RigidTransform.from_exp_coords([0.003, 0.0, -0.002, 0.001, 0.0, 0.0005])
    rest = replan_with_arm(found.plan, found.branch, 0.4, problem, setting, pose=pose)
    assert rest.certified
    ends = pose * rest.plan.path(np.array([0.0, 1.0]))
    np.testing.assert_allclose(
        ends.as_matrix(), [pose.as_matrix(), problem.initial_T_goal.as_matrix()], atol=1e-8
    )
    for s, camera in zip((0.0, 1.0), ends, strict=True):
        flange = setting.arm.base_T_flange(rest.branch(s))
        np.testing.assert_allclose(flange.as_matrix(), setting.base_T_flange(camera).as_matrix(), atol=2e-6)


def test_a_search_for_a_camera_path_that_there_is_not_ends_with_its_time(planned):
    """A wall across the way, for the camera alone: with time enough all starts are tried."""
    problem, setting, found = planned
    middle = found.plan.path(0.7)
    way = found.plan.path(0.7 + 1e-6).translation - middle.translation
    normal = way / np.linalg.norm(way)
    wall = Box(
        middle.translation, [5.0, 5.0, 0.001], Rotation.align_vectors([normal], [[0, 0, 1]])[0].as_quat()
    )
    shut, alone = replace(problem, obstacles=(wall,), clearance=1e-3), replace(setting, clearance=None)
    tried = []
    for seconds in (1e-4, None):
        rest = replan_with_arm(found.plan, found.branch, 0.2, shut, alone, time_budget=seconds)
        assert rest.plan.status == "not_found"
        tried.append(int(re.search(r"no path in (\d+) starts", rest.plan.reason)[1]))
    assert tried[0] == 1
    assert tried[1] > 1000


def test_joints_that_are_elsewhere_are_refused(planned):
    problem, setting, found = planned
    with pytest.raises(InputError, match="joints: they do not put the camera where the plan's path has it"):
        replan_with_arm(found.plan, lambda w: found.branch(w) + 0.5, 0.4, problem, setting)


def test_a_part_of_the_joints_is_the_same_motion(planned):
    _, setting, found = planned
    part, s = part_of_joints(setting, found.branch, 0.21, 0.83), np.linspace(0.0, 1.0, 9)
    for order in (0, 1, 2):
        whole = 0.62**order * found.branch(0.21 + 0.62 * s, order)
        assert part(s, order) == pytest.approx(whole, abs=1e-9)
    assert part.limit_margins == pytest.approx(setting.arm.limit_margins(part.positions))
    assert 0.0 < part.travel < found.branch.travel


def test_what_changes_after_the_way_has_ended_is_answered_from_where_the_arm_stands(planned):
    problem, setting, found = planned
    tracker = PathTracker(found.plan, problem.camera, time_law=RestToRestLaw(4.0))
    replanner = Replanner(tracker, found.plan, arm=FollowingArm(setting, found.branch, None))
    far = tuple(replace(o, radius=0.9 * o.radius) for o in problem.obstacles)
    replanner.set_obstacles(far)
    assert replanner.look(5.0).outcome == "kept"
    inside = setting.base_T_initial.inv().apply(setting.arm.base_T_flange(found.branch(1.0)).translation)
    replanner.set_obstacles([*far, Sphere(inside, 0.01)])
    with pytest.raises(Blocked, match="too near to the goal|is not clear"):
        replanner.look(6.0)


def test_seven_joints_that_were_led_go_on_to_where_they_were_led():
    """Nothing changed: the rest is found, it ends in the same posture, and self-motion does not jump."""
    led = 0
    for problem, setting, found in led_tasks():
        led += 1
        w = 0.4
        again = replan_with_arm(found.plan, found.branch, w, problem, setting)
        assert again.certified, again.plan.reason
        np.testing.assert_allclose(again.branch(1.0), found.branch(1.0), atol=0.02)
        before, after = (1.0 - w) * found.branch(w, 1), again.branch(0.0, 1)
        np.testing.assert_allclose(after, before, atol=1e-4 * np.abs(before).max())
    assert led >= 2
