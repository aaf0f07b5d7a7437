import math

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo import PoseEstimate, UnifiedCamera, estimate_pose, preset
from omniservo.errors import InputError

PERSPECTIVE = UnifiedCamera(400.0, 405.0, 320.0, 240.0, 0.0, 640, 480)


def picture(rng, camera, n, *, flat=False, noise=0.0, size=0.12, turn=0.6, distance=0.5, off_axis=0.3):
    """Points in their own frame, their pixels, and reference_T_camera."""
    while True:
        points = size * rng.uniform(-1, 1, (n, 3)) * ([1, 1, 0] if flat else 1)
        aim = Rotation.from_rotvec([*(off_axis * rng.normal(size=2)), 0.0])
        rotation = Rotation.from_rotvec(turn * rng.normal(size=3))
        middle = aim.apply([0.0, 0.0, distance])
        pixels, valid = camera.project(rotation.apply(points) + middle)
        if valid.all() and camera.in_image(pixels).all():
            pose = RigidTransform.from_components(middle, rotation).inv()
            return points, pixels + noise * rng.normal(size=pixels.shape), pose


def error(found, pose):
    turn = (found.rotation.inv() * pose.rotation).magnitude()
    return max(float(np.linalg.norm(found.translation - pose.translation)), float(turn))


@pytest.mark.parametrize("n", [4, 5, 9, 50])
@pytest.mark.parametrize("flat", [False, True])
def test_exact_pixels_give_the_exact_pose(camera, n, flat):
    rng = np.random.default_rng(n)
    for _ in range(5):
        points, pixels, pose = picture(rng, camera, n, flat=flat)
        found = estimate_pose(camera, points, pixels, noise=1e-3)
        assert found.status == "ok", found.message
        assert error(found.reference_T_camera, pose) < 1e-8
        assert found.inliers.all()
        assert found.rms_px < 1e-7
        assert np.isfinite(found.covariance).all()


def test_points_past_ninety_degrees_are_members():
    camera = UnifiedCamera(120.0, 120.0, 320.0, 320.0, 0.9, 640, 640)
    rng = np.random.default_rng(3)
    aim = Rotation.from_rotvec([math.radians(105.0), 0.0, 0.0])
    for flat in (False, True):
        points = 0.12 * rng.uniform(-1, 1, (8, 3)) * ([1, 1, 0] if flat else 1)
        c = aim.apply(Rotation.from_rotvec([0.3, 0.4, 0.2]).apply(points) + np.array([0.0, 0.0, 0.5]))
        assert (c[:, 2] < 0).all()
        pose = RigidTransform.from_components(
            aim.apply([0.0, 0.0, 0.5]), aim * Rotation.from_rotvec([0.3, 0.4, 0.2])
        ).inv()
        found = estimate_pose(camera, points, camera.project(c)[0])
        assert found.status == "ok", found.message
        assert error(found.reference_T_camera, pose) < 1e-8


def test_three_points_leave_several_poses_all_of_which_are_told():
    rng, several = np.random.default_rng(4), 0
    for _ in range(40):
        points, pixels, pose = picture(rng, PERSPECTIVE, 3)
        found = estimate_pose(PERSPECTIVE, points, pixels)
        assert found.status in ("ok", "ambiguous"), found.message
        assert min(error(p, pose) for p in found.poses) < 1e-6
        for other in found.poses:
            np.testing.assert_allclose(PERSPECTIVE.project(other.inv().apply(points))[0], pixels, atol=0.1)
        if found.status == "ambiguous":
            several += 1
            assert 2 <= len(found.poses) <= 4
            assert found.reference_T_camera is None
            assert np.isnan(found.covariance).all()
        else:
            assert np.isfinite(found.covariance).all()
    assert several > 30


def test_a_distant_flat_target_is_ambiguous_and_both_poses_are_told():
    """A 40 mm tag, 1 m away: what perspective there is drowns in half a pixel of noise."""
    camera, rng = preset("perspective"), np.random.default_rng(5)
    tag = 0.02 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])
    told, confident, wrong = 0, 0, 0
    for _ in range(60):
        rotation = Rotation.from_rotvec([0.0, 0.6, 0.1])
        pixels = camera.project(rotation.apply(tag) + np.array([0.02, 0.01, 1.0]))[0]
        pose = RigidTransform.from_components([0.02, 0.01, 1.0], rotation).inv()
        found = estimate_pose(camera, tag, pixels + 0.5 * rng.normal(size=(4, 2)), noise=0.5)
        told += min(error(p, pose) for p in found.poses) < 0.4
        if found.status == "ok":
            confident += 1
            wrong += error(found.reference_T_camera, pose) > 0.6
        else:
            assert found.status == "ambiguous"
            assert found.reference_T_camera is None
            assert found.alternative is not None
    assert told >= 57
    assert confident < 40
    assert wrong <= 2


