"""Calibration from corners: what is found, what is refused, and what is said about it."""

import numpy as np
import pytest
from board_views import board, draw_views

import omniservo
from omniservo import InputError, UnifiedCamera, calibrate_camera, preset
from omniservo.calibration.adjustment.calibration import spelled_parameters
from omniservo.calibration.adjustment.lens import NAMES

FISHEYE = preset("fe185")
SIZE = (659, 432)
SEEING = {"distances": (0.08, 0.2)}


def values(camera):
    return np.array([camera.fx, camera.fy, camera.cx, camera.cy, camera.xi, *camera.distortion])


@pytest.fixture(scope="module")
def drawn():
    """Ten views of the paper's fisheye with 0.3 px of noise."""
    return draw_views(FISHEYE, np.random.default_rng(0), views=10, **SEEING)


@pytest.fixture(scope="module")
def clean(drawn):
    return calibrate_camera(*drawn, SIZE, distortion="none")


CAMERAS = {
    "fisheye": (FISHEYE, {"largest_angle": 1.5}),
    "parabolic mirror": (UnifiedCamera(338, 338.5, 641, 515, 1.0, 1280, 1024), {"largest_angle": 1.6}),
    "perspective": (UnifiedCamera(420, 425, 319, 235, 0.0, 640, 480), {"distances": (0.4, 0.8)}),
    "telephoto": (UnifiedCamera(2400, 2390, 325, 241, 0.0, 640, 480), {"distances": (1.5, 2.5)}),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", CAMERAS)
def test_exact_corners_give_the_exact_camera(name):
    camera, draw = CAMERAS[name]
    settings = {"largest_angle": 0.35, **SEEING, **draw}
    seen = draw_views(camera, np.random.default_rng(1), views=8, noise_px=0.0, **settings)
    found = calibrate_camera(*seen, (camera.width, camera.height), distortion="none")
    assert found.status == "ok", found.message
    assert found.rms_px < 1e-6
    np.testing.assert_allclose(values(found.camera), values(camera), rtol=1e-5, atol=1e-5)


@pytest.mark.slow
def test_exact_corners_of_a_distorted_lens_give_its_rays_and_auto_takes_distortion():
    camera = UnifiedCamera(420, 425, 319, 235, 0.9, 640, 480, distortion=(-0.28, 0.07, 1e-3, -5e-4))
    seen = draw_views(camera, np.random.default_rng(2), views=10, noise_px=0.1, largest_angle=0.8, **SEEING)
    found = calibrate_camera(*seen, (640, 480))
    assert found.status == "ok", found.message
    assert found.distortion == "radtan", found.distortion_reason
    rays = camera.unproject(np.concatenate(seen[0]))[0]
    error = found.camera.project(rays)[0] - camera.project(rays)[0]
    assert np.linalg.norm(error, axis=1).max() < found.deviation_px < 1.5


@pytest.mark.slow
def test_a_target_far_from_the_origin_of_its_frame_gives_the_same_camera_and_its_own_poses(drawn, clean):
    away = np.array([1000.0, -2000.0, 500.0])
    found = calibrate_camera(drawn[0], [points + away for points in drawn[1]], SIZE, distortion="none")
    assert found.status == "ok", found.message
    np.testing.assert_allclose(values(found.camera), values(clean.camera), rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(found.poses[0].apply(away), clean.poses[0].apply([0.0, 0.0, 0.0]), atol=1e-6)


@pytest.mark.slow
def test_without_distortion_auto_stays_with_the_plain_model_and_gives_the_numbers(drawn):
    found = calibrate_camera(*drawn, SIZE)
    assert found.distortion == "none"
    assert found.camera.distortion == (0.0, 0.0, 0.0, 0.0)
    assert found.distortion_reason.startswith("the views do not support distortion: on views left out")
    assert f"{found.held_out.px:.4g} px" in found.distortion_reason


def test_every_length_of_a_camera_is_said_in_pixels_and_the_rest_without_a_unit(clean):
    said = {name: words for name, *words in spelled_parameters(clean)}
    assert list(said) == list(clean.parameter_names)
    for name, words in said.items():
        assert all(word.endswith(" px") == (name in ("fx", "fy", "cx", "cy")) for word in words)
    assert f"fx = {clean.camera.fx:.6g} px ± " in clean.report()


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_a_narrow_view_that_says_little_of_distortion_gives_a_camera_all_the_same(seed):
    camera = preset("perspective")
    settings = {"largest_angle": 0.3, "distances": (0.4, 0.8)}
    found = calibrate_camera(
        *draw_views(camera, np.random.default_rng(seed), views=12, **settings), (640, 480)
    )
    assert found.status == "ok", found.message
    assert found.distortion == "none"
    assert found.rms_px == pytest.approx(0.3 * np.sqrt(2.0), rel=0.1)


@pytest.mark.slow
def test_a_mirrors_sign_is_kept_from_the_camera_given_and_the_mirror_of_the_result_fits_as_well():
    camera = preset("hyper-catadioptric")
    seen = draw_views(camera, np.random.default_rng(3), views=8, noise_px=0.0, largest_angle=1.5, **SEEING)
    size = (camera.width, camera.height)
    given = calibrate_camera(*seen, size, distortion="none", camera=camera)
    np.testing.assert_allclose(values(given.camera), values(camera), rtol=1e-5, atol=1e-5)
    assert given.camera.dead_zone == camera.dead_zone
    assert given.seen_from == "-z"  # as drawn
    blind = calibrate_camera(*seen, size, distortion="none")
    assert blind.seen_from == "+z"  # a board seen from behind: the sign of a mirror
    assert blind.rms_px < 1e-6
    mirrored = blind.mirrored()
    rays = np.random.default_rng(0).normal(size=(500, 3))
    reflected = rays * [1.0, -1.0, 1.0]
    np.testing.assert_allclose(mirrored.project(reflected)[0], blind.camera.project(rays)[0], atol=1e-9)


def test_a_solid_target_shows_the_mirror_by_itself():
    camera = preset("hyper-catadioptric")
    solid = board(5, 4, 0.05)
    solid[:, 2] = 0.05 * (np.arange(20) % 3)
    seen = draw_views(camera, np.random.default_rng(4), views=8, noise_px=0.1, target=solid, **SEEING)
    found = calibrate_camera(*seen, (camera.width, camera.height), distortion="none")
    assert found.status == "ok", found.message
    assert found.seen_from == "solid"
    assert found.camera.fx * found.camera.fy < 0.0
    assert found.rms_px < 0.16


def planted(drawn):
    """Two good thirds, and wrong views and corners among them; what was planted where."""
    rng = np.random.default_rng(5)
    pixels, points = [np.array(p) for p in drawn[0]], list(drawn[1])
    permuted, stretched, smaller, noisy = (np.array(pixels[i]) for i in (0, 1, 2, 3))
    pixels += [permuted[rng.permutation(54)], stretched, smaller * 0.6, noisy]
    points += [points[0], points[1] * [1.0, 1.3, 1.0], points[2], points[3]]
    pixels[-1][rng.choice(54, 25, replace=False)] += rng.uniform(15, 40, (25, 1))
    pixels[-1] = np.clip(pixels[-1], 0, [658, 431])
    pixels[4][17] += [6.0, -5.0]
    pixels[7][[0, 1]] = pixels[7][[1, 0]]
    return pixels, points


def test_wrong_views_and_corners_are_dropped_and_each_is_named(drawn, clean):
    found = calibrate_camera(*planted(drawn), SIZE, distortion="none")
    assert found.status == "ok", found.message
    assert set(found.views_dropped) == {10, 11, 12, 13}
    assert "out of order" in found.views_dropped[10]
    assert "measures are wrong" in found.views_dropped[11]
    assert "another camera, zoom or size" in found.views_dropped[12]
    assert (
        "of 54 corners are too far off" in found.views_dropped[13]
        or "out of order" in found.views_dropped[13]
    )
    assert {view: set(rows) for view, rows in found.corners_dropped.items()} == {4: {17}, 7: {0, 1}}
    assert found.views_used == tuple(range(10))
    np.testing.assert_allclose(values(found.camera), values(clean.camera), atol=1.0, rtol=0.003)
    for text in (*found.views_dropped.values(), *found.corners_dropped[7].values()):
        assert text in found.report()


def test_a_board_turned_by_half_a_turn_changes_nothing(drawn, clean):
    pixels, points = list(drawn[0]), list(drawn[1])
    pixels[3], pixels[6] = pixels[3][::-1], pixels[6][::-1]
    found = calibrate_camera(pixels, points, SIZE, distortion="none")
    np.testing.assert_allclose(values(found.camera), values(clean.camera), rtol=1e-4)
    assert found.views_used == clean.views_used


def test_views_may_show_different_parts_of_the_target(drawn, clean):
    rng = np.random.default_rng(6)
    parts = [np.sort(rng.choice(54, size, replace=False)) for size in range(30, 50, 2)]
    pixels = [p[part] for p, part in zip(drawn[0], parts, strict=True)]
    points = [p[part] for p, part in zip(drawn[1], parts, strict=True)]
    found = calibrate_camera(pixels, points, SIZE, distortion="none")
    assert found.status == "ok"
    assert found.camera.xi == pytest.approx(clean.camera.xi, rel=0.02)
    assert [len(r) for r in found.residuals.values()] == [len(part) for part in parts]


def test_the_result_states_itself_consistently(clean, drawn):
    assert clean.parameter_names == NAMES[:5]
    assert clean.covariance.shape == (5, 5)
    squares = np.concatenate([(r**2).sum(1) for r in clean.residuals.values()])
    assert clean.rms_px == pytest.approx(np.sqrt(squares.mean()))
    assert clean.noise_px == pytest.approx(0.3, rel=0.05)
    for i, pose in clean.poses.items():
        projected, valid = clean.camera.project(pose.apply(drawn[1][i]))
        assert valid.all()
        np.testing.assert_allclose(projected - drawn[0][i], clean.residuals[i], atol=1e-9)
    assert clean.camera.max_angle <= clean.coverage.largest_angle + np.radians(3.001)
    assert 0.2 < clean.coverage.image_fraction < 0.9
    assert clean.held_out.px == pytest.approx(clean.rms_px, rel=0.15)
    assert clean.camera.deviation_px == clean.deviation_turned_px <= clean.deviation_px
    assert (np.diff(clean.ray_angles) > 0.0).all()


def test_the_true_camera_is_within_the_stated_deviation(clean):
    grid = np.stack(np.meshgrid(np.linspace(-1.6, 1.6, 41), np.linspace(-1.6, 1.6, 41)), -1).reshape(-1, 2)
    angle = np.linalg.norm(grid, axis=1)
    rays = np.concatenate([grid * np.sinc(angle / np.pi)[:, None], np.cos(angle)[:, None]], 1)
    rays = rays[angle < min(clean.camera.max_angle, FISHEYE.max_angle)]
    true, _ = FISHEYE.project(rays)
    inside = FISHEYE.in_image(true)
    found, valid = clean.camera.project(rays[inside])
    assert valid.all()
    assert np.linalg.norm(found - true[inside], axis=1).max() <= clean.deviation_px


def test_xi_and_focal_length_are_called_unidentifiable_with_distortion_and_the_equivalents_hold(drawn):
    found = calibrate_camera(*drawn, SIZE, distortion="radtan")
    assert not found.identifiable["xi"]
    assert not found.identifiable["fx"]
    assert "not identifiable: xi, fx" in found.report()
    assert len(found.equivalent) >= 3
    assert all(e.rms_px < 0.1 for e in found.equivalent)
    assert found.equivalent[-1].xi > 1.1 * found.equivalent[0].xi


def test_equal_calls_give_equal_results(drawn, clean):
    again = calibrate_camera(*drawn, SIZE, distortion="none")
    assert again.camera == clean.camera
    assert again.deviation_px == clean.deviation_px


class TestNoCamera:
    """Data that do not determine a camera have a status, and no camera."""

    def named(self, pixels, points, size=SIZE, **options):
        found = calibrate_camera(pixels, points, size, **options)
        assert found.camera is None
        assert found.message.startswith(found.status)
        assert np.isnan(found.rms_px)
        with pytest.raises(InputError, match="no camera"):
            found.mirrored()
        return found.status

    def test_too_few_views(self, drawn):
        assert self.named(drawn[0][:2], drawn[1][:2]) == "too_few_views"
        assert self.named([], []) == "too_few_views"

    def test_the_same_view_again_and_again(self, drawn):
        rng = np.random.default_rng(7)
        again = [drawn[0][0] + rng.normal(scale=0.1, size=(54, 2)) for _ in range(8)]
        assert self.named(again, drawn[1][:8]) == "views_alike"

    @pytest.mark.slow
    def test_targets_parallel_to_the_image(self):
        camera = UnifiedCamera(420, 420, 319.5, 239.5, 0.0, 640, 480)
        rng = np.random.default_rng(8)
        seen = [
            camera.project(board() + np.array([x - 0.12, y - 0.08, z]))[0]
            + rng.normal(scale=0.1, size=(54, 2))
            for x, y, z in rng.uniform([-0.1, -0.05, 0.4], [0.1, 0.05, 0.8], (9, 3))
        ]
        assert self.named(seen, [board()] * 9, (640, 480)) == "views_alike"

    @pytest.mark.slow
    def test_corners_that_belong_to_no_board(self):
        rng = np.random.default_rng(9)
        seen = [rng.uniform([0, 0], SIZE, (54, 2)) - 0.4 for _ in range(6)]
        assert self.named(seen, [board()] * 6) == "views_disagree"

    def test_views_with_corners_on_a_line_are_named(self, drawn):
        line = [(p[:9], q[:9]) for p, q in zip(drawn[0][:2], drawn[1][:2], strict=True)]
        pixels = [*drawn[0][:2], *(p for p, _ in line)]
        points = [*drawn[1][:2], *(q for _, q in line)]
        assert self.named(pixels, points) == "too_few_views"
        assert "on a line on the board" in calibrate_camera(pixels, points, SIZE).views_dropped[2]


class TestWrongCalls:
    """A wrong call raises one message that says where."""

    def says(self, pattern, pixels, points, size=SIZE, **options):
        with pytest.raises(InputError, match=pattern) as caught:
            calibrate_camera(pixels, points, size, **options)
        assert "\n" not in str(caught.value)

    def test_lists_that_do_not_match(self, drawn):
        self.says("object_points: 9 views given, image_points has 10", drawn[0], drawn[1][:9])
        shorter = [drawn[1][0][:50], *drawn[1][1:]]
        self.says(r"object_points\[0\]: 50 rows given, image_points\[0\] has 54", drawn[0], shorter)

    def test_not_a_number(self, drawn):
        pixels = [np.array(p) for p in drawn[0]]
        pixels[3][7, 1] = np.nan
        self.says(r"image_points\[3\]: row 7: \[.*nan\] given", pixels, drawn[1])
        pixels[3] = np.ma.masked_invalid(pixels[3])
        self.says(r"image_points\[3\]: 1 masked entries given", pixels, drawn[1])
        self.says(r"image_points\[0\]: .* numbers \(k, 2\)", [["a"], *pixels[1:]], drawn[1])
        self.says(r"image_points\[0\]: shape \(54, 3\) given", [board(), *pixels[1:]], drawn[1])

    def test_absurd_coordinates(self, drawn):
        points = [*drawn[1][:9], drawn[1][9] * 1e300]
        self.says(r"object_points\[9\]: row \d+: .* given; legal: at most 1e\+06", drawn[0], points)

    def test_a_corner_outside_the_image(self, drawn):
        self.says(r"image_points\[\d\]: row \d+: .*outside the image of 300 × 200 px", *drawn, (300, 200))

    def test_a_size_or_model_or_camera_that_is_none(self, drawn):
        self.says("image_size", *drawn, (659.5, 432))
        self.says("image_size", *drawn, 659)
        self.says("distortion: 'kb4' given; legal", *drawn, distortion="kb4")
        self.says("camera: made for 640 × 480 px", *drawn, camera=preset("perspective"))
        self.says("camera: str given", *drawn, camera="fe185")
        skewed = UnifiedCamera(300, 300, 320, 210, 1, 659, 432, skew=2.0)
        self.says("skew 2 given", *drawn, camera=skewed)


def test_opencvs_shapes_are_accepted(drawn, clean):
    found = calibrate_camera(
        [p[:, None, :] for p in drawn[0]], [p[None] for p in drawn[1]], SIZE, distortion="none"
    )
    assert found.camera == clean.camera


def test_it_is_a_public_name():
    assert omniservo.calibrate_camera is calibrate_camera


def test_where_xi_cannot_be_known_the_simplest_is_taken():
    """A perspective lens with distortion: ξ and k1, k2 trade, and the best fit may have any ξ."""
    camera = UnifiedCamera(600, 602, 322, 238, 0.0, 640, 480, distortion=(-0.1, 0.08, 1e-3, -5e-4))
    draw = {"views": 10, "noise_px": 0.2, "largest_angle": 0.2, "distances": (0.35, 0.6)}
    seen = draw_views(camera, np.random.default_rng(4), **draw)
    found = calibrate_camera(*seen, (640, 480), distortion="radtan")
    assert found.status == "ok", found.message
    assert found.camera.xi == 0.0
    assert not found.identifiable["xi"]
    assert found.camera.fx == pytest.approx(600, rel=0.01)
    assert found.camera.distortion[0] == pytest.approx(-0.1, abs=0.05)
