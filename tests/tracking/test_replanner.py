"""Planning again on the way: nothing jumps, nothing unproven is followed, nothing is done without cause."""

from contextlib import suppress
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from tests.whole_arm.arm_scenes import FLANGE_T_CAMERA

from omniservo.cameras import preset
from omniservo.errors import Blocked, InputError
from omniservo.planning import Box, CameraPath, Degrees, PlanningProblem, Sphere, plan_path
from omniservo.robots import CAMERA_HOUSING, Solid, load_arm
from omniservo.servoing import PathLimits, RestOfLaw, RestToRestLaw, feature_named
from omniservo.tracking import FollowingArm, Leg, PathTracker, Replanner, ReplanOptions
from omniservo.tracking.goal_image import GoalImage
from omniservo.whole_arm import ArmSetting, plan_with_arm

CAMERA = preset("fe185")
POINTS = np.array([[x, y, 0.5 + 0.05 * abs(x)] for x in (-0.08, 0.0, 0.09) for y in (-0.08, 0.0, 0.1)])
GOAL = RigidTransform.from_components([0.2, 0.05, 0.1], Rotation.from_rotvec([0.1, -0.3, 0.2]))
AWAY = Sphere([0.1, 0.4, 0.0], 0.02)
PROBLEM = PlanningProblem(
    CAMERA, POINTS, GOAL, obstacles=(AWAY,), clearance=0.03, degrees=Degrees(2, 2), occlusion=True
)
PLAN = plan_path(PROBLEM)
LAW = RestToRestLaw(4.0)


def following(options=None, arm=None, plan=PLAN):
    """A tracker at the beginning of a plan, and what plans again for it."""
    tracker = PathTracker(plan, CAMERA, time_law=LAW)
    return tracker, Replanner(tracker, plan, arm=arm, options=options)


def reference(tracker, time):
    """Pose and twist per second, of the leg that is followed then."""
    leg = [leg for leg in tracker.legs if leg.time <= time][-1]
    s, speed = leg.law(time)
    return leg.path(s), speed * leg.path(s, 1)


def in_the_way(random, w):
    """A ball that leaves the rest of the first plan's path no room somewhere after w."""
    place = PLAN.path(random.uniform(w + 0.35, min(w + 0.6, 0.85))).translation
    return Sphere(place + random.normal(size=3) * 0.01, random.uniform(0.005, 0.02))


@pytest.fixture(scope="module")
def arm():
    """An RX60 on whose way the same plan lies."""
    rx60 = load_arm("rx60")
    start = np.radians([0.0, 20.0, 110.0, 0.0, 50.0, 0.0])
    setting = ArmSetting(
        rx60,
        rx60.base_T_flange(start) * FLANGE_T_CAMERA,
        FLANGE_T_CAMERA,
        start=start,
        mounted=CAMERA_HOUSING,
        clearance=0.01,
    )
    found = plan_with_arm(PROBLEM, setting)
    assert found.certified

    def limits(path, joints):
        return PathLimits(joints, 0.5 * rx60.joint_speed, 0.5 * rx60.joint_acceleration)

    return found.plan, FollowingArm(setting, found.branch, limits)


def hardly_accelerating(carried):
    """The arm with a twentieth of its accelerations: it cannot turn into another way as fast as it moves."""
    arm = carried.setting.arm
    return replace(
        carried, limits=lambda _, joints: PathLimits(joints, arm.joint_speed, 0.05 * arm.joint_acceleration)
    )


