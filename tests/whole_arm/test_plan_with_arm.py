"""A plan with an arm is one that the whole arm can follow, wherever along it one looks."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from tests.whole_arm.arm_scenes import led_tasks, random_task

from omniservo.errors import InputError
from omniservo.planning import (
    Box,
    Capsule,
    Cylinder,
    Degrees,
    Ellipsoid,
    HalfSpace,
    Mesh,
    Sphere,
    plan_path,
)
from omniservo.planning.time_budget import TimeBudget
from omniservo.robots import ArmBodies, Solid, follow_path, load_arm, shipped_arms
from omniservo.robots.arm import SINGULAR_VALUE
from omniservo.verification import verify_plan
from omniservo.whole_arm import plan_with_arm
from omniservo.whole_arm.arm_planner import ArmPlanner
from omniservo.whole_arm.joint_demands import JointDemands
from omniservo.whole_arm.plan_with_arm import DEGREE, REGULAR
from omniservo.whole_arm.solids_of import solids_of


def assert_kept(problem, setting, found, places=60):
    """Every promise, at places of the path, by means that the planner does not use."""
    assert found.plan.status == "certified"
    bodies = setting.bodies(problem.obstacles)
    low, high = setting.arm.joint_range.T
    for w in np.linspace(0.0, 1.0, places):
        q = found.branch(w)
        camera = setting.arm.base_T_flange(q) * setting.flange_T_camera
        off = (setting.base_T_initial * found.plan.path(w)).inv() * camera
        assert np.linalg.norm(off.translation) < 2e-6
        assert off.rotation.magnitude() < 2e-6
        assert (q >= low + setting.limit_reserve - 1e-9).all()
        assert (q <= high - setting.limit_reserve + 1e-9).all()
        bodies.place(q)
        for near in bodies.near(max(setting.clearance, setting.self_clearance)):
            asked = setting.clearance if bodies.is_around(near.pair) else setting.self_clearance
            assert near.gap >= asked - 1e-9


@pytest.mark.parametrize("name", shipped_arms())
def test_what_is_certified_holds_for_the_whole_arm(name):
    """Random tasks; where it is not certified the reason says why."""
    arm, certified = load_arm(name), 0
    for seed in range(8):
        problem, setting = random_task(arm, np.random.default_rng(seed))
        found = plan_with_arm(problem, setting)
        if found.certified:
            certified += 1
            np.testing.assert_allclose(found.branch(0.0), setting.start, atol=1e-6)
            assert_kept(problem, setting, found)
        else:
            assert found.plan.status in ("not_found", "infeasible")
            assert found.plan.reason
    assert certified >= 2


def test_seven_joints_are_led_to_a_posture_that_is_free_at_the_goal():
    """By themselves they end where joint 4 is stretched or the arm in the way; led, they get there."""
    led = 0
    for problem, setting, found in led_tasks():
        led += 1
        assert_kept(problem, setting, found)
        np.testing.assert_allclose(found.branch(0.0), setting.start, atol=1e-6)
        frames = setting.base_T_initial, setting.flange_T_camera
        again = follow_path(
            setting.arm, found.plan.path, *frames, start=setting.start, aim=found.plan.aim
        ).best
        np.testing.assert_array_equal(again.positions, found.branch.positions)
    assert led >= 2


def test_a_goal_out_of_reach_of_seven_joints_is_infeasible_and_named():
    problem, setting = random_task(load_arm("panda"), np.random.default_rng([2026, 1]))
    away = RigidTransform.from_translation([0.0, 0.0, -3.0])
    found = plan_with_arm(replace(problem, initial_T_goal=away, obstacles=()), setting)
    assert found.plan.status == "infeasible"
    assert "goal" in found.plan.reason


def test_a_path_that_the_arm_cannot_follow_is_moved_until_it_can():
    """Of random tasks whose first camera path is none for the arm, most have another one."""
    arm, failed, helped = load_arm("rx60"), 0, 0
    for seed in range(60):
        problem, setting = random_task(arm, np.random.default_rng([7, seed]))
        first = plan_path(problem)
        if first.status != "certified":
            continue
        found = plan_with_arm(problem, setting)
        if found.plan.status == "infeasible":
            continue
        if found.certified and np.array_equal(found.plan.path.translation, first.path.translation):
            continue
        failed += 1
        helped += found.certified
        if found.certified:
            assert_kept(problem, setting, found, places=15)
        if failed == 5:
            break
    assert failed == 5
    assert helped >= 2


def _link_place(setting, link, q):
    bodies = ArmBodies(setting.arm)
    bodies.place(q)
    return bodies._data.body(link).xpos.copy()


@pytest.mark.slow
def test_joints_keep_a_reserve_that_the_first_path_does_not():
    """Half a degree more than the path leaves on its way, where both ends leave more: it is moved."""
    arm, moved, asked = load_arm("rx60"), 0, 0
    for seed in range(80):
        problem, setting = random_task(arm, np.random.default_rng([9, seed]), obstacles=(0, 1))
        found = plan_with_arm(problem, setting)
        if not found.certified:
            continue
        room = _rooms(setting, found.branch)
        if room[1:-1].min() > min(room[0], room[-1]) - np.deg2rad(2.0):
            continue
        asked += 1
        more = replace(setting, limit_reserve=float(room.min()) + np.deg2rad(0.5))
        better = plan_with_arm(problem, more)
        if better.certified:
            moved += better.attempts == 1  # by the descent, not by another start
            assert_kept(problem, more, better, places=20)
            assert _rooms(more, better.branch).min() >= more.limit_reserve - 1e-9
        if asked == 3:
            break
    assert asked == 3
    assert moved >= 1


def _rooms(setting, branch):
    """The smallest room to the end of a joint's range at places of a branch."""
    q = branch(np.linspace(0.0, 1.0, 101))
    low, high = setting.arm.joint_range.T
    return np.minimum(q - low, high - q).min(axis=1)


