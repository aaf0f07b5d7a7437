"""Where the camera sits on the flange: against the truth of drawn and rendered views, and what is refused."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.stats import chi2
from tests.calibration.hand_eye_scenes import (
    BASE_T_BOARD,
    BOARD,
    FISHEYE,
    FLANGE_T_CAMERA,
    PINHOLE,
    DrawnViews,
    draw_views,
    error_of,
    render_views,
)

from omniservo.calibration.boards import find_board
from omniservo.calibration.hand_eye import calibrate_hand_eye
from omniservo.calibration.hand_eye.loop import LinearLoop, LoopState, SeenViews, linearise
from omniservo.calibration.hand_eye.robot_noise import solve_loop
from omniservo.calibration.hand_eye.start import closed_form
from omniservo.errors import InputError


def calibrated(drawn: DrawnViews, camera=PINHOLE, **changed):
    given = {
        "base_T_flange": drawn.base_T_flange,
        "image_points": drawn.pixels,
        "object_points": drawn.points,
    }
    return calibrate_hand_eye(camera, **(given | changed))


@pytest.fixture(scope="module")
def good():
    """Twelve views of a robot that is off by 0.5 mm and 0.1°."""
    return draw_views(np.random.default_rng(1), PINHOLE, 12, position=5e-4, rotation=np.radians(0.1))


def test_exact_views_give_the_exact_poses():
    for camera in (PINHOLE, FISHEYE):
        drawn = draw_views(np.random.default_rng(2), camera, 6, px=0.0)
        found = calibrated(drawn, camera)
        assert np.abs(error_of(found.flange_T_camera, FLANGE_T_CAMERA)).max() < 1e-6
        assert np.abs(error_of(found.base_T_board, BASE_T_BOARD)).max() < 1e-6


def test_poses_and_result_are_known_by_their_names_of_before(good):
    with pytest.warns(DeprecationWarning, match="base_T_tool is called base_T_flange now"):
        found = calibrate_hand_eye(
            PINHOLE, base_T_tool=good.base_T_flange, image_points=good.pixels, object_points=good.points
        )
    with pytest.warns(DeprecationWarning, match="HandEye.tool_T_camera is called flange_T_camera now"):
        assert found.tool_T_camera is found.flange_T_camera
    assert found.to_dict()["tool_T_camera"] == found.to_dict()["flange_T_camera"]


def test_both_poses_lie_within_the_stated_uncertainty(good):
    found = calibrated(good)
    for pose, true, covariance in (
        (found.flange_T_camera, FLANGE_T_CAMERA, found.covariance),
        (found.base_T_board, BASE_T_BOARD, found.board_covariance),
    ):
        error = error_of(pose, true)
        assert error @ np.linalg.solve(covariance, error) < chi2.ppf(0.99, 6)
    assert found.robot_position_m == pytest.approx(5e-4, rel=0.4)
    assert found.robot_rotation_rad == pytest.approx(np.radians(0.1), rel=0.4)
    assert found.noise_px == pytest.approx(0.1, rel=0.1)
    assert not found.board_size_disputed


@pytest.mark.slow
def test_95_percent_ellipsoids_hold_the_truth_about_95_times_of_100():
    """24 calibrations of 6 views each; 18 or fewer would happen by chance once in 1000 times."""
    rng = np.random.default_rng(3)
    inside = 0
    for _ in range(24):
        found = calibrated(draw_views(rng, PINHOLE, 6, position=1e-3, rotation=np.radians(0.2)))
        error = error_of(found.flange_T_camera, FLANGE_T_CAMERA)
        inside += error @ np.linalg.solve(found.covariance, error) < chi2.ppf(0.95, 6)
    assert inside >= 19


@pytest.mark.slow
def test_rendered_fisheye_views_give_the_truth_within_0_3_mm_and_0_05_degrees():
    """The simulator's pictures, noisy so that corners are off by 0.1 px; the detector sees nothing else."""
    base_T_flange, pictures, corners = render_views(0, 10, noise=34.0)
    views = [find_board(picture, BOARD, FISHEYE) for picture in pictures]
    off = np.concatenate([v.pixels - true[v.ids] for v, true in zip(views, corners, strict=True)])
    assert off.std() == pytest.approx(0.1, rel=0.15)
    found = calibrate_hand_eye(
        FISHEYE, base_T_flange, [v.pixels for v in views], [v.object_points for v in views]
    )
    error = error_of(found.flange_T_camera, FLANGE_T_CAMERA)
    assert np.linalg.norm(error[:3]) < 3e-4
    assert np.degrees(np.linalg.norm(error[3:])) < 0.05
    assert error @ np.linalg.solve(found.covariance, error) < chi2.ppf(0.99, 6)