def test_pose_and_twist_of_the_reference_have_no_jump_at_any_time_of_any_change():
    random, taken = np.random.default_rng(5), 0
    for _ in range(25):
        tracker, replanner = following()
        time = random.uniform(0.05, 2.2)
        replanner.set_obstacles([in_the_way(random, LAW(time)[0])])
        try:
            event = replanner.look(time)
        except Blocked:
            continue
        assert event.outcome == "replanned"
        taken += 1
        (before, slow), (after, fast) = (reference(tracker, event.leg.time + d) for d in (-1e-9, 0.0))
        assert (before.inv() * after).as_matrix() == pytest.approx(np.eye(4), abs=1e-8)
        assert fast == pytest.approx(slow, abs=1e-7)
        first, new = tracker.legs
        assert new.w(new.time) == pytest.approx(first.w(new.time), abs=1e-9)
        assert new.w(1e3)[0] == pytest.approx(1.0)
        end = tracker.legs[-1].path(1.0)
        assert (end.inv() * GOAL).as_matrix() == pytest.approx(np.eye(4), abs=1e-8)
    assert taken >= 15


def test_commanded_twist_goes_on_where_another_way_is_taken_up():
    """Images of a camera exactly on its reference: the twist between steps changes by no more than before."""
    tracker, replanner = following()
    random, twists = np.random.default_rng(1), []
    for time in np.arange(0.0, 2.0, 0.02):
        pixels, seen = CAMERA.project(reference(tracker, time)[0].inv().apply(POINTS))
        twists.append(tracker.step(time, pixels, seen))
        assert tracker.report.error_px < 1e-6
        assert twists[-1] == pytest.approx(reference(tracker, time)[1], abs=1e-9)
        if len(twists) == 50:
            replanner.set_obstacles([in_the_way(random, LAW(time)[0])])
        event = replanner.look(time)
        assert (event is not None) == (len(twists) == 50)
    assert len(tracker.legs) == 2
    steps = np.abs(np.diff(twists, axis=0)).max(axis=1)
    assert steps.max() < 0.02


@pytest.mark.parametrize("with_arm", [False, True])
def test_two_looks_after_one_image_leave_no_jump_either(arm, with_arm):
    """The second finds the way that the first has found, to be taken up at the very same time."""
    plan, carried = arm if with_arm else (PLAN, None)
    tracker, replanner = following(arm=carried, plan=plan)
    before = reference(tracker, 1.0 + replanner.options.ahead)
    balls = []
    for _ in range(2):
        balls.append(Sphere(tracker.legs[-1].path(0.6).translation, 0.01))
        replanner.set_obstacles(balls)
        assert replanner.look(1.0).outcome == "replanned"
        pose, twist = reference(tracker, tracker.legs[-1].time)
        assert (before[0].inv() * pose).as_matrix() == pytest.approx(np.eye(4), abs=1e-8)
        assert twist == pytest.approx(before[1], abs=1e-7)
    assert [leg.time for leg in tracker.legs] == pytest.approx([0.0, 1.08, 1.08])
    assert replanner.look(1.03) is None


def test_joints_have_no_jump_and_their_new_way_is_clear(arm):
    plan, carried = arm
    random, taken = np.random.default_rng(2), 0
    for _ in range(8):
        _, replanner = following(arm=carried, plan=plan)
        time = random.uniform(0.3, 1.6)
        replanner.set_obstacles([in_the_way(random, LAW(time)[0])])
        try:
            event = replanner.look(time)
        except Blocked:
            continue
        taken += 1
        before, after = (replanner.posture(event.leg.time + d) for d in (-1e-9, 0.0))
        assert after[0] == pytest.approx(before[0], abs=1e-5)
        assert after[1] == pytest.approx(before[1], abs=1e-4)
        bodies = carried.setting.bodies(replanner.obstacles)
        for late in np.linspace(0.0, 6.0, 40):
            q, speed = replanner.posture(event.leg.time + late)
            bodies.place(q)
            gaps = [near.gap for near in bodies.near(0.05) if bodies.is_around(near.pair)]
            assert min(gaps, default=1.0) >= 0.01 - 1e-9
            assert (np.abs(speed) <= 0.501 * carried.setting.arm.joint_speed).all()
    assert taken >= 4


def test_nothing_is_planned_where_nothing_changed():
    tracker, replanner = following()
    assert all(replanner.look(time) is None for time in (0.0, 0.5, 3.9))
    assert replanner.events == []
    assert len(tracker.legs) == 1