@pytest.mark.slow
def test_slopes_of_the_arms_demands_are_finite_differences_of_the_camera_pose():
    """∂g/∂ξ for each group alone: the row that a target just above its g makes active."""
    arm = load_arm("rx60")
    checked = np.zeros(3, dtype=int)
    for seed in range(30):
        problem, setting = random_task(arm, np.random.default_rng([3, seed]), clearance=0.0)
        bodies = setting.bodies(problem.obstacles)
        constraints = JointDemands(setting, bodies, ell=0.4)
        q = setting.start
        least = constraints.pulls(q[None], np.array([0.0, 9.0, 0.3])).least[0]
        camera = setting.arm.base_T_flange(q) * setting.flange_T_camera
        for group in range(3):
            targets = np.full(3, -np.inf)
            targets[group] = least[group] + 1e-7
            pull = constraints.pulls(q[None], targets)
            if pull.costs[0] == 0.0 or (group == 2 and least[2] > 0.25):
                continue
            row = pull.systems[0, :, 6] / 1e-7  # one row a with residual 1e-7
            numeric = np.empty(6)
            for k in range(6):
                values = []
                for sign in (1.0, -1.0):
                    step = sign * 1e-6 * np.eye(6)[k]
                    moved = camera * RigidTransform.from_components(step[:3], Rotation.from_rotvec(step[3:]))
                    there = arm.inverse_near(moved * setting.camera_T_flange, q)
                    values.append(constraints.pulls(there[None], np.array([0.0, 9.0, 0.3])).least[0, group])
                numeric[k] = (values[0] - values[1]) / 2e-6
            scale = max(1.0, np.abs(numeric).max())
            checked[group] += np.abs(row - numeric).max() < 5e-3 * scale
            if group < 2:
                assert np.abs(row - numeric).max() < 5e-3 * scale
    assert (checked >= 5).all()


