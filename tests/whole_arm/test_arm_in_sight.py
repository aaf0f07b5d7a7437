"""Where sight is asked for, no plan lets the arm or its surroundings stand between camera and target."""

import copy
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from tests.whole_arm.arm_scenes import FLANGE_T_CAMERA, random_task

from omniservo import cameras
from omniservo.planning import PlanningProblem
from omniservo.planning.time_budget import TimeBudget
from omniservo.replanning import replan_with_arm
from omniservo.risk import plan_links_at_risk
from omniservo.robots import CAMERA_HOUSING, MountedCamera, Solid, load_arm, own_sight, shipped_tube
from omniservo.whole_arm import ArmSetting, plan_with_arm
from omniservo.whole_arm.arm_planner import ArmPlanner
from omniservo.whole_arm.judged_branch import judged_branch


def task(name, seed):
    return random_task(load_arm(name), np.random.default_rng([7, seed]), obstacles=(0, 1))


def sight_of(problem, setting, branch):
    points = setting.base_T_initial.apply(problem.points)
    return own_sight(setting.arm, branch, camera_of(setting), points)


def camera_of(setting):
    return MountedCamera(setting.flange_T_camera, setting.mounted)


@pytest.fixture(scope="module")
def hidden():
    """A task in which the first path that the arm can follow leads a link through a line of sight."""
    problem, setting = task("ur5e", 13)
    bodies = setting.bodies(problem.obstacles)
    found = ArmPlanner(problem, setting, bodies, 0, TimeBudget(None)).plan()
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
    assert re.match(r"a point is hidden: upper_arm .* the line of sight to point 3", judged.reason)
    assert judged.w == pytest.approx(0.468, abs=0.05)


def test_what_a_setting_was_made_from_may_be_lists_and_change_afterwards():
    problem, setting = task("ur5e", 13)
    mounted, around = list(setting.mounted), [Solid.sphere("ball", [0.0, 0.0, 3.0], 0.1)]
    listed = replace(setting, mounted=mounted, surroundings=around)
    mounted.clear()
    around.clear()
    assert (listed.mounted, len(listed.surroundings)) == (setting.mounted, 1)
    points = setting.base_T_initial.apply(problem.points)
    assert listed.own_sight_in(setting.start, points) == setting.own_sight_in(setting.start, points)
    assert not copy.deepcopy(listed).start.flags.writeable


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
    found = plan_with_arm(asked, careful)
    assert found.certified
    points = setting.base_T_initial.apply(problem.points)
    links = {link: stray for link, stray in tube.links.items() if "&" not in link}
    straying = {"kept": links, "camera_strays": tube.position}
    camera = camera_of(setting)
    assert own_sight(setting.arm, found.branch, camera, points, **straying).status == "free"
    loose = replace(setting, tube=replace(tube, position=0.3))
    refused = plan_with_arm(asked, loose).plan
    assert refused.status == "infeasible"
    assert re.match(
        r"the start pose is not free: .* mm are kept from it for what a run strays", refused.reason
    )


AHEAD = np.radians([0.0, 20.0, 110.0, 0.0, 50.0, 0.0])
GRID = np.array([[x, y, 0.5] for x in (-0.08, 0.0, 0.08) for y in (-0.08, 0.0, 0.08)])
ASIDE = RigidTransform.from_components([0.15, 0.05, 0.1], Rotation.from_rotvec([0.1, -0.3, 0.2]))


def looking(q=AHEAD, points=GRID, goal=ASIDE, around=()):
    """An RX60 that looks at points with nothing in between, if it is not in what stands ``around``.

    Points, goal and bodies are stated in the initial camera frame.
    """
    arm = load_arm("rx60")
    base_T_initial = arm.base_T_flange(q) * FLANGE_T_CAMERA
    problem = PlanningProblem(cameras.preset("fe185"), points, goal, occlusion=True)
    setting = ArmSetting(
        arm,
        base_T_initial,
        FLANGE_T_CAMERA,
        start=q,
        mounted=CAMERA_HOUSING,
        surroundings=tuple(solid.moved(base_T_initial) for solid in around),
        clearance=0.01,
    )
    return problem, setting


def test_the_arms_own_base_hides_what_is_behind_it():
    """A camera low beside the base looks at points behind it."""
    q = np.radians([6.0, 66.0, 71.0, 5.0, 100.0, -57.0])
    camera = load_arm("rx60").base_T_flange(q) * FLANGE_T_CAMERA
    behind = [[-0.45, y, z] for y in (-0.03, 0.0, 0.03) for z in (0.12, 0.2)]
    goal = RigidTransform.from_translation(camera.rotation.inv().apply([0.03, 0.02, 0.03]))
    problem, setting = looking(q, camera.inv().apply(behind), goal)
    assert plan_with_arm(replace(problem, occlusion=False), setting).certified
    found = plan_with_arm(problem, setting).plan
    assert found.status == "infeasible"
    assert re.match(
        r"the start pose is not free: base stands \d\d\.\d+ mm into the line of sight", found.reason
    )


def plate(z, half=(0.3, 0.3, 0.005), center=(0.0, 0.0)):
    return Solid.box("plate", RigidTransform.from_translation([*center, z]), half)