def test_the_same_obstacles_said_again_are_no_change():
    _, replanner = following()
    replanner.set_obstacles(list(replanner.obstacles))
    assert replanner.look(1.0) is None


def test_a_way_entered_too_fast_for_its_bend_is_taken_up_after_the_old_one_was_slowed_down(arm):
    """Speeds are no matter here, accelerations are: the bend costs q″ṡ², which slower is affordable."""
    plan, carried = arm
    rx60, random, slowed = carried.setting.arm, np.random.default_rng(3), 0

    def limits(path, joints):
        return PathLimits(joints, rx60.joint_speed, 0.05 * rx60.joint_acceleration)

    for _ in range(12):
        tracker, replanner = following(arm=replace(carried, limits=limits), plan=plan)
        time = random.uniform(0.8, 1.6)
        replanner.set_obstacles([in_the_way(random, LAW(time)[0])])
        try:
            event = replanner.look(time)
        except Blocked:
            continue
        assert tracker.legs[1:] == event.legs
        slowed += len(event.legs) == 2
        for before, after in pairwise(tracker.legs):
            (there, slow), (here, fast) = (
                (leg.path(s), speed * leg.path(s, 1))
                for leg in (before, after)
                for s, speed in [leg.law(after.time)]
            )
            assert (there.inv() * here).as_matrix() == pytest.approx(np.eye(4), abs=1e-8)
            assert fast == pytest.approx(slow, abs=1e-7)
        for leg, joints in zip(event.legs, event.joints, strict=True):
            assert leg.law.keeps(limits(leg.path, joints))
    assert slowed >= 1


@pytest.mark.parametrize("later", [0.033, 0.1, 0.2])
def test_what_changes_while_the_old_way_is_slowed_down_is_answered_from_where_the_new_one_begins(arm, later):
    tracker, replanner = following(arm=hardly_accelerating(arm[1]), plan=arm[0])
    first = Sphere(PLAN.path(0.65).translation + np.array([0.0, 0.004, 0.0]), 0.02)
    replanner.set_obstacles([first])
    event = replanner.look(1.4)
    assert len(event.legs) == 2
    ball = Sphere(event.leg.path(0.6).translation, 0.005)
    replanner.set_obstacles([first, ball])
    again = replanner.look(1.4 + later)
    assert (again.outcome, again.leg.time) == ("replanned", pytest.approx(event.leg.time))
    (before, slow), (after, fast) = (reference(tracker, again.leg.time + d) for d in (-1e-9, 0.0))
    assert (before.inv() * after).as_matrix() == pytest.approx(np.eye(4), abs=1e-8)
    assert fast == pytest.approx(slow, abs=1e-7)
    ways = again.leg.path.positions(np.linspace(0.0, 1.0, 200))
    assert min(other.distance(ways).min() for other in (first, ball)) >= 0.03


def test_the_old_way_is_not_slowed_down_on_past_something_that_leaves_it_no_room(arm):
    """A ball beside the middle of that part: its beginning and its end keep what is required."""
    plan, carried = arm[0], hardly_accelerating(arm[1])
    first = Sphere(PLAN.path(0.65).translation + np.array([0.0, 0.004, 0.0]), 0.02)
    _, replanner = following(arm=carried, plan=plan)
    replanner.set_obstacles([first])
    slow, _ = replanner.look(1.4).legs
    s = 0.6 * slow.law(slow.time + 0.3)[0]
    way = np.diff(slow.path.positions(np.array([s - 1e-3, s])), axis=0)[0]
    beside = np.cross(way, [0.0, 0.0, 1.0])
    aside = Rotation.from_rotvec(4.0 * way / np.linalg.norm(way)).apply(beside / np.linalg.norm(beside))
    ball = Sphere(slow.path(s).translation + 0.0348 * aside, 0.005)
    _, again = following(arm=carried, plan=plan)
    again.set_obstacles([first, ball])
    with pytest.raises(Blocked, match="the joints cannot turn into the way found as fast"):
        again.look(1.4)