def test_what_pulls_a_posture_is_the_sum_over_the_rows_below_their_targets():
    """All three groups at once, assembled by NumPy from the claim."""
    arm, active = load_arm("panda"), np.zeros(3, dtype=int)
    for seed in range(12):
        problem, setting = random_task(arm, np.random.default_rng([5, seed]), clearance=0.01)
        bodies, q = setting.bodies(problem.obstacles), setting.start
        targets = np.array([0.9, 0.3, 0.4])
        pull = JointDemands(setting, bodies, ell=0.4).pulls(q[None], targets)
        low, high = setting.arm.joint_range.T + setting.limit_reserve * np.array([[1.0], [-1.0]])
        rows = [(0, q[j] - low[j], np.eye(7)[j]) for j in range(7)]
        rows += [(0, high[j] - q[j], -np.eye(7)[j]) for j in range(7)]

        def value(joints, setting=setting):
            jacobian = arm.scaled_camera_jacobian(joints, setting.flange_T_camera)
            return np.linalg.svd(jacobian, compute_uv=False)[-1] - SINGULAR_VALUE

        slope = np.array([(value(q + s) - value(q - s)) / 2e-6 for s in 1e-6 * np.eye(7)])
        rows.append((1, value(q), slope))
        bodies.place(q)
        asked = bodies.asked(setting.clearance_around, setting.self_clearance)
        rows += [(2, (near.gap - asked[near.pair]) / 0.4, near.slope / 0.4) for near in bodies.near(0.5)]
        to_joints = np.linalg.pinv(arm.camera_jacobian(q, setting.flange_T_camera))
        system, cost, least = np.zeros((6, 7)), 0.0, np.ones(3)
        for group, g, along in rows:
            least[group] = min(least[group], g)
            if (residual := targets[group] - g) > 0.0:
                a = along @ to_joints
                system += np.column_stack([np.outer(a, a), a * residual])
                cost += 0.5 * residual**2
                active[group] += 1
        np.testing.assert_allclose(pull.systems[0], system, rtol=1e-3, atol=1e-4 * np.abs(system).max())
        assert pull.costs[0] == pytest.approx(cost, rel=1e-5)
        np.testing.assert_allclose(pull.least[0, :2], least[:2], atol=1e-9)
        assert min(pull.least[0, 2], 0.4) == pytest.approx(min(least[2], 0.4), abs=1e-6)
    assert (active > 5).all()


def test_the_same_seed_gives_the_same_plan():
    arm = load_arm("rx60")
    problem, setting = random_task(arm, np.random.default_rng(14))
    first, second = plan_with_arm(problem, setting, seed=3), plan_with_arm(problem, setting, seed=3)
    assert first.plan.status == second.plan.status
    if first.plan.path is not None:
        np.testing.assert_array_equal(first.plan.path.rotation, second.plan.path.rotation)


def bent_task():
    """A task in which the arm refuses the first path of the problem's degrees."""
    return random_task(load_arm("panda"), np.random.default_rng([2026, 167]))


def planner_of(problem, setting):
    """The search among paths of the problem's degrees alone."""
    return ArmPlanner(problem, setting, setting.bodies(problem.obstacles), 0, TimeBudget(None))


def test_higher_degrees_solve_what_the_problems_do_not_and_the_plan_states_them():
    problem, setting = bent_task()
    assert planner_of(problem, setting).plan(attempts=1).plan.status == "not_found"
    found = plan_with_arm(problem, setting, attempts=1)
    assert found.attempts > 1
    assert found.plan.path.degrees == (DEGREE, DEGREE)
    assert found.plan.problem.degrees == Degrees(DEGREE, DEGREE)
    assert replace(found.plan.problem, degrees=problem.degrees).to_dict() == problem.to_dict()
    assert verify_plan(found.plan.to_dict()).status == "certified"
    assert_kept(problem, setting, found)


def test_more_starts_solve_what_the_first_do_not():
    problem, setting = bent_task()
    few, more = (planner_of(problem, setting).plan(attempts=attempts) for attempts in (1, 8))
    assert (few.plan.status, few.attempts) == ("not_found", 1)
    assert "none of 1 camera paths" in few.plan.reason
    assert more.certified
    assert 1 < more.attempts <= 8
    with pytest.raises(InputError, match="attempts"):
        plan_with_arm(problem, setting, attempts=0)


