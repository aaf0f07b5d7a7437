"""Dots in exactly rendered pictures, at ordinary and at awkward places."""

import time

import dot_scenes
import numpy as np
import pytest
from dot_scenes import Patch, Scene, dot_patches, expose, intensity, plane_axes, render

from omniservo.cameras import UnifiedCamera
from omniservo.errors import InputError
from omniservo.perception import DotOptions, DotTracker, find_dots

CAMERA = dot_scenes.paper_camera()
FRONT = np.array([0.0, 0.0, -1.0])


def ray(off_axis, azimuth=0.0):
    off, turn = np.deg2rad(off_axis), np.deg2rad(azimuth)
    return np.array([np.sin(off) * np.cos(turn), np.sin(off) * np.sin(turn), np.cos(off)])


def one_dot(off_axis=20.0, distance=0.3, tilt=0.0, radius=0.008, azimuth=0.0, *, board=4.0):
    """Patches of one dot, and the exact image of its centre."""
    sight = ray(off_axis, azimuth)
    frame = plane_axes(-sight)
    normal = np.cos(np.deg2rad(tilt)) * frame[:, 2] + np.sin(np.deg2rad(tilt)) * frame[:, 0]
    patches = dot_patches(distance * sight[None], normal[None], radius, board=board)
    return patches, CAMERA.project(distance * sight)[0]


def errors(dots, true):
    return np.linalg.norm(dots.pixels - true, axis=1)


def board_of_nine(tilt, distance=0.25, radius=0.01, step=0.04):
    """Nine dots on one plane; patches and the exact images of the centres."""
    frame = plane_axes(FRONT) @ _about_y(tilt)
    x, y = (g.ravel() * step for g in np.meshgrid([-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0]))
    centres = np.array([0.0, 0.0, distance]) + np.stack([x, y], 1) @ frame[:, :2].T
    board = Patch(np.array([0, 0, distance]) - 1e-4 * frame[:, 2], frame, (0.09, 0.09), 215.0)
    dots = dot_patches(centres, np.tile(frame[:, 2], (9, 1)), radius)[1::2]
    return [board, *dots], CAMERA.project(centres)[0]


def _about_y(angle):
    c, s = np.cos(np.deg2rad(angle)), np.sin(np.deg2rad(angle))
    return np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])


@pytest.mark.parametrize("off_axis", [0.0, 45.0, 80.0])
@pytest.mark.parametrize("tilt", [0.0, 60.0])
def test_a_single_dot_is_found_within_a_fifth_of_a_pixel(off_axis, tilt):
    patches, true = one_dot(off_axis, 0.3, tilt)
    dots = find_dots(render(CAMERA, Scene(patches)), CAMERA)
    assert len(dots) == 1
    assert errors(dots, true)[0] < 0.2


def test_a_frontal_dot_is_found_to_a_few_hundredths_of_a_pixel():
    for seed in range(8):
        patches, true = one_dot(10.0 * seed, 0.3)
        dots = find_dots(render(CAMERA, Scene(patches), rng=np.random.default_rng(seed)), CAMERA)
        assert errors(dots, true)[0] < 0.05


@pytest.mark.parametrize("tilt", [20.0, 45.0, 60.0])
def test_neighbours_tell_which_side_a_circle_leans(tilt):
    patches, true = board_of_nine(tilt)
    image = render(CAMERA, Scene(patches))
    centres, centroids = find_dots(image, CAMERA), find_dots(image)
    corrected = np.linalg.norm(centres.pixels[:, None] - true, axis=2).min(1)
    plain = np.linalg.norm(centroids.pixels[:, None] - true, axis=2).min(1)
    assert len(centres) == 9
    assert corrected.max() < 0.05
    assert plain.max() > 0.1


def test_area_and_covariance_are_those_of_the_outline():
    patches, _ = one_dot(30.0, 0.2, 50.0, 0.01)
    dots = find_dots(render(CAMERA, Scene(patches)), CAMERA)
    outline = CAMERA.project(patches[1].outline(2000))[0]
    assert dots.area_px[0] == pytest.approx(dot_scenes.image_area(CAMERA, patches[1]), rel=0.02)
    # an ellipse's second moments are half of its outline's, taken evenly in the circle's angle
    expected = 0.5 * np.cov(outline.T)
    assert np.abs(dots.covariance[0] - expected).max() < 0.03 * expected.max()


def test_nine_dots_come_top_to_bottom():
    patches, _ = board_of_nine(30.0)
    dots = find_dots(render(CAMERA, Scene(patches)), CAMERA)
    assert (np.diff(dots.pixels[:, 1]) >= 0).all()