def test_the_start_is_the_closed_form_of_exact_poses():
    drawn = draw_views(np.random.default_rng(4), PINHOLE, 5, px=0.0)
    A = np.stack([pose.as_matrix() for pose in drawn.base_T_flange])
    B = np.linalg.inv(A @ FLANGE_T_CAMERA.as_matrix()) @ BASE_T_BOARD.as_matrix()
    assert np.abs(closed_form(A, B) - FLANGE_T_CAMERA.as_matrix()).max() < 1e-9


def test_the_linear_loop_is_the_derivative_of_what_each_view_says(good):
    """The Δ with which a view's corners fit best, by differences of the step and of the board's size."""
    poses = RigidTransform.concatenate(good.base_T_flange)
    views = SeenViews(poses, np.concatenate(good.pixels), np.concatenate(good.points), 54 * np.arange(13))
    offsets = 1e-3 * np.random.default_rng(5).standard_normal((12, 6))
    state = LoopState(FLANGE_T_CAMERA, BASE_T_BOARD, offsets)

    def best_offsets(state, views):
        for _ in range(8):
            state = dataclasses.replace(state, offsets=linearise(PINHOLE, views, state, 0.1).q)
        return state.offsets

    state = dataclasses.replace(state, offsets=best_offsets(state, views))
    linear = linearise(PINHOLE, views, state, 0.1)
    for k in range(12):
        step = np.zeros(12)
        step[k] = 1e-5
        ahead = best_offsets(state.stepped(step, state.offsets), views)
        behind = best_offsets(state.stepped(-step, state.offsets), views)
        slope = (ahead - behind) / 2e-5
        assert np.abs(slope + linear.M[:, :, k]).max() < 2e-2 * max(1.0, np.abs(linear.M[:, :, k]).max())
    larger = dataclasses.replace(views, points=(1.0 + 1e-5) * views.points)
    slope = (best_offsets(state, larger) - state.offsets) / 1e-5
    assert np.abs(slope + linear.by_scale).max() < 2e-2


def test_a_swapped_pair_of_pictures_is_named_and_left_out(good):
    pixels = list(good.pixels)
    pixels[2], pixels[7] = pixels[7], pixels[2]
    found = calibrated(good, image_points=pixels)
    assert set(range(12)) - set(found.used) == {2, 7}
    assert "do not belong together" in found.views[2].reason
    error = error_of(found.flange_T_camera, FLANGE_T_CAMERA)
    assert error @ np.linalg.solve(found.covariance, error) < chi2.ppf(0.99, 6)


def test_a_pose_from_which_the_board_is_behind_the_camera_is_named_and_left_out(good):
    away = Rotation.from_rotvec([np.pi, 0.0, 0.0])
    poses = [RigidTransform.from_components(p.translation, p.rotation * away) if i == 4 else p
             for i, p in enumerate(good.base_T_flange)]  # fmt: skip
    found = calibrated(good, base_T_flange=poses)
    assert set(range(12)) - set(found.used) == {4}
    error = error_of(found.flange_T_camera, FLANGE_T_CAMERA)
    assert error @ np.linalg.solve(found.covariance, error) < chi2.ppf(0.99, 6)


def test_wrong_corners_of_a_view_are_left_out(good):
    pixels = [p.copy() for p in good.pixels]
    pixels[3][:5] += 20.0
    found = calibrated(good, image_points=pixels)
    assert found.views[3].corners == len(BOARD.points) - 5
    error = error_of(found.flange_T_camera, FLANGE_T_CAMERA)
    assert error @ np.linalg.solve(found.covariance, error) < chi2.ppf(0.99, 6)


def test_a_board_whose_first_corner_is_anybodys_choice_is_turned_to_fit(good):
    middle = BOARD.points.mean(axis=0)
    half = Rotation.from_rotvec([0.0, 0.0, np.pi])
    turn = RigidTransform.from_components(middle - half.apply(middle), half)
    points = [turn.apply(p) if i % 3 == 1 else p for i, p in enumerate(good.points)]
    found, plain = calibrated(good, object_points=points, turns=(turn,)), calibrated(good)
    assert len(found.used) == 12
    assert np.abs(error_of(found.flange_T_camera, plain.flange_T_camera)).max() < 1e-6