def test_a_way_is_kept_only_if_all_of_it_is_proven_up_to_the_goal():
    """A ball beside the last twentieth of the way alone."""
    place, way = PLAN.path(0.95).translation, PLAN.path(0.95, 1)[:3]
    beside = np.cross(PLAN.path(0.95).rotation.apply(way), [0.0, 0.0, 1.0])
    ball = Sphere(place + 0.0349 * beside / np.linalg.norm(beside), 0.005)
    line = np.linspace(0.0, 1.0, 401)
    near = line[ball.distance(PLAN.path.positions(line)) < 0.03]
    assert 0.9 < near.min() < near.max() < 1.0
    _, replanner = following()
    replanner.set_obstacles([AWAY, ball])
    with suppress(Blocked):
        replanner.look(1.0)
    assert replanner.events[-1].outcome != "kept"


def test_what_is_required_alone_is_judged_among_the_obstacles_of_now():
    tracker = PathTracker(PLAN, CAMERA, time_law=LAW)
    replanner = Replanner(tracker, PLAN, required=replace(PROBLEM, clearance=0.02))
    replanner.set_obstacles([AWAY, Sphere(GOAL.translation, 0.01)])
    with pytest.raises(Blocked, match="goal pose"):
        replanner.look(1.0)
    assert len(tracker.legs) == 1


def test_a_way_that_is_still_proven_is_kept():
    tracker, replanner = following()
    replanner.set_obstacles([replace(AWAY, radius=0.03)])
    assert replanner.look(1.0).outcome == "kept"
    assert replanner.look(1.1) is None
    assert len(tracker.legs) == 1


def test_what_was_said_last_is_what_camera_and_arm_are_judged_among(arm):
    plan, carried = arm
    tracker, replanner = following(arm=carried, plan=plan)
    setting, random = carried.setting, np.random.default_rng(4)
    replanner.set_obstacles([in_the_way(random, LAW(1.0)[0])])
    replanner.set_obstacles([replace(AWAY, radius=0.021)])
    assert replanner.look(1.0).outcome == "kept"
    replanner.set_obstacles([replace(AWAY, radius=0.021), AWAY])
    assert replanner.look(1.03).outcome == "kept"
    bodies = setting.bodies(())
    forearm = bodies.corners(carried.joints(0.8))[bodies.shapes_of("forearm")].mean(axis=(0, 1))
    ball = Sphere(setting.base_T_initial.inv().apply(forearm), 0.02)
    assert replanner.look(1.06) is None
    assert ball.distance(plan.path.positions(np.linspace(0.0, 1.0, 50))).min() > 0.03
    replanner.set_obstacles([AWAY, ball])
    with pytest.raises(Blocked, match="forearm and obstacle 1 overlap"):
        replanner.look(1.09)
    assert len(tracker.legs) == 1


def test_obstacles_said_before_a_better_estimate_and_after_it_all_count():
    there = GOAL * RigidTransform.from_translation([0.012, 0.0, 0.0])
    pixels, _ = CAMERA.project(there.inv().apply(POINTS))
    tracker = PathTracker(PLAN, CAMERA, time_law=LAW, goal_pixels=pixels)
    replanner = Replanner(tracker, PLAN, options=ReplanOptions(tube=0.01))
    ball = in_the_way(np.random.default_rng(4), 0.1)
    replanner.set_obstacles([AWAY, ball])
    first = replanner.look(0.8)
    assert (first.cause, first.outcome) == ("obstacles", "replanned")
    again = Sphere(first.leg.path(0.5).translation, 0.005)
    replanner.set_obstacles([AWAY, ball, again])
    second = replanner.look(0.9)
    assert (second.cause, second.outcome) == ("obstacles", "replanned")
    assert second.problem.obstacles == (AWAY, ball, again)
    for event in (first, second):
        np.testing.assert_allclose(event.problem.initial_T_goal.translation, there.translation, atol=1e-6)
        assert (event.leg.path(1.0).inv() * there).as_matrix() == pytest.approx(np.eye(4), abs=1e-6)


