"""Little relief, little parallax, one match that decides: an answer whose σ leaves out the truth is wrong."""

import numpy as np
import pytest
from benchmarks.closed_loop_risk import OFF_MODEL, estimate_of, job, with_error_stated
from benchmarks.tempting_scenes import answered, is_sure_and_wrong
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.stats import chi2

from omniservo.camera_files.usual_error import usual_error
from omniservo.cameras import UnifiedCamera, preset
from omniservo.estimation import estimate_two_view
from omniservo.estimation.matches import Matches
from omniservo.estimation.robust.rival_motions import with_rivals
from omniservo.estimation.robust.two_view_fit import fit_two_views
from omniservo.geometry.quaternions import QUATERNION

RELIEF, SMALL_BASELINE = 0, 1


@pytest.mark.parametrize(
    ("kind", "k"),
    [(RELIEF, k) for k in (149, 260, 684, 864)] + [(SMALL_BASELINE, k) for k in (133, 306, 403, 641, 873)],
)
def test_where_a_plane_explains_nearly_as_much_no_answer_is_sure_and_wrong(kind, k):
    """Each of them was: the first ones in a false minimum, others since points near infinity ended walks."""
    scene, found = answered(kind, k)
    assert found.status in ("ok", "ambiguous")
    assert found.status == "ambiguous" or not is_sure_and_wrong(found, scene.initial_T_goal)


@pytest.mark.parametrize("k", [260, 864])
def test_the_minimum_that_many_points_of_little_relief_hide_is_found(k):
    """What the truth leads to is not better than the answer."""
    scene, found = answered(RELIEF, k)
    pose, truth = found.initial_T_goal, scene.initial_T_goal
    assert (truth.rotation.inv() * pose.rotation).magnitude() < np.radians(3.0)


def of_lines(lines, n, k):
    """The motion, and what is said of it, before points on a few lines; noise of 0.3 px, which is stated."""
    rng, camera = np.random.default_rng([k, lines, n]), preset("fe185")
    while True:
        ends = rng.uniform([-0.25, -0.2, 0.4], [0.25, 0.2, 0.8], (2, lines, 3))
        along, which = rng.uniform(size=(n, 1)), np.arange(n) % lines
        points = (1.0 - along) * ends[0, which] + along * ends[1, which]
        turn = Rotation.from_rotvec(rng.uniform(-0.5, 0.5, 3))
        pose = RigidTransform.from_components(rng.uniform(-0.3, 0.3, 3), turn)
        (initial, seen), (goal, too) = camera.project(points), camera.project(pose.inv().apply(points))
        if seen.all() and too.all():
            break
    initial, goal = (p + 0.3 * rng.normal(size=p.shape) for p in (initial, goal))
    return pose, estimate_two_view(camera, initial, goal, noise=0.3)


@pytest.mark.parametrize(
    ("lines", "n", "k"),
    [(2, 12, 27), (2, 12, 74), (2, 60, 7), (2, 60, 36), (3, 60, 87)],
)
def test_points_on_a_few_lines_hide_no_minimum(lines, n, k):
    """Two lines and both cameras lie on a quadric, which is critical: each answer was sure and wrong."""
    truth, found = of_lines(lines, n, k)
    assert found.status != "ok" or not is_sure_and_wrong(found, truth)


def test_far_from_any_plane_a_fit_is_as_it_was():
    scene = job(3, OFF_MODEL)
    matches = Matches.of_pixels(scene.camera, np.hstack([p[: len(scene.points)] for p in scene.pixels]))
    fit = fit_two_views(matches, QUATERNION, robust=True)
    assert with_rivals(matches, fit, QUATERNION, robust=True) is fit


@pytest.mark.parametrize("seed", [35, 107, 276, 815])
def test_one_wrong_match_of_many_that_decides_the_motion_is_left_out(seed):
    """Its rays meet close to a camera: 60 right ones hardly hold the motion against it."""
    scene = with_error_stated(job(seed, OFF_MODEL))
    found = estimate_of(scene)
    assert found.status == "ok"
    assert not found.inliers[len(scene.points) :].any()
    pose, truth = found.initial_T_goal, scene.goal
    turn = (truth.rotation.inv() * pose.rotation).as_rotvec()
    error = np.concatenate((pose.translation - truth.translation, turn))
    assert error @ np.linalg.solve(found.covariance, error) < chi2.isf(1e-3, 6)


def test_without_wrong_matches_a_match_that_decides_is_kept():
    scene = job(35, OFF_MODEL)
    right = [p[: len(scene.points)] for p in scene.pixels]
    assert estimate_two_view(scene.camera, *right).inliers.all()


@pytest.mark.parametrize(
    ("relief", "wrong", "seed"), [(0.005, 1, 39), (0.005, 1, 56), (0.005, 3, 13), (0.01, 1, 39)]
)
def test_a_narrow_lens_and_one_wrong_match_hide_no_minimum_behind_a_refusal(relief, wrong, seed):
    """Of 300 matches; a false minimum asked for "a focal length 807% shorter": none better was looked for."""
    rng, n = np.random.default_rng(seed), 300
    camera = UnifiedCamera(1520.4, 1525.9, 302.3, 246.9, 0.0, 640, 480)
    camera = UnifiedCamera.from_dict({**camera.to_dict(), "model_error": usual_error(camera, {}).to_dict()})
    across = rng.uniform(-0.08, 0.08, n), rng.uniform(-0.05, 0.05, n)
    points = np.stack([*across, relief * rng.uniform(-1, 1, n)], axis=1)
    axis = rng.normal(size=3) * [1.0, 1.0, 0.2]
    turn = Rotation.from_rotvec(np.radians(7.7) * axis / np.linalg.norm(axis))
    points = Rotation.from_rotvec([0.5 * rng.normal(), 0.5 * rng.normal(), 0.0]).apply(points)
    initial, goal = (camera.project(p + np.array([0.0, 0.0, 0.58]))[0] for p in (points, turn.apply(points)))
    initial, goal = (p + rng.normal(0.0, 0.04, p.shape) for p in (initial, goal))
    goal[:wrong] += np.array([20.0, -143.0]) * rng.uniform(-1.0, 1.0, (wrong, 2))
    found = estimate_two_view(camera, initial, goal, noise=0.04)
    assert found.status == "ok"
    assert (found.initial_T_goal.rotation * turn).magnitude() < np.radians(0.3)
