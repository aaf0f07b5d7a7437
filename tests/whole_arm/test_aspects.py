"""No plan leads through a singularity: what lies beyond one is refused at once, and with its name."""

import re
from copy import copy
from dataclasses import replace

import numpy as np
import pytest
from tests.whole_arm.arm_scenes import FLANGE_T_CAMERA, random_task

from omniservo.planning import plan_path
from omniservo.planning.time_budget import TimeBudget
from omniservo.robots import load_arm
from omniservo.robots.aspect import SINGULARITIES, aspects_of, determinant_factors
from omniservo.whole_arm import plan_with_arm
from omniservo.whole_arm.arm_ends import free_postures, violation_at_goal
from omniservo.whole_arm.arm_planner import ArmPlanner

CLOSED_FORM = ("rx60", "ur5e")


@pytest.mark.parametrize("name", CLOSED_FORM)
def test_the_determinant_is_the_product_of_the_factors_but_for_its_sign(name):
    arm, random = load_arm(name), np.random.default_rng(5)
    postures = random.uniform(*arm.joint_range.T, (300, 6))
    products = np.prod(determinant_factors(arm, postures), axis=1)
    shares = [np.linalg.det(arm.flange_jacobian(q)) for q in postures] / products
    np.testing.assert_allclose(shares, np.sign(shares[0]), rtol=1e-9)


@pytest.mark.parametrize("name", CLOSED_FORM)
def test_the_branches_of_a_pose_lie_in_aspects_of_their_own(name):
    arm, random, eight = load_arm(name), np.random.default_rng(6), 0
    for q in random.uniform(-1.0, 1.0, (40, 6)):
        aspects = aspects_of(arm, arm.branches(arm.base_T_flange(q)))
        assert len(np.unique(aspects, axis=0)) == len(aspects)
        eight += len(aspects) == 8
    assert eight >= 5


def test_arms_without_a_closed_form_have_the_sign_of_the_determinant_or_none():
    ur5e, panda = load_arm("ur5e"), load_arm("panda")
    assert aspects_of(panda, panda.joint_range.mean(axis=1)[None]).shape == (1, 0)
    postures = np.array([[0.3, -1.2, 1.1, -0.8, -1.4, 0.2], [0.5, -1.0, 0.7, -0.4, 1.2, 0.0]])
    tilted = copy(ur5e)
    tilted._geometry = None  # as of a calibrated arm, whose axes miss the form
    signs = aspects_of(tilted, postures)
    assert signs.shape == (2, 1)
    assert signs[0] == -signs[1]
    np.testing.assert_array_equal(signs[0] * signs[1], np.prod(aspects_of(ur5e, postures)))


@pytest.fixture(scope="module")
def beyond():
    """Tasks whose camera path is proven, and whose goal the arm comes to through a singularity only."""
    found = []
    for name, seed in (("ur5e", 8), ("ur5e", 11), ("rx60", 32), ("rx60", 43)):
        problem, setting = random_task(load_arm(name), np.random.default_rng([2026, seed]))
        assert plan_path(problem).status == "certified"
        found.append((problem, setting, plan_with_arm(problem, setting)))
    return found


def test_a_goal_beyond_a_singularity_is_refused_and_the_singularity_named(beyond):
    for problem, setting, refused in beyond:
        arm, bodies = setting.arm, setting.bodies(problem.obstacles)
        assert refused.plan.status == "infeasible"
        assert refused.attempts == 0
        named = re.search(r"beyond a singularity \(([a-z, ]+)\)", refused.plan.reason)[1].split(", ")
        here = aspects_of(arm, setting.start[None])[0]
        free = free_postures(problem, replace(setting, start=None), bodies)
        passed = [list(np.array(SINGULARITIES)[signs != here]) for signs in aspects_of(arm, free)]
        assert named in passed
        assert min(map(len, passed)) == len(named)
        assert not len(free_postures(problem, setting, bodies))


def test_the_search_finds_nothing_where_the_goal_is_beyond_a_singularity(beyond):
    for problem, setting, _ in beyond[:2]:
        bodies = setting.bodies(problem.obstacles)
        planner = ArmPlanner(problem, setting, bodies, 0, TimeBudget(None))
        assert planner.plan(attempts=4).plan.status == "not_found"


def test_a_goal_is_judged_in_that_full_turn_that_keeps_the_reserve():
    """A joint at 1 degree is also at -359, where it would be too near to the end of its range."""
    arm = load_arm("ur5e")
    problem, setting = random_task(arm, np.random.default_rng([2026, 3]), obstacles=(0, 1))
    start = np.array([0.3, -1.2, 1.1, -0.8, -1.4, 0.2])
    end = start.copy()
    end[5] = np.radians(1.0)
    here = arm.base_T_flange(start) * FLANGE_T_CAMERA
    there = here.inv() * arm.base_T_flange(end) * FLANGE_T_CAMERA
    turned = replace(problem, initial_T_goal=there, obstacles=())
    stands = replace(setting, base_T_initial=here, start=start, limit_reserve=np.radians(3.0))
    assert violation_at_goal(turned, stands, stands.bodies(())) == ""