def certified_task(seed=0):
    arm = load_arm("rx60")
    for k in range(50):
        problem, setting = random_task(arm, np.random.default_rng([seed, k]))
        if plan_with_arm(problem, setting).certified:
            return problem, setting
    raise AssertionError("none of 50 tasks has a plan")


def test_a_start_that_touches_something_is_named():
    problem, setting = certified_task()
    elbow = setting.base_T_initial.inv().apply(_link_place(setting, "elbow", setting.start))
    found = plan_with_arm(replace(problem, obstacles=(Sphere(elbow, 0.02),)), setting)
    assert found.plan.status == "infeasible"
    assert "the start pose is not free: " in found.plan.reason
    assert "obstacle 0" in found.plan.reason


def test_a_singular_start_is_named():
    """Axes 4 and 6 of the RX60 on one line."""
    problem, setting = certified_task()
    q = np.array([0.1, 0.5, 1.2, 0.0, 0.005, 0.0])
    base_T_initial = setting.arm.base_T_flange(q) * setting.flange_T_camera
    found = plan_with_arm(
        replace(problem, obstacles=()), replace(setting, start=q, base_T_initial=base_T_initial)
    )
    assert found.plan.status == "infeasible"
    assert (
        "the start pose is not free: the arm is singular: smallest singular value 0.00" in found.plan.reason
    )


def test_a_goal_out_of_reach_is_named():
    problem, setting = certified_task()
    far = RigidTransform.from_translation([0.0, 0.0, -3.0])
    found = plan_with_arm(replace(problem, initial_T_goal=far, obstacles=()), setting)
    assert found.plan.status == "infeasible"
    assert "the goal pose cannot be reached: flange pose at" in found.plan.reason


def test_a_goal_among_obstacles_is_named():
    problem, setting = certified_task()
    base_T_goal = setting.base_T_flange(problem.initial_T_goal)
    wrist = (base_T_goal * RigidTransform.from_translation([0.0, 0.0, -0.03])).translation
    ball = Sphere(setting.base_T_initial.inv().apply(wrist), 0.01)
    found = plan_with_arm(replace(problem, obstacles=(ball,), clearance=0.0), setting)
    assert found.plan.status == "infeasible"
    assert "the goal pose is not free in any of" in found.plan.reason


def test_a_start_outside_its_limits_is_refused_with_joint_and_range():
    _, setting = certified_task()
    beyond = setting.start.copy()
    beyond[1] = setting.arm.joint_range[1, 1] - 0.001
    with pytest.raises(InputError, match=r"start: j2 at 127\.44 deg; its range -127\.50 … 127\.50 deg"):
        replace(setting, start=beyond)
    with pytest.raises(InputError, match="start"):
        replace(setting, start=np.full(6, np.nan))
    with pytest.raises(InputError, match="clearance"):
        replace(setting, clearance=-0.1)


def test_for_visual_servoing_joints_keep_three_degrees_or_what_they_have_at_the_start():
    _, setting = certified_task()
    assert setting.limit_reserve == np.radians(1.0)
    assert (
        setting.servoed.limit_reserve == replace(setting, start=None).servoed.limit_reserve == np.radians(3.0)
    )
    more = replace(setting, limit_reserve=np.radians(4.0))
    assert more.servoed.limit_reserve == np.radians(4.0)
    for kept in (2.0, 1.0):
        near = setting.start.copy()
        near[1] = setting.arm.joint_range[1, 1] - np.radians(kept)
        servoed = replace(setting, start=near, limit_reserve=0.0).servoed
        assert servoed.limit_reserve == pytest.approx(np.radians(kept), abs=2e-6)


def test_any_start_is_tried_where_none_is_stated():
    problem, setting = certified_task()
    found = plan_with_arm(problem, replace(setting, start=None))
    assert found.certified
    assert found.branch in found.followed.branches
    assert_kept(problem, replace(setting, start=None), found)