def test_a_board_of_another_size_is_noticed_and_the_uncertainty_reaches_to_the_truth(good):
    found = calibrated(good, object_points=[0.97 * p for p in good.points])
    assert found.board_size_disputed
    assert found.board_scale == pytest.approx(1.0 / 0.97, abs=4.0 * found.board_scale_sigma)
    error = error_of(found.flange_T_camera, FLANGE_T_CAMERA)
    assert error @ np.linalg.solve(found.covariance, error) < chi2.ppf(0.99, 6)


def test_few_views_rotations_about_one_axis_and_no_rotation_are_named(good):
    few = DrawnViews(good.base_T_flange[:3], good.pixels[:3], good.points[:3])
    assert calibrated(few).status == "too_few_views"
    for axis, status in (([0.0, 0.0, 1.0], "one_axis"), ([0.0, 0.0, 0.0], "no_rotation")):
        found = calibrated(_turned_about(np.array(axis)))
        assert found.status == status
        assert found.flange_T_camera is None
        assert np.isnan(found.covariance).all()
    assert "(0.00, 0.00, 1.00)" in calibrated(_turned_about(np.array([0.0, 0.0, 1.0]))).message


def _turned_about(axis):
    """Eight exact views of a flange that moves sideways and turns about one of its axes."""
    drawn = DrawnViews([], [], [])
    for k in range(8):
        down = Rotation.from_euler("x", 180.0, degrees=True)
        flange = RigidTransform.from_components(
            [0.45 + 0.01 * k, -0.1 + 0.01 * (k % 3), 0.5], down * Rotation.from_rotvec(0.2 * k * axis)
        )
        pixels, valid = FISHEYE.project(
            (flange * FLANGE_T_CAMERA).inv().apply(BASE_T_BOARD.apply(BOARD.points))
        )
        assert valid.all()
        drawn.base_T_flange.append(flange)
        drawn.pixels.append(pixels)
        drawn.points.append(np.array(BOARD.points))
    return drawn


def test_inverted_poses_are_named(good):
    found = calibrated(good, base_T_flange=[pose.inv() for pose in good.base_T_flange])
    assert found.status == "poses_inverted"
    assert "base_T_flange is needed" in found.message


def test_poses_of_other_pictures_are_named(good):
    poses = [good.base_T_flange[(5 * i + 3) % 12] for i in range(12)]
    found = calibrated(good, base_T_flange=poses)
    assert found.status == "views_disagree"
    assert "poses of other pictures" in found.message


def test_poses_in_millimetres_are_named_with_the_factor(good):
    poses = [RigidTransform.from_components(1e3 * p.translation, p.rotation) for p in good.base_T_flange]
    found = calibrated(good, base_T_flange=poses)
    assert found.status == "views_disagree"
    assert "multiplied by 0.00" in found.message
    assert "in m" in found.message


def test_views_without_a_board_do_not_count_and_say_so(good):
    pixels = [np.empty((0, 2)) if i < 2 else p for i, p in enumerate(good.pixels)]
    points = [np.empty((0, 3)) if i < 2 else p for i, p in enumerate(good.points)]
    found = calibrated(good, image_points=pixels, object_points=points)
    assert found.used == tuple(range(2, 12))
    assert found.views[0].reason == "the board was not found"


def test_poses_are_read_as_one_transform_a_list_or_matrices(good):
    matrices = np.stack([pose.as_matrix() for pose in good.base_T_flange])
    listed = calibrated(good).flange_T_camera
    for poses in (RigidTransform.concatenate(good.base_T_flange), matrices):
        found = calibrated(good, base_T_flange=poses)
        assert np.abs(error_of(found.flange_T_camera, listed)).max() < 1e-9


def test_wrong_calls_are_one_message(good):
    matrices = np.stack([pose.as_matrix() for pose in good.base_T_flange])
    bad = matrices.copy()
    bad[4, 0, 0] = np.nan
    sheared = matrices.copy()
    sheared[3, 0, 1] += 0.1
    mirrored = matrices.copy()
    mirrored[2, :3, 0] *= -1.0
    corner = [p.copy() for p in good.pixels]
    corner[6][0, 1] = np.inf
    short = [*good.points[:5], good.points[5][:-1], *good.points[6:]]
    for changed, words in (
        ({"base_T_flange": matrices[:5]}, "image_points: 12 views given for 5 poses"),
        ({"base_T_flange": bad}, "base_T_flange: nan at index"),
        ({"base_T_flange": sheared}, r"base_T_flange\[3\]: R Rᵀ is off"),
        ({"base_T_flange": mirrored}, r"base_T_flange\[2\]: a reflection"),
        ({"base_T_flange": matrices[:, :3]}, "base_T_flange: shape"),
        ({"image_points": corner}, r"image_points\[6\]: inf at index"),
        ({"object_points": short}, r"object_points\[5\]: 53 rows given, image_points\[5\] has 54"),
    ):
        with pytest.raises(InputError, match=words):
            calibrated(good, **changed)