def test_near_and_sharp_the_mirrored_pose_is_ruled_out_or_told_as_unlikely():
    rng, camera = np.random.default_rng(6), preset("perspective")
    tag = 0.02 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])
    rotation = Rotation.from_rotvec([0.0, 0.6, 0.1])
    for _ in range(20):
        pixels = camera.project(rotation.apply(tag) + np.array([0.02, 0.01, 0.2]))[0] + 0.1 * rng.normal(
            size=(4, 2)
        )
        found = estimate_pose(camera, tag, pixels, noise=0.1)
        assert found.status == "ok", found.message
        assert (
            error(found.reference_T_camera, RigidTransform.from_components([0.02, 0.01, 0.2], rotation).inv())
            < 0.1
        )
        assert found.alternative is None or found.odds[1] < 0.1


@pytest.mark.parametrize(("n", "flat"), [(9, False), (9, True), (50, False), (50, True)])
def test_thirty_percent_wrong_points_do_not_matter(n, flat):
    rng = np.random.default_rng(7)
    for _ in range(15):
        points, pixels, pose = picture(rng, PERSPECTIVE, n, flat=flat, noise=0.2)
        wrong = np.arange(n) < int(0.3 * n)
        pixels[wrong] = rng.uniform([200, 120], [440, 360], (int(wrong.sum()), 2))
        found = estimate_pose(PERSPECTIVE, points, pixels)
        assert found.status == "ok", found.message
        bare = estimate_pose(PERSPECTIVE, points[~wrong], pixels[~wrong])
        assert error(found.reference_T_camera, pose) < 3 * error(bare.reference_T_camera, pose) + 0.01
        assert found.inliers[~wrong].mean() > 0.8
        assert found.inliers[wrong].mean() < 0.4


def test_in_front_it_is_at_least_as_good_as_opencv():
    rng = np.random.default_rng(8)
    ours, theirs = [], []
    for _ in range(150):
        points, pixels, pose = picture(rng, PERSPECTIVE, 9, noise=0.5)
        found = estimate_pose(PERSPECTIVE, points, pixels)
        assert found.status == "ok", found.message
        ours.append(error(found.reference_T_camera, pose))
        bearings = PERSPECTIVE.unproject(pixels)[0]
        _, turn, shift = cv2.solvePnP(
            points, bearings[:, :2] / bearings[:, 2:], np.eye(3), None, flags=cv2.SOLVEPNP_SQPNP
        )
        rotation = Rotation.from_rotvec(turn.ravel()).inv()
        theirs.append(error(RigidTransform.from_components(-rotation.apply(shift.ravel()), rotation), pose))
    assert np.median(ours) <= 1.02 * np.median(theirs)
    assert np.percentile(ours, 90) <= 1.05 * np.percentile(theirs, 90)


@pytest.mark.parametrize("stated", [None, 0.3])
def test_covariance_is_that_of_repeated_noise(stated):
    rng = np.random.default_rng(9)
    points, exact, pose = picture(rng, PERSPECTIVE, 20)
    errors, predicted = [], []
    for _ in range(300):
        found = estimate_pose(PERSPECTIVE, points, exact + 0.3 * rng.normal(size=exact.shape), noise=stated)
        turn = pose.rotation.inv() * found.reference_T_camera.rotation
        errors.append(
            np.concatenate((found.reference_T_camera.translation - pose.translation, turn.as_rotvec()))
        )
        predicted.append(found.covariance)
    ratio = np.sqrt(np.diag(np.cov(np.array(errors).T)) / np.diag(np.mean(predicted, axis=0)))
    np.testing.assert_allclose(ratio, 1.0, atol=0.12)


def test_a_point_that_is_known_to_be_blurred_counts_less():
    rng = np.random.default_rng(10)
    weighted, plain = [], []
    for _ in range(80):
        points, pixels, pose = picture(rng, PERSPECTIVE, 8)
        sigma = np.where(np.arange(8) < 4, 0.05, 2.0)
        pixels = pixels + sigma[:, None] * rng.normal(size=pixels.shape)
        weighted.append(
            error(estimate_pose(PERSPECTIVE, points, pixels, noise=sigma, robust=False).poses[0], pose)
        )
        plain.append(error(estimate_pose(PERSPECTIVE, points, pixels, robust=False).poses[0], pose))
    assert np.median(weighted) < 0.3 * np.median(plain)


def named(status, found: PoseEstimate):
    assert found.status == status, (found.status, found.message)
    assert found.reference_T_camera is None
    assert found.message
    assert not found.inliers.any()
    assert np.isnan(found.covariance).all()
    assert np.isnan(found.residuals_px).all()
    assert math.isnan(found.rms_px)