def test_obstacles_become_the_same_bodies_in_the_base_frame():
    """Distances of random points to every obstacle, by its own formula and by MuJoCo's to a tiny ball."""
    random = np.random.default_rng(0)
    base_T_initial = RigidTransform.from_components([0.4, -0.2, 0.6], Rotation.random(rng=random))
    turned = Rotation.random(rng=random).as_quat()
    normal = Rotation.random(rng=random).apply([0.0, 0.0, 1.0])
    obstacles = (
        Sphere(random.normal(size=3), 0.1),
        Box(random.normal(size=3), np.array([0.1, 0.2, 0.3]), turned),
        Capsule(random.normal(size=3), random.normal(size=3), 0.05),
        Cylinder(random.normal(size=3), random.normal(size=3), 0.05),
        Ellipsoid(random.normal(size=3), np.array([0.1, 0.2, 0.3]), turned),
        HalfSpace(normal, 0.1),
        Mesh(random.normal(size=(8, 3)) * 0.3),
    )
    arm, q = load_arm("rx60"), np.array([0.2, 0.4, 0.9, 0.1, 0.8, 0.0])
    for _ in range(20):
        place = random.uniform(-0.8, 0.8, 3)
        tip = arm.base_T_flange(q).inv().apply(base_T_initial.apply(place))
        ball = Solid.sphere("tip", tip, 1e-6)
        bodies = ArmBodies(arm, mounted=[ball], surroundings=solids_of(obstacles, base_T_initial))
        bodies.place(q)
        for i, obstacle in enumerate(obstacles):
            pair = next(k for k in range(len(bodies.pairs)) if bodies.names(k) == ("camera", f"obstacle {i}"))
            expected = obstacle.distance(place[None])[0]
            if expected > 0.01:
                assert bodies.measure(pair) == pytest.approx(expected, abs=1e-4)


def test_what_cannot_be_judged_for_the_whole_arm_is_refused():
    problem, setting = certified_task()
    moving = Sphere(np.ones(3), 0.1, motion=np.array([[0.1, 0.0], [0.0, 0.0], [0.0, 0.0]]))
    with pytest.raises(InputError, match="obstacle 0: it moves"):
        plan_with_arm(replace(problem, obstacles=(moving,)), setting)


@pytest.mark.parametrize("seed", [24, 59, 96])
def test_an_arm_keeps_as_far_from_singular_postures_as_is_asked(seed):
    arm = load_arm("rx60")
    problem, setting = random_task(arm, np.random.default_rng([515, seed]))
    wide = replace(setting, singular_value=REGULAR)

    def least(found):
        postures = found.branch(np.linspace(0.0, 1.0, 401))
        jacobians = [arm.scaled_camera_jacobian(q, setting.flange_T_camera) for q in postures]
        return np.linalg.svd(jacobians, compute_uv=False)[:, -1].min()

    first = planner_of(problem, setting).plan()
    assert first.certified
    assert least(first) < 0.07
    for found in (plan_with_arm(problem, wide), plan_with_arm(problem, setting)):  # asked, or of itself
        assert found.certified, found.plan.reason
        assert least(found) > 0.95 * REGULAR - 2e-3
        assert verify_plan(found.plan.to_dict()).status == "certified"


def test_a_start_that_is_more_singular_than_asked_is_named():
    problem, setting = random_task(load_arm("rx60"), np.random.default_rng([515, 2]))
    assert plan_with_arm(problem, setting).certified
    found = plan_with_arm(problem, replace(setting, singular_value=0.1))
    assert found.plan.status == "infeasible"
    assert "start pose" in found.plan.reason
    assert "smallest singular value 0.0444; at least 0.1" in found.plan.reason


@pytest.mark.parametrize("wrong", [0.01, np.nan])
def test_a_singular_value_that_no_arm_could_be_inverted_at_is_refused(wrong):
    _, setting = random_task(load_arm("rx60"), np.random.default_rng([515, 2]))
    with pytest.raises(InputError, match="singular_value"):
        replace(setting, singular_value=wrong)