@pytest.mark.slow
@pytest.mark.parametrize(("views", "seed"), [(6, 2), (7, 2), (7, 4), (7, 10)])
@pytest.mark.parametrize("noise", [0.0, 3e-3])
def test_few_views_of_a_camera_that_stands_still_are_never_taken_for_one_in_the_hand(views, seed, noise):
    drawn = draw_views(np.random.default_rng(seed), FISHEYE, views, position=noise, rotation=3.0 * noise)
    standing = [pose.inv() for pose in drawn.base_T_flange]
    found = calibrate_hand_eye(FISHEYE, standing, drawn.pixels, drawn.points)
    assert found.status == "poses_inverted"
    assert "flange_T_base" in found.message
    assert calibrate_hand_eye(FISHEYE, drawn.base_T_flange, drawn.pixels, drawn.points).status == "ok"


def _tag_views(seed: int) -> DrawnViews:
    """Eight views of four corners: how far the board is, is known little better than where the robot is."""
    drawn = draw_views(np.random.default_rng(seed), PINHOLE, 8, px=0.2, position=3e-4, rotation=6e-4)
    rows = [20, 22, 40, 38]
    pixels, points = ([all_[rows] for all_ in views] for views in (drawn.pixels, drawn.points))
    return dataclasses.replace(drawn, pixels=pixels, points=points)


@pytest.mark.parametrize("seed", [91, 185])
def test_a_tag_is_enough_where_the_likelihood_has_a_long_tail_towards_an_exact_robot(seed):
    found = calibrated(_tag_views(seed))
    assert found.status == "ok", found.message
    off = error_of(found.flange_T_camera, FLANGE_T_CAMERA)
    assert off @ np.linalg.solve(found.covariance, off) < chi2(6).ppf(0.999)


def test_the_step_is_the_mean_over_all_sizes_of_the_robots_errors():
    """Against a plain sum over 60 × 60 of them."""
    drawn = _tag_views(91)
    poses = RigidTransform.concatenate(drawn.base_T_flange)
    views = SeenViews(poses, np.concatenate(drawn.pixels), np.concatenate(drawn.points), 4 * np.arange(9))
    state = LoopState(FLANGE_T_CAMERA, BASE_T_BOARD, np.zeros((8, 6)))
    linear = linearise(PINHOLE, views, state, 0.2)
    found = solve_loop(linear)
    sizes = np.exp(np.linspace(*np.log([2e-6, 2e-2]), 60))
    steps, variances, logs = zip(*(_generalised(linear, a, b) for a in sizes for b in sizes), strict=True)
    weights = np.exp(np.array(logs) - max(logs))
    weights /= weights.sum()
    deviations = np.sqrt(np.diag(found.covariance))
    assert np.abs((weights @ np.array(steps) - found.step) / deviations).max() < 5e-3
    assert np.abs(np.sqrt(weights @ np.array(variances)) / found.sigmas - 1.0).max() < 1e-2


def _generalised(linear: LinearLoop, position: float, rotation: float):
    """Return the step of generalised least squares, (σ_t², σ_r²) and ln(likelihood · σ_t² σ_r²)."""
    V = linear.C + np.diag(np.repeat([position**2, rotation**2], 3))
    MV = np.swapaxes(np.linalg.solve(V, linear.M), 1, 2)
    normal = (MV @ linear.M).sum(axis=0)
    step = np.linalg.solve(normal, (MV @ linear.q[:, :, None]).sum(axis=0))[:, 0]
    left = linear.q - linear.M @ step
    square = np.einsum("ni,ni->", left, np.linalg.solve(V, left[:, :, None])[:, :, 0])
    logdets = np.linalg.slogdet(V)[1].sum() + np.linalg.slogdet(normal)[1]
    return step, (position**2, rotation**2), 2.0 * np.log(position * rotation) - 0.5 * (logdets + square)