def test_a_dot_of_twelve_square_pixels_is_found():
    patches, true = one_dot(0.0, 0.6, 0.0, 0.00905)
    assert 11.5 < dot_scenes.image_area(CAMERA, patches[1]) < 13
    for seed in range(10):
        dots = find_dots(render(CAMERA, Scene(patches), rng=np.random.default_rng(seed)), CAMERA)
        assert errors(dots, true)[0] < 0.1


def test_a_dot_of_eighty_pixels_is_found():
    camera = UnifiedCamera(600, 600, 319.5, 239.5, 0.0, 640, 480)
    centre = np.array([[0.02, 0.01, 0.2]])
    picture = render(camera, Scene(dot_patches(centre, -centre, 0.0133)))
    dots = find_dots(picture, camera)
    assert len(dots) == 1
    assert errors(dots, camera.project(centre)[0])[0] < 0.05


def test_two_dots_four_pixels_apart_are_both_found():
    gap = np.array([[-0.0125, 0, 0.3], [0.0125, 0, 0.3]])
    patches = dot_patches(gap, np.tile(FRONT, (2, 1)), 0.008)
    plate = Patch(np.array([0, 0, 0.3001]), plane_axes(FRONT), (0.06, 0.06), 215.0)
    true = CAMERA.project(gap)[0]
    dots = find_dots(render(CAMERA, Scene([plate, *patches[1::2]])), CAMERA)
    assert len(dots) == 2
    assert np.linalg.norm(dots.pixels[:, None] - true, axis=2).min(1).max() < 0.1


@pytest.mark.slow
def test_three_thousand_dots_are_found_in_seconds():
    """Each was compared with every other one in Python: 2400 took ten seconds, 10 000 minutes."""
    v, u = np.mgrid[:1500, :1500]
    away = np.hypot((u + 13.5) % 27 - 13.5, (v + 13.5) % 27 - 13.5)
    image = np.clip(20.0 + 210.0 * (away - 5.5), 20.0, 230.0).astype(np.uint8)
    find_dots(image[:200, :200])
    started = time.process_time()
    found = find_dots(image)
    assert time.process_time() - started < 4.0
    assert len(found.pixels) == 55**2
    np.testing.assert_allclose(found.pixels, 27.0 * np.round(found.pixels / 27.0), atol=0.01)


@pytest.mark.parametrize("grey", [20.0, 120.0, 180.0])
@pytest.mark.parametrize("part", [0.3, 0.5, 0.7])
def test_a_partly_hidden_dot_is_no_dot(grey, part):
    patches, _ = one_dot(15.0, 0.25, 20.0, 0.01, board=10)
    edge = 0.25 * ray(15.0) + plane_axes(-ray(15.0))[:, 0] * 0.01 * (1 - 2 * part)
    axes = plane_axes(-ray(15.0))
    cover = Patch(0.9 * edge + 0.03 * axes[:, 0], axes, (0.03, 0.03), grey)
    assert len(find_dots(render(CAMERA, Scene([*patches, cover])), CAMERA)) == 0


def test_a_dot_cut_by_the_image_border_is_no_dot():
    edge = CAMERA.unproject(np.array([2.0, 255.0]))[0]
    patches = dot_patches(0.3 * edge[None], -edge[None], 0.008)
    assert len(find_dots(render(CAMERA, Scene(patches)), CAMERA)) == 0


@pytest.mark.parametrize("off_axis", [91.5, 92.5])
def test_a_dot_touching_the_image_circle_is_no_dot(off_axis):
    patches, _ = one_dot(off_axis, 0.3, azimuth=180.0)
    assert len(find_dots(render(CAMERA, Scene(patches)), CAMERA)) == 0


def test_a_dot_near_the_image_circle_is_found():
    patches, true = one_dot(86.0, 0.3, azimuth=180.0)
    dots = find_dots(render(CAMERA, Scene(patches, background=200.0)), CAMERA)
    assert errors(dots, true)[0] < 0.1


def test_symmetric_motion_blur_keeps_the_centre():
    patches, true = one_dot(20.0, 0.2, 0.0, 0.009)
    exact = intensity(CAMERA, Scene(patches))
    moved = (np.roll(exact, 1, 1) + exact + np.roll(exact, -1, 1)) / 3
    dots = find_dots(expose(moved), CAMERA)
    assert errors(dots, true)[0] < 0.05


