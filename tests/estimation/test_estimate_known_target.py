import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo import TwoViewEstimate, estimate_known_target
from omniservo.errors import InputError

SQUARE = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])


def to_target_frame(scene, rng):
    """The scene's points in a frame of their own."""
    frame = RigidTransform.from_components(rng.normal(size=3), Rotation.random(rng=rng))
    return frame.apply(scene.points)


def test_exact_pixels_give_the_exact_metric_motion_and_structure(camera, make_scene):
    rng = np.random.default_rng(1)
    for n in (4, 9, 40):
        scene = make_scene(rng, n=n, camera=camera, turn=0.2)
        found = estimate_known_target(
            camera, to_target_frame(scene, rng), scene.pixels_initial, scene.pixels_goal, noise=1e-3
        )
        assert found.status == "ok", found.message
        assert found.is_metric
        np.testing.assert_allclose(found.initial_T_goal.translation, scene.translation, atol=1e-8)
        assert (found.initial_T_goal.rotation.inv() * scene.rotation).magnitude() < 1e-8
        np.testing.assert_allclose(found.points, scene.points, atol=1e-8)


def test_the_stated_noise_of_each_image_counts_for_its_own_pose(make_scene):
    rng = np.random.default_rng(4)
    scene = make_scene(rng, n=20)
    target = to_target_frame(scene, rng)

    def covariance(initial, goal):
        noise = np.tile([initial, goal], (20, 1))
        pixels = scene.pixels_initial, scene.pixels_goal
        return estimate_known_target(scene.camera, target, *pixels, noise=noise).covariance

    alike = covariance(0.1, 0.1)
    blurred = covariance(0.1, 0.3), covariance(0.3, 0.1)
    np.testing.assert_allclose(blurred[0] + blurred[1], 10.0 * alike, rtol=1e-6, atol=1e-15)
    assert all(np.trace(one) > 1.5 * np.trace(alike) for one in blurred)


@pytest.mark.slow
@pytest.mark.parametrize("stated", [None, 0.3])
def test_covariances_are_those_of_repeated_noise_jointly(make_scene, stated):
    rng = np.random.default_rng(2)
    scene = make_scene(rng, n=20)
    target = to_target_frame(scene, rng)
    errors, predicted, points, points_predicted = [], [], [], []
    for _ in range(300):
        found = estimate_known_target(scene.camera, target, *scene.noisy(rng, 0.3), noise=stated)
        assert found.status == "ok", found.message
        if not found.inliers.all():
            continue
        turn = (scene.rotation.inv() * found.initial_T_goal.rotation).as_rotvec()
        shift = found.initial_T_goal.translation - scene.translation
        errors.append(np.concatenate((shift, turn, (found.points[3] - scene.points[3]))))
        predicted.append(np.diag(found.covariance))
        points_predicted.append(np.diag(found.points_covariance[3]))
        points.append(found.uncertainty.noise[:, [0, 6 + 9]].T @ found.uncertainty.noise[:, [0, 6 + 9]])
    spread = np.cov(np.array(errors).T)
    expected = np.concatenate((np.mean(predicted, axis=0), np.mean(points_predicted, axis=0)))
    np.testing.assert_allclose(np.sqrt(np.diag(spread) / expected), 1.0, atol=0.13)
    joint = np.mean(points, axis=0)  # t_x with a point's x: they err together
    correlation = joint[0, 1] / np.sqrt(joint[0, 0] * joint[1, 1])
    seen = spread[0, 6] / np.sqrt(spread[0, 0] * spread[6, 6])
    assert correlation == pytest.approx(seen, abs=0.15)


def test_points_seen_in_one_picture_only_help_there(make_scene):
    rng = np.random.default_rng(3)
    scene = make_scene(rng, n=12)
    visible = np.ones((2, 12), dtype=bool)
    visible[0, :3] = visible[1, 9:] = False
    initial, goal = scene.pixels_initial.copy(), scene.pixels_goal.copy()
    initial[~visible[0]], goal[~visible[1]] = np.nan, np.nan
    found = estimate_known_target(scene.camera, scene.points, initial, goal, visible=visible)
    assert found.status == "ok", found.message
    np.testing.assert_allclose(found.initial_T_goal.translation, scene.translation, atol=1e-8)
    np.testing.assert_allclose(found.points, scene.points, atol=1e-8)
    assert found.inliers.all()
    assert np.isnan(found.residuals_px[:3, :2]).all()
    assert np.isfinite(found.residuals_px[:3, 2:]).all()


def test_wrong_pixels_in_either_picture_are_rejected(make_scene):
    rng = np.random.default_rng(4)
    scene = make_scene(rng, n=20)
    initial, goal = scene.noisy(rng, 0.1)
    initial[:3] += 25.0
    goal[3:6] -= 30.0
    found = estimate_known_target(scene.camera, scene.points, initial, goal)
    assert found.status == "ok", found.message
    assert not found.inliers[:6].any()
    assert found.inliers[6:].all()
    assert np.linalg.norm(found.initial_T_goal.translation - scene.translation) < 0.005
    assert np.isnan(found.points_covariance[:6]).all()
    np.testing.assert_allclose(found.points[0], scene.points[0], atol=0.005)