@pytest.mark.parametrize(("aside", "outcome"), [(1.0, "kept"), (0.0, "blocked")])
def test_a_way_on_which_something_hides_the_target_is_not_kept(arm, aside, outcome):
    """A plate between camera and points, or beside them."""
    plan, carried = arm
    base_T_plate = carried.setting.base_T_initial * RigidTransform.from_translation([aside, 0.0, 0.4])
    plate = Solid.box("plate", base_T_plate, [0.3, 0.3, 0.005])
    setting = replace(carried.setting, surroundings=(plate,))
    _, replanner = following(arm=replace(carried, setting=setting), plan=plan)
    replanner.set_obstacles([Sphere([0.0, 0.6, 0.0], 0.02)])
    if outcome == "kept":
        assert replanner.look(1.0).outcome == "kept"
        return
    with pytest.raises(Blocked, match="not clear"):
        replanner.look(1.0)


def test_what_lies_behind_does_not_matter():
    _, replanner = following()
    replanner.set_obstacles([Sphere(PLAN.path(0.05).translation, 0.001, clearance=0.02)])
    assert replanner.look(2.0).outcome == "kept"


def test_a_second_change_before_the_first_way_is_taken_up_is_answered_from_there():
    tracker, replanner = following(ReplanOptions(ahead=0.2))
    random = np.random.default_rng(4)
    replanner.set_obstacles([in_the_way(random, 0.1)])
    first = replanner.look(0.8)
    replanner.set_obstacles([*replanner.obstacles, Sphere(first.leg.path(0.6).translation, 0.005)])
    second = replanner.look(0.85)
    assert (first.outcome, second.outcome) == ("replanned", "replanned")
    for leg in (first.leg, second.leg):
        (before, slow), (after, fast) = (reference(tracker, leg.time + d) for d in (-1e-9, 0.0))
        assert (before.inv() * after).as_matrix() == pytest.approx(np.eye(4), abs=1e-8)
        assert fast == pytest.approx(slow, abs=1e-7)


@pytest.mark.parametrize(
    ("obstacle", "words"),
    [
        (Sphere(PLAN.path(LAW(1.04)[0]).translation, 0.01), "what is gone before another way could be"),
        (Box([0.1, 0.0, 0.05], [0.002, 2.0, 2.0], [0, 0, 0, 1]), "violates occlusion obstacle 0"),
        (Sphere(GOAL.translation, 0.01), "goal pose"),
    ],
)
def test_where_no_way_on_is_proven_the_servo_is_stopped_with_the_reason(obstacle, words):
    _, replanner = following()
    replanner.set_obstacles([obstacle])
    with pytest.raises(Blocked, match=f"^obstacles changed at 1.000 s and no way on is proven: .*{words}"):
        replanner.look(1.0)
    assert replanner.events[-1].outcome == "blocked"
    assert replanner.events[-1].leg is None


def test_a_plan_that_comes_too_late_is_not_followed():
    tracker, replanner = following(ReplanOptions(time_budget=1e-9))
    replanner.set_obstacles([in_the_way(np.random.default_rng(4), 0.1)])
    with pytest.raises(Blocked, match="planning took longer than 1e-09 s"):
        replanner.look(0.8)
    assert len(tracker.legs) == 1