def test_a_saturated_ground_keeps_the_centre():
    patches, true = one_dot(20.0, 0.25)
    exact = np.minimum(intensity(CAMERA, Scene(patches)) * 1.3, 255.0)
    dots = find_dots(expose(exact), CAMERA)
    assert errors(dots, true)[0] < 0.05


def test_a_dot_on_a_sloping_illumination_keeps_its_centre():
    patches, true = one_dot(20.0, 0.25)
    ramp = np.linspace(0.5, 1.1, CAMERA.width)
    dots = find_dots(expose(intensity(CAMERA, Scene(patches)) * ramp), CAMERA)
    assert errors(dots, true)[0] < 0.05


@pytest.mark.parametrize("sigma", [0.0, 2.0, 20.0, 60.0])
def test_a_picture_of_noise_has_no_dots(sigma):
    assert len(find_dots(expose(np.full((432, 659), 128.0), noise=sigma), CAMERA)) == 0


@pytest.mark.parametrize("grey", [0, 255])
def test_an_even_picture_has_no_dots(grey):
    assert len(find_dots(np.full((432, 659), grey, np.uint8), CAMERA)) == 0


def test_bright_dots_on_a_dark_ground_are_no_dots():
    patches, _ = one_dot()
    picture = 255 - render(CAMERA, Scene(patches, background=215.0))
    assert len(find_dots(picture)) == 0


def test_bars_squares_and_edges_are_no_dots():
    rng = np.random.default_rng(0)
    shapes = []
    for half in [(0.002, 0.03), (0.03, 0.03), (0.1, 0.004), (0.012, 0.012), (0.02, 0.014)]:
        where = 0.4 * ray(rng.uniform(10, 50), rng.uniform(0, 360))
        shapes.append(Patch(where, plane_axes(-where, rng.uniform(0, 3)), half, 20.0))
    assert len(find_dots(render(CAMERA, Scene(shapes, background=200.0)), CAMERA)) == 0


def test_mirrored_camera_gives_mirrored_dots():
    mirror = dot_scenes.paper_camera(fx=-296.9365)
    patches, _ = board_of_nine(30.0)
    picture = render(mirror, Scene(patches))
    dots = find_dots(picture, mirror)
    centres = np.array([patch.centre for patch in patches[1:]])
    gaps = np.linalg.norm(dots.pixels[:, None] - mirror.project(centres)[0], axis=2)
    assert gaps.min(1).max() < 0.05


def test_what_lies_in_dead_zone_or_mask_is_no_dot():
    patches, true = board_of_nine(0.0)
    (u, v), hidden = true[8], {"dead_zone": (tuple(true[0]), 12.0)}
    hidden["mask"] = [[[u - 12, v - 12], [u + 12, v - 12], [u + 12, v + 12], [u - 12, v + 12]]]
    picture, camera = render(CAMERA, Scene(patches)), dot_scenes.paper_camera(**hidden)
    assert len(find_dots(picture, CAMERA)) == 9
    found = find_dots(picture, camera)
    assert len(found) == 7
    assert np.linalg.norm(found.pixels[:, None] - true[1:8], axis=2).min(1).max() < 0.2
    assert DotTracker(camera).update(picture, true)[1].tolist() == [False, *[True] * 7, False]


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((432, 659)),
        np.zeros((432, 659, 3), np.uint8),
        np.zeros((0, 659), np.uint8),
        [[1, 2], [3, 4]],
        None,
    ],
)
def test_anything_but_a_grey_picture_is_refused(image):
    with pytest.raises(InputError, match=r"legal: a non-empty uint8 array"):
        find_dots(image)


def test_a_picture_of_another_size_than_the_camera_is_refused():
    with pytest.raises(InputError, match="659×432"):
        find_dots(np.zeros((480, 640), np.uint8), CAMERA)


def test_a_picture_smaller_than_any_dot_has_none():
    assert len(find_dots(np.zeros((3, 3), np.uint8))) == 0


@pytest.mark.parametrize(
    "bad", [{"min_contrast": np.nan}, {"max_diameter": 1}, {"min_area": 1e9}, {"min_aspect": 0}]
)
def test_options_out_of_range_are_refused(bad):
    with pytest.raises(InputError, match=next(iter(bad))):
        DotOptions(**bad)


def test_masked_pixels_of_an_image_are_refused_and_not_looked_at():
    image = np.ma.array(np.full((60, 80), 200, np.uint8), mask=np.zeros((60, 80), bool))
    with pytest.raises(InputError, match="image: a masked array given; legal: all pixels, and a camera with"):
        find_dots(image)