def two_views_of_a_tag(camera, distance, rng, noise):
    rotations = Rotation.from_rotvec([[0.0, 0.6, 0.1], [0.5, 0.1, 0.0]])
    places = np.array([[0.02, 0.01, distance], [-0.03, 0.02, distance]])
    pixels = [camera.project(r.apply(0.02 * SQUARE) + p)[0] for r, p in zip(rotations, places, strict=True)]
    poses = [RigidTransform.from_components(p, r).inv() for r, p in zip(rotations, places, strict=True)]
    noisy = [p + noise * rng.normal(size=p.shape) for p in pixels]
    return noisy, poses[0].inv() * poses[1]


def test_a_small_distant_tag_is_ambiguous_and_a_near_one_is_not(fisheye):
    rng = np.random.default_rng(5)
    statuses, wrong = {0.1: [], 1.0: []}, 0
    for distance in statuses:
        for _ in range(30):
            pixels, motion = two_views_of_a_tag(fisheye, distance, rng, 0.2)
            found = estimate_known_target(fisheye, 0.02 * SQUARE, *pixels, noise=0.2)
            statuses[distance].append(found.status)
            if found.status == "ok":
                wrong += (found.initial_T_goal.rotation.inv() * motion.rotation).magnitude() > 0.3
            else:
                assert found.status == "ambiguous"
                assert "picture" in found.message
    assert statuses[0.1].count("ok") == 30
    assert statuses[1.0].count("ambiguous") > 15
    assert wrong <= 2


def test_without_a_stated_noise_both_pictures_together_tell_it(fisheye):
    """Four points leave two degrees of freedom a picture: too few alone, four together."""
    rng = np.random.default_rng(6)
    pixels, motion = two_views_of_a_tag(fisheye, 0.1, rng, 0.05)
    found = estimate_known_target(fisheye, 0.02 * SQUARE, *pixels)
    assert found.status == "ok", found.message
    assert found.uncertainty.freedom == 4
    assert (found.initial_T_goal.rotation.inv() * motion.rotation).magnitude() < 0.1


def test_the_uncertain_size_of_a_target_moves_everything_together(make_scene):
    rng = np.random.default_rng(7)
    scene = make_scene(rng)
    pixels = scene.noisy(rng, 1e-4)
    found = estimate_known_target(scene.camera, scene.points, *pixels, noise=1e-4, scale_sigma=0.03)
    assert found.scale_sigma == 0.03
    along = scene.translation / np.linalg.norm(scene.translation)
    assert np.sqrt(along @ found.covariance[:3, :3] @ along) == pytest.approx(
        0.03 * np.linalg.norm(scene.translation), rel=0.01
    )
    samples = found.sample(rng, 2000)
    sizes = np.linalg.norm(samples.points[:, 0], axis=1) / np.linalg.norm(scene.points[0])
    assert np.std(sizes) == pytest.approx(0.03, rel=0.1)


def test_saved_and_loaded_the_estimate_is_the_same(make_scene, tmp_path):
    scene = make_scene(np.random.default_rng(8))
    found = estimate_known_target(scene.camera, scene.points, *scene.noisy(np.random.default_rng(9), 0.1))
    found.save(tmp_path / "estimate.json")
    again = TwoViewEstimate.load(tmp_path / "estimate.json")
    np.testing.assert_array_equal(again.covariance, found.covariance)
    np.testing.assert_array_equal(again.uncertainty.noise, found.uncertainty.noise)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"points": np.zeros((8, 3))}, "pixels_initial: shape"),
        ({"goal": np.zeros((9, 3))}, "pixels_goal: shape"),
        ({"goal": np.full((9, 2), np.nan)}, "pixels_goal: nan"),
        ({"visible": np.ones((2, 8), dtype=bool)}, "visible: bool"),
        ({"noise": [0.1]}, "noise: shape"),
        ({"noise": np.zeros((9, 2))}, "noise: 0 given"),
        ({"scale_sigma": -0.1}, "scale_sigma: -0.1 given"),
    ],
)
def test_wrong_input_names_the_argument(make_scene, change, message):
    scene = make_scene(np.random.default_rng(10))
    call = {"points": scene.points, "goal": scene.pixels_goal} | change
    points, goal = call.pop("points"), call.pop("goal")
    with pytest.raises(InputError, match=message):
        estimate_known_target(scene.camera, points, scene.pixels_initial, goal, **call)


def test_too_few_points_in_a_picture_are_named_with_the_picture(make_scene):
    scene = make_scene(np.random.default_rng(11))
    visible = np.ones((2, 9), dtype=bool)
    visible[1, 2:] = False
    found = estimate_known_target(
        scene.camera, scene.points, scene.pixels_initial, scene.pixels_goal, visible=visible
    )
    assert found.status == "too_few_points"
    assert found.message.startswith("goal picture: 2 points")
    assert np.isnan(found.covariance).all()
