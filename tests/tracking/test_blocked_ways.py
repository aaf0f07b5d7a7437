"""A change counts as answered only once a way is proven for it, whatever was raised in between."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform
from tests.tracking.test_replanner import (
    AWAY,
    CAMERA,
    GOAL,
    LAW,
    PLAN,
    POINTS,
    PROBLEM,
    arm,
    following,
    reference,
)

from omniservo.errors import Blocked, InputError, NotFinite
from omniservo.planning import Sphere, plan_path
from omniservo.tracking import PathTracker, Replanner, ReplanOptions

__all__ = ["arm"]


def ahead_of(tracker, time):
    """A ball where the reference will be so soon that no other way can be taken up before."""
    return Sphere(reference(tracker, time)[0].translation, 0.02)


def test_a_blocked_way_stays_blocked_at_every_later_look():
    tracker, replanner = following()
    replanner.set_obstacles([ahead_of(tracker, 1.05)])
    for time in (1.0, 1.033, 1.066, 1.1):
        with pytest.raises(Blocked, match="obstacles changed"):
            replanner.look(time)
    assert [event.outcome for event in replanner.events] == ["blocked"] * 4
    assert len(tracker.legs) == 1


def test_what_is_gone_next_is_proven_too_though_a_later_part_of_the_way_is_free():
    tracker, replanner = following(options=ReplanOptions(ahead=0.5))
    soon, then = (reference(tracker, time)[0].translation for time in (1.1, 1.4))
    ball = Sphere(soon, 0.2 * float(np.linalg.norm(then - soon)), clearance=1e-4)
    replanner.set_obstacles([ball])
    with pytest.raises(Blocked, match="before another way could be taken up"):
        replanner.look(1.0)


def test_it_stays_blocked_while_other_things_are_said_until_a_way_is_found():
    tracker, replanner = following()
    ball = ahead_of(tracker, 1.05)
    for said in ([ball], [ball, AWAY], [AWAY, ball]):
        replanner.set_obstacles(said)
        with pytest.raises(Blocked):
            replanner.look(1.0)
    farther = Sphere(reference(tracker, 2.2)[0].translation, 0.01)
    replanner.set_obstacles([farther])
    assert replanner.look(1.0).outcome == "replanned"
    assert replanner.look(1.033) is None


def test_the_obstacles_of_the_plan_said_again_open_the_way_again():
    tracker, replanner = following()
    before = replanner.obstacles
    replanner.set_obstacles([ahead_of(tracker, 1.05)])
    with pytest.raises(Blocked):
        replanner.look(1.0)
    replanner.set_obstacles(before)
    assert replanner.look(1.0) is None  # the plan is proven for these
    replanner.set_obstacles([replace(AWAY, radius=0.021)])
    assert replanner.look(1.0).outcome == "kept"


def test_a_better_estimate_for_which_there_is_no_way_stays_unanswered():
    there = GOAL * RigidTransform.from_translation([0.012, 0.0, 0.0])
    pixels, _ = CAMERA.project(there.inv().apply(POINTS))
    tracker = PathTracker(PLAN, CAMERA, time_law=LAW, goal_pixels=pixels)
    replanner = Replanner(tracker, PLAN, options=ReplanOptions(tube=0.01, time_budget=1e-9))
    for time in (0.8, 0.9):
        with pytest.raises(Blocked, match="estimate changed"):
            replanner.look(time)


def test_whatever_is_raised_while_planning_the_change_is_answered_by_the_next_look(arm):
    plan, carried = arm
    broken = []

    def limits(path, joints):
        if broken:
            raise ZeroDivisionError("speeds")
        return carried.limits(path, joints)

    tracker, replanner = following(arm=replace(carried, limits=limits), plan=plan)
    replanner.set_obstacles([Sphere(plan.path(0.6).translation, 0.01)])
    broken.append(True)
    for time in (1.0, 1.033):
        with pytest.raises(ZeroDivisionError):
            replanner.look(time)
    assert len(tracker.legs) == len(replanner.joints) == 1
    broken.clear()
    assert replanner.look(1.066).outcome == "replanned"
    assert replanner.look(1.1) is None


def test_a_way_that_comes_too_late_to_be_taken_up_leaves_the_change_unanswered():
    tracker, replanner = following()
    pixels, seen = CAMERA.project(reference(tracker, 1.2)[0].inv().apply(POINTS))
    replanner.set_obstacles([Sphere(PLAN.path(0.6).translation, 0.01)])
    tracker.step(1.2, pixels, seen)
    with pytest.raises(InputError, match="after what was seen last"):
        replanner.look(1.0)
    assert len(tracker.legs) == len(replanner.joints) == 1
    assert replanner.look(1.2).outcome == "replanned"


def test_an_estimate_that_is_not_finite_is_a_change_that_stops():
    tracker, replanner = following()
    tracker._points = np.full_like(POINTS, np.nan)
    for _ in range(2):
        with pytest.raises(NotFinite, match="estimate"):
            replanner.look(1.0)


@pytest.mark.parametrize("bad", [np.nan, np.inf, 0.999])
def test_a_time_that_is_none_or_runs_backwards_is_refused_even_where_nothing_changed(bad):
    _, replanner = following()
    assert replanner.look(1.0) is None
    with pytest.raises(InputError, match="time"):
        replanner.look(bad)


def test_obstacles_that_are_refused_leave_those_said_before_and_what_they_block():
    tracker, replanner = following()
    ball = ahead_of(tracker, 1.05)
    replanner.set_obstacles([ball])
    with pytest.raises(InputError):
        replanner.set_obstacles([AWAY, "a ball"])
    assert replanner.obstacles == (ball,)
    with pytest.raises(Blocked):
        replanner.look(1.0)


@pytest.mark.parametrize(("shift", "found"), [(0.012, True), (0.016, False)])
def test_where_no_way_keeps_what_the_plan_keeps_one_that_keeps_what_is_required_is_taken(shift, found):
    ball = Sphere(GOAL.translation + np.array([0.055, 0.0, 0.0]), 0.01)  # 45 mm from the goal
    required = replace(PROBLEM, obstacles=(ball,), clearance=0.03)
    plan = plan_path(replace(required, clearance=0.04))
    assert plan.status == "certified"
    there = RigidTransform.from_translation([shift, 0.0, 0.0]) * GOAL
    pixels, _ = CAMERA.project(there.inv().apply(POINTS))
    options = ReplanOptions(tube=0.01)
    tracker = PathTracker(plan, CAMERA, time_law=LAW, goal_pixels=pixels)
    with pytest.raises(Blocked, match="estimate changed"):
        Replanner(tracker, plan, options=options).look(0.8)
    replanner = Replanner(tracker, plan, required=required, options=options)
    if not found:
        with pytest.raises(Blocked, match="estimate changed"):
            replanner.look(0.8)
        return
    event = replanner.look(0.8)
    assert event.outcome == "replanned"
    assert event.problem.clearance == required.clearance
    places = event.legs[-1].path(np.linspace(0.0, 1.0, 500)).translation
    assert 0.03 <= np.linalg.norm(places - ball.center, axis=1).min() - ball.radius < 0.04
    assert replanner.look(0.833) is None
