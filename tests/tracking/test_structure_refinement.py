"""Points that are known better with every view on the way."""

import numpy as np
from kinematic_loop import FISHEYE, Loop, bent_path, plan_of

from omniservo.estimation import estimate_two_view
from omniservo.tracking import PathTracker, TrackerOptions
from omniservo.tracking.structure_refinement import MOST_VIEWS, StructureRefinement

RNG = np.random.default_rng(11)
POINTS = np.array([0.0, -0.05, 0.42]) + RNG.uniform(-0.12, 0.12, (20, 3))
PATH = bent_path((0.06, -0.12, 0.1), bend=(0.08, 0.05, 0.0))
NOISE = 0.3


def row(pose):
    return np.concatenate((pose.rotation.as_quat(), pose.translation))


def look(pose, rng):
    return Loop(FISHEYE, POINTS, pose, NOISE, rng=rng).look()


def error(points):
    return np.sqrt(np.mean(np.sum((points - POINTS) ** 2, axis=1)))


def test_views_on_the_way_bring_the_points_nearer_to_the_truth():
    before, after = [], []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        first, last = look(PATH(0.0), rng), look(PATH(1.0), rng)
        length = float(np.linalg.norm(PATH(1.0).translation))
        two = estimate_two_view(FISHEYE, first, last, scale=length)
        points = np.array(two.points)
        refinement = StructureRefinement(FISHEYE, points, first, last, row(two.initial_T_goal))
        before.append(error(points))
        for w in np.linspace(0.05, 0.95, 19):
            found = refinement.look(look(PATH(w), rng), np.ones(20, dtype=bool), row(PATH(w)))
            points = points if found is None else found
        assert 5 < refinement.views <= MOST_VIEWS
        after.append(error(points))
    assert np.mean(after) < 0.75 * np.mean(before)


def test_a_view_from_where_one_was_kept_adds_nothing():
    rng = np.random.default_rng(1)
    refinement = StructureRefinement(
        FISHEYE, POINTS, look(PATH(0.0), rng), look(PATH(1.0), rng), row(PATH(1.0))
    )
    everything = np.ones(20, dtype=bool)
    assert refinement.look(look(PATH(0.01), rng), everything, row(PATH(0.01))) is None
    assert refinement.look(look(PATH(0.5), rng), everything, row(PATH(0.5))) is not None
    assert refinement.look(look(PATH(0.5), rng), everything, row(PATH(0.5))) is None


def test_with_refined_points_the_servo_stays_near_the_path_and_ends_on_the_goal_image():
    rng = np.random.default_rng(2)
    wrong = POINTS * (1.0 + 0.02 * rng.standard_normal((20, 1)))
    first, last = (Loop(FISHEYE, POINTS, PATH(w)).look() for w in (0.0, 1.0))
    loop = Loop(FISHEYE, POINTS, noise=0.02, period=0.02)
    tracker = PathTracker(
        plan_of(wrong, PATH),
        FISHEYE,
        goal_pixels=last,
        initial_pixels=first,
        options=TrackerOptions(delay=0.01),
    )
    loop.run(tracker, PATH, 10.0)
    assert tracker.done
    assert np.linalg.norm(loop.pose.translation - PATH(1.0).translation) < 5e-4
    assert max(loop.deviations[40:]) < 2.5e-3