def test_what_stands_around_hides_what_is_behind_it():
    problem, setting = looking(around=[plate(0.4)])
    assert plan_with_arm(replace(problem, occlusion=False), setting).certified
    found = plan_with_arm(problem, setting).plan
    assert found.status == "infeasible"
    assert "plate" in found.reason
    only_goal, setting = looking(around=[plate(0.35, (0.01, 0.01, 0.01), (0.095, 0.06))])
    assert judged_at(setting, only_goal, AHEAD) == ""
    found = plan_with_arm(only_goal, setting).plan
    assert found.status == "infeasible"
    assert re.match(
        r"the goal pose is not free in any of \d+ joint configurations: plate .* line of sight", found.reason
    )


def judged_at(setting, problem, q):
    return setting.own_sight_in(q, setting.points_in_sight(problem)).what


def test_what_hides_a_point_on_the_way_only_is_gone_round_or_named():
    problem, setting = looking()
    first = plan_with_arm(problem, setting)
    seen_from = first.plan.path(0.5)
    between = 0.5 * (seen_from.translation + GRID[4])
    ball = Solid.sphere("ball", between, 0.004)
    problem, setting = looking(around=[ball])
    assert [judged_at(setting, problem, q) for q in first.branch.positions[[0, -1]]] == ["", ""]
    judged = judged_branch(setting, setting.bodies(()), first.branch, setting.points_in_sight(problem))
    assert re.match(r"a point is hidden: ball stands .* point 4 at w = 0\.\d+", judged.reason)
    found = plan_with_arm(problem, setting)
    if found.certified:
        assert setting.own_sight(found.branch, setting.points_in_sight(problem)).status == "free"
    else:
        assert "ball" in found.plan.reason
    rest = replan_with_arm(first.plan, first.branch, 0.1, problem, setting)
    if rest.certified:
        assert setting.own_sight(rest.branch, setting.points_in_sight(problem)).status == "free"
    else:
        assert "ball" in rest.plan.reason


@pytest.mark.parametrize("with_tube", [False, True])
def test_what_carries_the_target_and_what_is_behind_it_hide_nothing(with_tube):
    table = [plate(0.505), Solid.box("wall", RigidTransform.from_translation([0, 0, 0.8]), [1, 1, 0.1])]
    problem, setting = looking(around=table)
    if with_tube:
        setting = replace(setting, tube=shipped_tube("rx60").at(0.01))
    assert plan_with_arm(problem, setting).certified


def test_what_stands_around_is_kept_off_by_what_the_camera_strays():
    """A bar that leaves 4 mm of a line of sight half way: a camera that strays 10 mm may not see past it."""
    bar = plate(0.25, (0.01, 0.3, 0.01), (-0.04 - 0.004 - 0.01, 0.0))
    problem, setting = looking(around=[bar])
    assert judged_at(setting, problem, AHEAD) == ""
    tube = replace(shipped_tube("rx60").at(0.01), position=0.01)
    strays = replace(setting, tube=tube)
    assert re.match(r"plate comes within \d\.\d+ mm of the line", judged_at(strays, problem, AHEAD))
    assert plan_with_arm(problem, strays).plan.status == "infeasible"


def bracket(center, half):
    return Solid.box("bracket", RigidTransform.from_translation(center), half)


def test_a_mounted_body_before_the_camera_hides_all_points_and_one_beside_none():
    """In planning, replanning and at a stated risk; where no sight is asked for it may."""
    problem, setting = looking()
    first = plan_with_arm(problem, setting)
    assert first.certified
    for body, hides in (
        (bracket([0.0, 0.0, 0.1], [0.05, 0.05, 0.002]), True),
        (bracket([0.1, 0.0, 0.05], [0.02, 0.02, 0.002]), False),
    ):
        carrying = replace(setting, mounted=(*CAMERA_HOUSING, body))
        plans = [
            plan_with_arm(problem, carrying),
            replan_with_arm(first.plan, first.branch, 0.3, problem, carrying),
            plan_links_at_risk(problem, carrying, 0.05)[0],
        ]
        assert [found.certified for found in plans] == [not hides] * 3
        blind = replace(problem, occlusion=False)
        assert plan_with_arm(blind, carrying).certified
        for found in plans if hides else ():
            assert found.plan.status == "infeasible"
            assert re.match(
                r"the start pose is not free: bracket stands [\d.]+ mm into the line of sight to point \d$",
                found.plan.reason,
            )


def test_a_mounted_body_that_hides_a_point_in_the_goal_image_or_on_the_way_is_named():
    problem, setting = looking()
    first = plan_with_arm(problem, setting)
    for w, pattern in (
        (
            1.0,
            r"the goal pose is not free in any of \d+ joint .*: bracket stands .* line of sight to point 8",
        ),
        (0.5, r"a point is hidden: bracket stands .* point 8 at w = 0\.\d+"),
    ):
        seen = first.plan.path(w).inv().apply(GRID[8])
        carrying = replace(setting, mounted=(*CAMERA_HOUSING, bracket(0.3 * seen, [0.001] * 3)))
        points = carrying.points_in_sight(problem)
        judged = judged_branch(carrying, carrying.bodies(()), first.branch, points)
        assert re.match(r"a point is hidden: bracket .* point 8", judged.reason)
        found = plan_with_arm(problem, carrying)
        assert w < 1.0 or re.match(pattern, found.plan.reason)
        assert w == 1.0 or re.match(pattern, judged.reason)
        if found.certified:
            assert carrying.own_sight(found.branch, points).status == "free"