def test_two_points_are_too_few():
    named("too_few_points", estimate_pose(PERSPECTIVE, np.eye(3)[:2], [[300, 200], [310, 200]]))
    named("too_few_points", estimate_pose(PERSPECTIVE, np.empty((0, 3)), np.empty((0, 2))))


def test_points_on_one_line_are_named():
    line = np.linspace(-1, 1, 7)[:, None] * np.array([0.1, 0.05, 0.02])
    pixels = PERSPECTIVE.project(line + np.array([0, 0, 0.5]))[0]
    named("collinear_points", estimate_pose(PERSPECTIVE, line, pixels))
    named("collinear_points", estimate_pose(PERSPECTIVE, line[:3], pixels[:3]))
    named("collinear_points", estimate_pose(PERSPECTIVE, np.zeros((5, 3)), pixels[:5]))


def test_pixels_that_belong_to_no_pose_are_named():
    rng = np.random.default_rng(11)
    answers = [
        estimate_pose(PERSPECTIVE, 0.1 * rng.normal(size=(n, 3)), rng.uniform([250, 170], [390, 310], (n, 2)))
        for n in (4, 5, 9, 9, 9, 9, 30)
        for _ in range(6)
    ]
    for found in answers:
        named("not_converged", found)


def test_of_two_tags_one_with_the_wrong_place_neither_is_trusted():
    rng = np.random.default_rng(12)
    square = 0.03 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0.0]])
    points = np.concatenate((square, square + np.array([0.1, 0.02, 0.0])))
    seen = np.concatenate((square, square + np.array([0.05, -0.09, 0.03])))
    pixels = PERSPECTIVE.project(Rotation.from_rotvec([0.3, 0.5, 0]).apply(seen) + np.array([0, 0, 0.4]))[0]
    found = estimate_pose(PERSPECTIVE, points, pixels + 0.05 * rng.normal(size=(8, 2)), noise=0.05)
    assert found.status in ("ambiguous", "not_converged"), found.message


def test_points_behind_a_perspective_camera_give_no_pose():
    """Pixels of the mirror image through the camera's centre: a pose exists only behind the camera."""
    rng, confident = np.random.default_rng(13), 0
    for _ in range(20):
        points = 0.1 * rng.normal(size=(9, 3))
        pixels = PERSPECTIVE.project(-(points - [0, 0, 0.5]))[0]
        found = estimate_pose(PERSPECTIVE, points, pixels)
        confident += found.status == "ok"
    assert confident == 0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"points": np.zeros((9, 2))}, "points: shape"),
        ({"points": np.zeros((8, 3))}, "points, pixels: 8 and 9 rows"),
        ({"points": np.full((9, 3), np.inf)}, "points: inf"),
        ({"pixels": np.full((9, 2), np.nan)}, "pixels: nan"),
        ({"noise": 0.0}, "noise: 0 given"),
        ({"noise": [0.1, 0.2]}, "noise: 2 numbers given; 9"),
        ({"noise": np.full(9, -1.0)}, "noise: -1 given"),
        ({"noise": "little"}, "noise: 'little' given"),
    ],
)
def test_wrong_input_names_the_argument(change, message):
    points, pixels, _ = picture(np.random.default_rng(14), PERSPECTIVE, 9)
    call = {"points": points, "pixels": pixels, "noise": None} | change
    with pytest.raises(InputError, match=message):
        estimate_pose(PERSPECTIVE, call["points"], call["pixels"], noise=call["noise"])


def test_a_pixel_outside_the_domain_is_named(fisheye):
    with pytest.raises(InputError, match=r"pixels: \(5000, 0\) at index 1 is outside the camera's domain"):
        estimate_pose(fisheye, np.eye(3), [[300, 200], [5000, 0], [310, 220]], robust=False)


def test_the_same_input_gives_the_same_answer():
    points, pixels, _ = picture(np.random.default_rng(15), PERSPECTIVE, 30, noise=0.5)
    pixels[:9] += 40.0
    one, other = (estimate_pose(PERSPECTIVE, points, pixels) for _ in range(2))
    np.testing.assert_array_equal(one.covariance, other.covariance)
    np.testing.assert_array_equal(one.inliers, other.inliers)


@pytest.mark.parametrize("n", [10, 13, 30])
def test_noise_that_is_not_stated_is_found_where_it_is_more_than_usual(n):
    rng = np.random.default_rng(21)
    found = [estimate_pose(PERSPECTIVE, *picture(rng, PERSPECTIVE, n, noise=2.0)[:2]) for _ in range(10)]
    assert [pose.status for pose in found] == ["ok"] * 10
    assert np.mean([pose.inliers.mean() for pose in found]) > 0.98
    assert np.mean([pose.noise_px for pose in found]) == pytest.approx(2.0, rel=0.1)
