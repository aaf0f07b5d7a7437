import math

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import UnifiedCamera
from omniservo.errors import InputError
from omniservo.estimation import refine_pose, refine_pose_kernel


def off(pose, rng, metres=0.02, radians=0.05):
    return RigidTransform.from_components(
        pose.translation + metres * rng.normal(size=3),
        pose.rotation * Rotation.from_rotvec(radians * rng.normal(size=3)),
    )


def test_exact_pixels_give_the_exact_pose_for_every_camera(camera, make_scene):
    rng = np.random.default_rng(1)
    for _ in range(5):
        scene = make_scene(rng, camera=camera, turn=0.2)
        found = refine_pose(camera, scene.points, scene.pixels_goal, off(scene.initial_T_goal, rng))
        assert found.ok
        assert found.rms_px < 1e-9
        np.testing.assert_allclose(found.reference_T_camera.translation, scene.translation, atol=1e-11)
        assert (found.reference_T_camera.rotation.inv() * scene.rotation).magnitude() < 1e-11


def test_noisy_pixels_give_the_least_squares_pose_that_scipy_finds(make_scene):
    rng = np.random.default_rng(2)
    scene = make_scene(rng)
    _, pixels = scene.noisy(rng, 0.5)
    guess = off(scene.initial_T_goal, rng)

    def residuals(x):
        pose = RigidTransform.from_components(x[:3], guess.rotation * Rotation.from_rotvec(x[3:]))
        return (scene.camera.project(pose.inv().apply(scene.points))[0] - pixels).ravel()

    reference = least_squares(
        residuals, np.concatenate((guess.translation, np.zeros(3))), xtol=1e-14, ftol=1e-14
    )
    found = refine_pose(scene.camera, scene.points, pixels, guess)
    assert found.ok
    np.testing.assert_allclose(found.reference_T_camera.translation, reference.x[:3], atol=1e-7)
    assert found.rms_px == pytest.approx(math.sqrt(2 * reference.cost / 9), rel=1e-9)


def test_covariance_is_that_of_repeated_noise(make_scene):
    rng = np.random.default_rng(3)
    scene = make_scene(rng, n=30)
    errors, predicted = [], []
    for _ in range(300):
        _, pixels = scene.noisy(rng, 0.3)
        found = refine_pose(scene.camera, scene.points, pixels, scene.initial_T_goal)
        pose = found.reference_T_camera
        errors.append(
            np.concatenate(
                (pose.translation - scene.translation, (scene.rotation.inv() * pose.rotation).as_rotvec())
            )
        )
        predicted.append(found.covariance)
    ratio = np.sqrt(np.diag(np.cov(np.array(errors).T)) / np.diag(np.mean(predicted, axis=0)))
    np.testing.assert_allclose(ratio, 1.0, atol=0.12)


def test_rows_that_are_not_valid_may_hold_nan_and_do_not_count(make_scene):
    rng = np.random.default_rng(4)
    scene = make_scene(rng)
    pixels = scene.pixels_goal.copy()
    valid = np.ones(9, dtype=bool)
    pixels[[2, 5]], valid[[2, 5]] = np.nan, False
    found = refine_pose(scene.camera, scene.points, pixels, off(scene.initial_T_goal, rng), valid)
    assert found.ok
    np.testing.assert_allclose(found.reference_T_camera.translation, scene.translation, atol=1e-11)


def test_three_points_are_refused(make_scene):
    scene = make_scene(np.random.default_rng(5))
    found = refine_pose(scene.camera, scene.points[:3], scene.pixels_goal[:3], scene.initial_T_goal)
    assert not found.ok
    assert found.reference_T_camera is None
    assert np.isnan(found.covariance).all()


def test_points_on_one_line_do_not_determine_a_pose(fisheye, make_view):
    line = np.linspace(-1, 1, 9)[:, None] * np.array([0.1, 0.05, 0.02]) + [0, 0, 0.5]
    scene = make_view(fisheye, line, Rotation.from_rotvec([0.1, 0, 0]), np.array([0.05, 0, 0]))
    assert not refine_pose(fisheye, line, scene.pixels_goal, scene.initial_T_goal).ok


def test_a_guess_that_puts_points_outside_the_domain_is_a_failure_not_nan(make_scene):
    scene = make_scene(np.random.default_rng(6))
    behind = RigidTransform.from_components([0, 0, 0], Rotation.from_rotvec([math.pi, 0, 0]))
    found = refine_pose(scene.camera, scene.points, scene.pixels_goal, behind)
    assert not found.ok
    assert found.reference_T_camera is None


def test_where_two_poses_of_a_tag_are_about_to_become_one_the_valley_is_followed_to_its_end():
    """In a run with a tag of 60 px: a failure is taken for an image that no pose explains."""
    camera = UnifiedCamera(420.0, 420.0, 319.5, 239.5, 0.0, 640, 480)
    points = [
        [0.04079, -0.04516, 0.58686],
        [0.11655, -0.01047, 0.58526],
        [0.08184, 0.0651, 0.57987],
        [0.00608, 0.03042, 0.58147],
    ]
    pixels = [[347.42613, 209.97712], [403.18165, 235.21395], [378.58682, 289.51158], [323.0408, 264.72957]]
    guess = RigidTransform.from_components(
        [-0.00105, -0.00238, 0.00248], Rotation.from_quat([0.00187, 0.00157, 0.00214, 0.99999])
    )
    found = refine_pose(camera, points, pixels, guess)
    assert found.ok
    assert found.rms_px == pytest.approx(0.388, abs=0.001)


def test_kernel_leaves_its_arguments_alone(make_scene):
    rng = np.random.default_rng(7)
    scene = make_scene(rng)
    guess = off(scene.initial_T_goal, rng)
    quaternion, translation = guess.rotation.as_quat(), np.array(guess.translation)
    before = quaternion.copy(), translation.copy()
    valid = np.ones(9, dtype=bool)
    q, t, rms, ok = refine_pose_kernel(
        scene.camera.parameters, scene.points, scene.pixels_goal, valid, quaternion, translation
    )
    assert ok
    assert rms < 1e-9
    assert np.linalg.norm(q) == pytest.approx(1.0, abs=1e-15)
    np.testing.assert_allclose(t, scene.translation, atol=1e-11)
    np.testing.assert_array_equal(quaternion, before[0])
    np.testing.assert_array_equal(translation, before[1])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"points": np.zeros((9, 2))}, "points: shape"),
        ({"pixels": np.zeros((8, 2))}, "pixels: shape"),
        ({"pixels": np.full((9, 2), np.nan)}, "pixels"),
        ({"valid": np.ones(8, dtype=bool)}, "valid"),
    ],
)
def test_wrong_input_names_the_argument(make_scene, change, message):
    scene = make_scene(np.random.default_rng(8))
    call = {"points": scene.points, "pixels": scene.pixels_goal, "valid": None} | change
    with pytest.raises(InputError, match=message):
        refine_pose(scene.camera, call["points"], call["pixels"], scene.initial_T_goal, valid=call["valid"])
