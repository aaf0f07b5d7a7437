"""Where sight is asked for, no plan for a whole arm lets a link stand between camera and target."""

import re
from dataclasses import replace

import numpy as np
import pytest
from tests.planning.arm_scenes import random_task

from omniservo.planning import plan_with_arm, replan_with_arm
from omniservo.planning.with_arm.judged_branch import judged_branch
from omniservo.robots import load_arm, own_sight, shipped_tube


def task(name, seed):
    return random_task(load_arm(name), np.random.default_rng([7, seed]), obstacles=(0, 1))


def sight_of(problem, setting, branch):
    points = setting.base_T_initial.apply(problem.points)
    return own_sight(setting.arm, branch, setting.flange_T_camera, points)


@pytest.fixture(scope="module")
def hidden():
    """A task whose first plan leads a link through a line of sight, and that plan."""
    problem, setting = task("ur5e", 13)
    found = plan_with_arm(problem, setting)
    assert found.certified
    assert sight_of(problem, setting, found.branch).status == "hidden"
    return problem, setting, found


def test_another_way_is_taken_where_a_link_hides_a_point_on_the_first(hidden):
    problem, setting, found = hidden
    asked = replace(problem, occlusion=True)
    other = plan_with_arm(asked, setting)
    assert other.certified
    assert other.attempts > found.attempts
    assert sight_of(problem, setting, other.branch).status == "free"


def test_a_branch_is_judged_by_sight_only_where_points_are_named(hidden):
    problem, setting, found = hidden
    bodies = setting.bodies(problem.obstacles)
    points = setting.base_T_initial.apply(problem.points)
    assert judged_branch(setting, bodies, found.branch).reason == ""
    judged = judged_branch(setting, bodies, found.branch, points)
    assert re.match(r"the arm hides its own target: upper_arm .* the line of sight to point 3", judged.reason)
    assert judged.w == pytest.approx(0.468, abs=0.05)


def test_a_start_that_hides_a_point_is_refused_at_once():
    problem, setting = task("panda", 24)
    assert plan_with_arm(problem, setting).certified
    found = plan_with_arm(replace(problem, occlusion=True), setting)
    assert found.plan.status == "infeasible"
    assert re.match(
        r"the start pose is not free: link2 stands [\d.]+ mm into the line of sight to point 8$",
        found.plan.reason,
    )


def test_replanning_keeps_sight_as_well(hidden):
    problem, setting, found = hidden
    asked = replace(problem, occlusion=True)
    rest = replan_with_arm(found.plan, found.branch, 0.2, asked, setting)
    assert rest.certified
    assert sight_of(problem, setting, rest.branch).status == "free"
    as_it_was = replan_with_arm(found.plan, found.branch, 0.2, problem, setting)
    assert as_it_was.certified
    assert sight_of(problem, setting, as_it_was.branch).status == "hidden"


def test_links_keep_off_lines_of_sight_what_they_and_the_camera_stray(hidden):
    problem, setting, _ = hidden
    asked = replace(problem, occlusion=True)
    tube = shipped_tube("ur5e").at(0.01)
    careful = replace(setting, tube=tube)
    assert careful.kept_from_sight["upper_arm"] == tube.links["upper_arm"] + tube.position
    found = plan_with_arm(asked, careful)
    assert found.certified
    points = setting.base_T_initial.apply(problem.points)
    kept = {link: stray for link, stray in careful.kept_from_sight.items() if "&" not in link}
    assert own_sight(setting.arm, found.branch, setting.flange_T_camera, points, kept=kept).status == "free"
    near = plan_with_arm(asked, setting)
    close = own_sight(setting.arm, near.branch, setting.flange_T_camera, points, kept=kept)
    judged = judged_branch(careful, careful.bodies(asked.obstacles), near.branch, points)
    assert close.status == "hidden"
    assert judged.reason
    loose = replace(setting, tube=replace(tube, position=0.3))
    refused = plan_with_arm(asked, loose).plan
    assert refused.status == "infeasible"
    assert re.match(
        r"the start pose is not free: .* mm are kept from it for what a run strays", refused.reason
    )