@pytest.mark.parametrize("time", [0.8, 2.6])
def test_an_estimate_that_leaves_its_tube_is_planned_for_again(time):
    """The goal image turns out to be 12 mm from where the plan ends; the twist does not jump either."""
    tracker, replanner = following(ReplanOptions(tube=0.01))
    there = GOAL * RigidTransform.from_translation([0.012, 0.0, 0.0])
    pixels, _ = CAMERA.project(there.inv().apply(POINTS))
    tracker = PathTracker(PLAN, CAMERA, time_law=LAW, goal_pixels=pixels)
    replanner = Replanner(tracker, PLAN, options=ReplanOptions(tube=0.01))
    assert replanner.change == pytest.approx(0.012, abs=1e-4)
    assert np.abs(tracker.goal.offsets).max() > 1e-3
    event = replanner.look(time)
    assert (event.cause, event.outcome) == ("estimate", "replanned")
    assert (tracker.legs[-1].path(1.0).inv() * there).as_matrix() == pytest.approx(np.eye(4), abs=1e-6)
    assert replanner.look(time + 0.03) is None
    assert np.abs(tracker.goal.offsets).max() < 1e-6
    again = GoalImage.of(CAMERA, feature_named("bearing"), event.leg.path, POINTS, pixels)
    assert tracker.goal.pose == pytest.approx(again.pose, abs=1e-9)
    seen = [tracker.predict(event.leg.time + d)[0] for d in (-1e-7, 0.0)]
    assert seen[0] == pytest.approx(seen[1], abs=1e-3)


def test_an_estimate_that_leaves_its_tube_only_later_is_noticed_then():
    """What was judged of one estimate is not said of the next: noisy images move points and goal."""
    random, tube, times = np.random.default_rng(0), 0.05, np.arange(0.0, 1.0, 0.02)
    truly = POINTS + random.normal(size=POINTS.shape) * 0.002

    def seen(pose, sigma):
        return CAMERA.project(pose.inv().apply(truly))[0] + random.normal(size=(len(POINTS), 2)) * sigma

    goal, initial = seen(GOAL, 0.5), seen(RigidTransform.identity(), 0.5)
    tracker = PathTracker(PLAN, CAMERA, time_law=LAW, goal_pixels=goal, initial_pixels=initial)
    replanner = Replanner(tracker, PLAN, options=ReplanOptions(tube=tube))
    for time in times:
        tracker.step(time, seen(reference(tracker, time)[0], 0.3), np.ones(len(POINTS), dtype=bool))
        if replanner.change > tube:
            break
        assert replanner.look(time) is None
    assert times[0] < time < times[-1]
    event = replanner.look(time)
    assert (event.cause, event.outcome) == ("estimate", "replanned")


def test_a_leg_that_does_not_go_on_from_here_is_refused():
    tracker, _ = following()
    s, _ = LAW(1.0)
    rest = PLAN.path.part(s, 1.0)
    with pytest.raises(InputError, match="it does not go on"):
        tracker.take_up(Leg(rest, RestToRestLaw(3.0), 1.0, s))
    with pytest.raises(InputError, match="it does not go on"):
        aside = CameraPath(rest.rotation, rest.translation + np.eye(3, rest.translation.shape[1])[:, ::-1])
        tracker.take_up(Leg(aside, RestOfLaw(LAW, 1.0), 1.0, s))
    tracker.take_up(Leg(rest, RestOfLaw(LAW, 1.0), 1.0, s))
    with pytest.raises(InputError, match="after what was seen last"):
        tracker.take_up(Leg(rest, RestOfLaw(LAW, 0.5), 0.5, s))


def test_what_cannot_be_planned_with_is_refused():
    tracker, replanner = following()
    with pytest.raises(InputError, match=r"obstacles\[0\]: motion given"):
        replanner.set_obstacles([replace(AWAY, motion=np.ones((3, 2)))])
    with pytest.raises(InputError, match=r"obstacles\[0\]: str given"):
        replanner.set_obstacles(["a ball"])
    assert replanner.obstacles == (AWAY,)
    with pytest.raises(InputError, match="no arm was given"):
        replanner.posture(1.0)
    for bad in ({"ahead": 0.0}, {"tube": np.nan}, {"time_budget": -1.0}, {"seed": -1}):
        with pytest.raises(InputError, match=next(iter(bad))):
            ReplanOptions(**bad)
    with pytest.raises(InputError, match="without a path"):
        Replanner(tracker, replace(PLAN, path=None))
