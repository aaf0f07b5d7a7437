"""The task's time law: within half of the arm's limits and the stated image speed, by the plan."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform
from tests.robots.joint_paths import straight_joint_path

from omniservo.errors import JointLimit, NoSolutionError
from omniservo.planning import PlanningProblem, plan_path
from omniservo.robots import RobotState, load_arm
from omniservo.runs.braked_speed import braked_speed
from omniservo.runs.pace import JOINT_SHARE, pace
from omniservo.safety import SafetyOptions
from omniservo.safety.stoppable import Stoppable
from omniservo.scenes.scene_of_task import scene_of_task
from omniservo.servoing import ExponentialLaw
from omniservo.tasks import load_task


@pytest.fixture(scope="module", params=["paper-example-1", "panda-table"])
def planned(request):
    """A task, its scene, and a plan to the taught goal for made-up points in front of the camera."""
    task = load_task(request.param)
    points = np.random.default_rng(1).uniform([-0.1, -0.1, 0.35], [0.1, 0.1, 0.45], (9, 3))
    points[:, :2] += 0.5 * task.teach.initial_T_goal.transform.translation[:2]  # between both views
    plan = plan_path(PlanningProblem(task.camera, points, task.teach.initial_T_goal.transform))
    assert plan.status == "certified"
    return task, scene_of_task(task), plan


def motion(planned, **servo):
    task, scene, plan = planned
    return pace(
        task.model_copy(update={"servo": task.servo.model_copy(update=servo)}),
        scene,
        plan,
    )


def exposed(planned, exposure=0.0, readout=0.0, **servo):
    task, scene, plan = planned
    sensor = task.sensor.model_copy(update={"exposure": exposure, "readout": readout})
    return motion((task.model_copy(update={"sensor": sensor}), scene, plan), **servo)


def image_speeds(planned, found):
    """Of every point at every millisecond, by differences of its pixels [px/s]."""
    task, _, plan = planned
    times = found.times()

    def pixels(at):
        poses = plan.path(found.pace(at)[0])
        return task.camera.project(np.stack([poses.inv().apply(p) for p in plan.problem.points], axis=1))[0]

    return np.linalg.norm(pixels(times + 1e-4) - pixels(times - 1e-4), axis=-1) / 2e-4


@pytest.mark.parametrize("law", ["rest-to-rest", "time-optimal"])
@pytest.mark.parametrize("image_speed", [None, 40.0])
def test_law_keeps_half_of_the_arms_limits_and_the_image_speed(planned, law, image_speed):
    found = motion(planned, time_law=law, image_speed=image_speed)
    times = found.times()
    assert found.speed_shares(times).max() <= JOINT_SHARE + 1e-6
    assert found.acceleration_shares(times).max() <= JOINT_SHARE + 1e-6
    if image_speed is not None:
        fastest = image_speeds(planned, found).max()
        assert fastest <= image_speed * 1.0001
        assert fastest > 0.98 * image_speed
    assert found.seconds == pytest.approx(found.law.duration, rel=1e-5)
    assert found.seconds >= (4.0 - 1e-5 if law == "rest-to-rest" else found.time_optimal_seconds - 1e-5)


def test_joints_of_a_motion_begin_where_the_arm_stands_and_its_branch_is_among_all(planned):
    found = motion(planned)
    np.testing.assert_allclose(found.joints(0.0), planned[1].start_joints, atol=1e-8)
    assert found.joints.feasible
    assert len(found.others.branches) >= 4


def test_a_duration_that_the_arm_cannot_keep_is_refused_with_the_least_it_can(planned):
    with pytest.raises(NoSolutionError, match=r"servo.duration: 0.1 s given; the arm's limits need 0\.\d+ s"):
        exposed(planned, duration=0.1)
    with pytest.raises(NoSolutionError, match=r"duration: 2 s given; .* and servo.image_speed need [\d.]+ s"):
        motion(planned, duration=2.0, image_speed=20.0)
    assert motion(planned, duration=2.0).seconds == pytest.approx(2.0, rel=1e-5)


@pytest.mark.parametrize("law", ["rest-to-rest", "time-optimal"])
def test_points_move_no_farther_in_an_exposure_than_their_kind_bears(planned, law):
    found = exposed(planned, time_law=law, exposure=0.2)
    most = {"paper-example-1": 2.0, "panda-table": 5.0}[planned[0].name]
    fastest = image_speeds(planned, found).max()
    assert 0.97 * most < 0.2 * fastest <= 1.0001 * most
    (notice,) = found.notices
    free = exposed(planned, time_law=law)
    assert notice.startswith("motion blur (an exposure of 200 ms, in which ")
    assert f"makes the motion last {found.seconds:.3g} s instead of {free.seconds:.3g} s" in notice
    assert free.notices == ()


def test_points_move_ten_pixels_at_most_while_a_rolling_shutter_is_read(planned):
    found = exposed(planned, time_law="time-optimal", readout=0.4)
    assert 9.7 < 0.4 * image_speeds(planned, found).max() <= 10.001
    assert "a rolling shutter (a readout of 400 ms" in found.notices[0]


def test_a_short_exposure_slows_nothing_down_and_is_not_spoken_of(planned):
    found = exposed(planned, exposure=1e-4, readout=1e-3)
    assert found.seconds == pytest.approx(exposed(planned).seconds)
    assert found.notices == ()


def test_a_duration_or_law_under_which_points_blur_too_far_is_refused_by_that_name(planned):
    with pytest.raises(
        NoSolutionError, match=r"duration: 1 s given; .* and motion blur \(an exposure of 200"
    ):
        exposed(planned, duration=1.0, exposure=0.2)
    with pytest.raises(NoSolutionError, match="exponential is not stretched; points move .* motion blur"):
        exposed(planned, time_law="exponential", exposure=0.2)
    assert exposed(planned, time_law="exponential", exposure=1e-4).law == ExponentialLaw(1.0)


def test_the_papers_exponential_law_is_taken_as_it_is(planned):
    found = motion(planned, time_law="exponential", rate=0.7)
    assert found.law == ExponentialLaw(0.7)
    assert found.acceleration_shares(found.times()) is None
    assert found.seconds == pytest.approx(np.log(1e3) / 0.7, rel=1e-5)


def test_a_plan_without_a_path_is_no_motion(planned):
    task, scene, plan = planned
    blocked = plan_path(
        PlanningProblem.from_dict(
            plan.problem.to_dict() | {"obstacles": [{"type": "sphere", "center": [0, 0, 0], "radius": 0.01}]}
        )
    )
    assert blocked.path is None
    assert pace(task, scene, blocked) is None


def test_a_joint_that_nears_the_end_of_its_range_goes_as_fast_as_the_supervisor_lets_it_and_no_faster():
    arm, options, place = load_arm("rx60"), SafetyOptions(), RigidTransform.identity()
    begin, end = np.zeros(6), np.zeros(6)
    end[2] = arm.joint_range[2, 1] - np.radians(2.0)
    joints, watch = straight_joint_path(begin, end), Stoppable(arm, place, place, options)
    assert np.isinf(braked_speed(arm, straight_joint_path(end, end), options, 1.0)(np.array([0.5])))
    for path, share in ((joints, 1.0), (joints, 0.5), (straight_joint_path(-end, begin), 1.0)):
        for w in (0.1, 0.8, 0.97):
            speed = braked_speed(arm, path, options, share)(np.array([w]))[0]
            q, fastest = path(w), speed * path(w, 1)
            watch.check(RobotState(0.0, q, 0.0 * q), 0.999 * fastest)
            if path is joints and share == 1.0:
                with pytest.raises(JointLimit, match="would stop at"):
                    watch.check(RobotState(0.0, q, 0.0 * q), 1.001 * fastest)
    assert braked_speed(arm, joints, options, 0.5)(np.array([0.8])) < 0.9 * braked_speed(
        arm, joints, options, 1.0
    )(np.array([0.8]))


def test_the_law_is_bounded_by_what_braking_within_the_joints_ranges_needs(planned):
    w, found = np.linspace(0.0, 1.0, 33), exposed(planned)
    most = braked_speed(planned[1].arm, found.joints, SafetyOptions(), JOINT_SHARE)(w)
    np.testing.assert_array_equal(found.limits.top_path_speed(w), most)
    blurred = exposed(planned, exposure=1e-4)  # which bears more at some places than the joints do
    assert (blurred.limits.top_path_speed(w) <= most).all()
