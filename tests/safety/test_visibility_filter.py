"""The visibility filter: what it lets pass, that its twist is the nearest, and that points stay in view."""

import math

import numpy as np
import pytest
from benchmarks.lens_conversions import PUBLISHED
from scipy.optimize import minimize
from scipy.spatial.transform import RigidTransform

from omniservo.cameras import UnifiedCamera
from omniservo.cameras.image_mask import distance_beyond
from omniservo.errors import InputError
from omniservo.reporting.image_distance import image_distance
from omniservo.safety import SafetyOptions, VisibilityFilter

PERSPECTIVE = UnifiedCamera(420.0, 415.0, 319.5, 239.5, 0.0, 640, 480)
FISHEYE = UnifiedCamera(296.9, 298.4, 316.8, 254.9, 1.291, 659, 432, max_angle=math.radians(92.5))
DISTORTED = UnifiedCamera(300.0, 300.0, 320.0, 240.0, 0.8, 640, 480, distortion=(-0.1, 0.01, 1e-3, -1e-3))
MIRROR = UnifiedCamera(
    180.0, 180.0, 319.5, 239.5, 1.0, 640, 480,
    dead_zone=((319.5, 239.5), 40.0), mask=[[(500, 100), (560, 100), (530, 200)]],
)  # fmt: skip
CAMERAS = {"perspective": PERSPECTIVE, "fisheye": FISHEYE, "distorted": DISTORTED, "mirror": MIRROR}
OPTIONS = SafetyOptions(visibility_margin=2.0)


def seen_points(camera, rng, count, distance=0.5):
    """Points whose pixels lie anywhere in the image, with those pixels."""
    pixels = rng.uniform(0.0, 1.0, (40 * count, 2)) * [camera.width, camera.height]
    bearings, valid = camera.unproject(pixels)
    valid &= np.nan_to_num(image_distance(camera, pixels), nan=-1.0) > OPTIONS.visibility_margin + 0.01
    keep = np.flatnonzero(valid)[:count]
    return bearings[keep] * rng.uniform(0.6, 1.4, (count, 1)) * distance, pixels[keep]


def moved(points, twist, time):
    """Points in the camera frame after so much time of a twist, exactly."""
    motion = RigidTransform.from_exp_coords(np.concatenate([twist[3:], twist[:3]]) * time)
    return motion.inv().apply(points)


def heights(camera, points):
    """Every limit of every point by NumPy alone, (n, limits) [px]."""
    pixels, _ = camera.project(points)
    u, v = pixels.T
    margin = OPTIONS.visibility_margin
    columns = [u + 0.5, camera.width - 0.5 - u, v + 0.5, camera.height - 0.5 - v]
    radius = math.sqrt(camera.parameters[11])
    if math.isfinite(radius):
        r = np.hypot(points[:, 0], points[:, 1]) / (points[:, 2] + camera.xi * np.linalg.norm(points, axis=1))
        columns.append((radius - r) * np.linalg.svd(camera.matrix[:2, :2], compute_uv=False)[-1])
    if camera.dead_zone is not None:
        columns.append(np.hypot(*(pixels - camera.dead_zone.center).T) - camera.dead_zone.radius)
    columns += [distance_beyond((polygon,), pixels) for polygon in camera.mask]
    return np.stack(columns, axis=1) - margin


def rates(camera, points, twist):
    """ḣ by central differences."""
    step = 1e-6
    return (heights(camera, moved(points, twist, step)) - heights(camera, moved(points, twist, -step))) / (
        2 * step
    )


@pytest.mark.parametrize("name", CAMERAS)
def test_every_rate_is_kept_by_finite_differences_of_the_camera(name):
    camera, rng = CAMERAS[name], np.random.default_rng(1)
    held = 0
    for _ in range(60):
        points, pixels = seen_points(camera, rng, int(rng.integers(4, 15)))
        wanted = rng.normal(size=6) * [0.5, 0.5, 0.5, 1.0, 1.0, 1.0]
        answer = VisibilityFilter(camera, options=OPTIONS).step(
            points, pixels, np.ones(len(points), bool), wanted
        )
        slope, height = rates(camera, points, answer.twist), heights(camera, points)
        assert (slope >= -OPTIONS.visibility_rate * height - 1e-3).all()
        assert answer.slack_px < 1e-5
        assert answer.least_height_px == pytest.approx(height.min(), abs=1e-6)
        np.testing.assert_allclose(answer.twist - wanted, answer.change, atol=1e-12)
        held += answer.active > 0
    assert held > 20


@pytest.mark.parametrize("name", CAMERAS)
def test_a_fast_twist_before_near_points_is_held_back_and_not_given_up(name):
    camera, rng = CAMERAS[name], np.random.default_rng(9)
    held = 0
    for distance in (0.1, 0.02, 0.003):
        for _ in range(20):
            points, pixels = seen_points(camera, rng, 12, distance)
            answer = VisibilityFilter(camera, options=OPTIONS).step(
                points, pixels, np.ones(len(points), bool), rng.normal(size=6)
            )
            assert answer.solved
            assert answer.slack_px < 1e-3
            held += answer.active > 0
    assert held > 40


@pytest.mark.parametrize("name", ["perspective", "mirror"])
def test_no_nearer_twist_keeps_the_rates(name):
    camera, rng = CAMERAS[name], np.random.default_rng(2)
    for _ in range(12):
        points, pixels = seen_points(camera, rng, 8)
        wanted = rng.normal(size=6) * [0.2, 0.2, 0.2, 0.5, 0.5, 0.5]
        answer = VisibilityFilter(camera, options=OPTIONS).step(points, pixels, np.ones(8, bool), wanted)
        weight = np.diag([1 / np.linalg.norm(points, axis=1).mean()] * 3 + [1.0] * 3)
        rows = np.stack([rates(camera, points, e).ravel() for e in np.eye(6)], axis=1)
        least = -OPTIONS.visibility_rate * heights(camera, points).ravel()
        best = minimize(
            lambda v, w=weight, c=wanted: float(np.sum((w @ (v - c)) ** 2)), np.zeros(6), method="SLSQP",
            constraints=[{"type": "ineq", "fun": lambda v, a=rows, b=least: (a @ v - b) / 100.0}],
            options={"ftol": 1e-12, "maxiter": 300},
        )  # fmt: skip
        ours = float(np.sum((weight @ (answer.twist - wanted)) ** 2))
        assert ours <= best.fun * (1 + 1e-5) + 1e-8


@pytest.mark.parametrize("name", CAMERAS)
def test_a_twist_that_keeps_every_rate_passes_unchanged(name):
    camera, rng = CAMERAS[name], np.random.default_rng(3)
    points, pixels = seen_points(camera, rng, 6)
    small = 1e-4 * rng.normal(size=6)
    answer = VisibilityFilter(camera, options=OPTIONS).step(points, pixels, np.ones(6, bool), small)
    np.testing.assert_array_equal(answer.twist, small)
    assert answer.active == 0


@pytest.mark.parametrize("name", [*CAMERAS, *PUBLISHED])
def test_random_commands_of_half_a_minute_lose_no_point(name):
    """Of a camera of another model, in its own image."""
    camera, rng = {**CAMERAS, **PUBLISHED}[name], np.random.default_rng(4)
    points, _ = seen_points(camera, rng, 6)
    visibility, lost = VisibilityFilter(camera, options=OPTIONS), False
    blind = points
    for step in range(900):
        if step % 15 == 0:
            wanted = rng.normal(size=6) * [0.1, 0.1, 0.1, 0.3, 0.3, 0.3]
        pixels, valid = camera.project(points)
        assert camera.in_image(pixels).all(), step
        points = moved(points, visibility.step(points, pixels, valid, wanted).twist, 1 / 30)
        if not lost:
            blind = moved(blind, wanted, 1 / 30)
            pixels, valid = camera.project(blind)
            lost = not valid.all() or not camera.in_image(pixels).all()
    assert lost


@pytest.mark.parametrize("name", ["perspective", "fisheye"])
def test_half_a_pixel_of_noise_and_distances_that_are_off_lose_no_point(name):
    camera = CAMERAS[name]
    for seed in range(8):
        rng = np.random.default_rng([6, seed])
        points, _ = seen_points(camera, rng, 8)
        visibility = VisibilityFilter(camera)
        for step in range(240):
            if step % 30 == 0:
                wanted = rng.normal(size=6) * [0.1, 0.1, 0.1, 0.3, 0.3, 0.3]
            pixels, valid = camera.project(points)
            assert camera.in_image(pixels).all(), (seed, step)
            seen = pixels + 0.5 * rng.normal(size=pixels.shape)
            points = moved(points, visibility.step(1.05 * points, seen, valid, wanted).twist, 1 / 30)


def test_a_point_outside_is_brought_back_and_none_inside_is_given_up_for_it():
    points, pixels = np.array([[0.0, 0.0, 0.5], [-0.37, 0.0, 0.5], [0.382, 0.1, 0.5]]), None
    pixels, valid = PERSPECTIVE.project(points)
    height = heights(PERSPECTIVE, points)
    assert (height.min(axis=1) < 0).tolist() == [False, False, True]
    answer = VisibilityFilter(PERSPECTIVE, options=OPTIONS).step(points, pixels, valid, np.zeros(6))
    slope = rates(PERSPECTIVE, points, answer.twist)
    assert slope[2, 1] > 0.0
    assert (slope[:2] >= -OPTIONS.visibility_rate * height[:2] - 1e-3).all()


def test_points_some_hundred_pixels_beyond_an_edge_do_not_make_the_filter_give_up():
    """Their rows are up to a hundred times as long as those of points in view."""
    options = SafetyOptions(visibility_margin=2.0, max_linear_speed=1e9, max_angular_speed=1e9)
    keeper = VisibilityFilter(PERSPECTIVE, options=options)
    for seed in range(400):
        rng = np.random.default_rng(seed)
        points = rng.standard_normal((9, 3)) * rng.uniform(0.05, 0.6) + [0.0, 0.0, 1.0]
        points = points[points[:, 2] > 0.2]
        pixels, _ = PERSPECTIVE.project(points)
        wanted = rng.standard_normal(6) * 10.0 ** rng.uniform(-2.0, 0.5)
        room = heights(PERSPECTIVE, points)
        inside = (room > 0.0).all(axis=1)
        found = keeper.step(points, pixels, inside, wanted, 0.0, np.zeros(6))
        assert found.solved
        rate = (heights(PERSPECTIVE, moved(points, found.twist, 1e-6)) - room) / 1e-6
        lacks = -(rate + options.visibility_rate * room)[inside]
        assert lacks.max(initial=0.0) < 1e-3 * max(1.0, np.abs(rate).max())


def test_a_point_so_far_beyond_the_lens_circle_that_it_has_no_projection_is_brought_back():
    bearing = np.array([math.sin(math.radians(95.0)), 0.0, math.cos(math.radians(95.0))])
    points = np.array([0.5 * bearing, [0.0, 0.1, 0.5]])
    pixels, valid = FISHEYE.project(points)
    assert valid.tolist() == [False, True]
    visibility = VisibilityFilter(FISHEYE, options=OPTIONS)
    answer = visibility.step(points, np.nan_to_num(pixels), valid, np.array([0, 0, 0, 0, -0.5, 0]))
    angle = [math.atan2(c[0], c[2]) for c in (points[0], moved(points, answer.twist, 0.01)[0])]
    assert angle[1] < angle[0]
    assert answer.least_height_px < 0.0


def test_the_delay_carries_the_points_on_by_the_last_twist():
    points, twist = np.array([[0.1, 0.05, 0.5], [-0.1, 0.0, 0.6]]), np.array([0.1, 0, 0, 0.5, 0.2, 0.1])
    pixels, valid = PERSPECTIVE.project(points)
    visibility = VisibilityFilter(PERSPECTIVE, delay=0.05, options=OPTIONS)
    visibility.step(points, pixels, valid, twist)
    expected = heights(PERSPECTIVE, moved(points, twist, 0.05)).min()
    assert visibility.step(points, pixels, valid, twist).least_height_px == pytest.approx(expected, abs=0.3)
    now = heights(PERSPECTIVE, points).min()
    assert abs(now - expected) > 5.0


def test_the_pixel_counts_where_a_point_is_seen_and_the_estimate_where_it_is_not():
    points, pixels = np.array([[0.0, 0.0, 0.5]]), np.array([[600.0, 200.0]])
    visibility = VisibilityFilter(PERSPECTIVE, options=OPTIONS)
    seen = visibility.step(points, pixels, np.array([True]), np.zeros(6))
    hidden = visibility.step(points, pixels, np.array([False]), np.zeros(6))
    assert seen.least_height_px == pytest.approx(639.5 - 600.0 - 2.0)
    assert hidden.least_height_px == pytest.approx(239.5 + 0.5 - 2.0)


def test_speed_limits_hold_whatever_is_wanted():
    rng = np.random.default_rng(5)
    for size in (1.0, 1e3, 1e9):
        points, pixels = seen_points(FISHEYE, rng, 7)
        answer = VisibilityFilter(FISHEYE, options=OPTIONS).step(
            points, pixels, np.ones(7, bool), size * rng.normal(size=6)
        )
        assert np.linalg.norm(answer.twist[:3]) <= OPTIONS.max_linear_speed * (1 + 1e-12)
        assert np.linalg.norm(answer.twist[3:]) <= OPTIONS.max_angular_speed * (1 + 1e-12)
        assert (
            rates(FISHEYE, points, answer.twist) >= -OPTIONS.visibility_rate * heights(FISHEYE, points) - 1e-2
        ).all()


@pytest.mark.parametrize(
    ("points", "wanted", "named"),
    [
        (np.full((2, 3), np.nan), np.zeros(6), "points"),
        (np.ones((2, 3)), np.array([0, 0, np.nan, 0, 0, 0]), "wanted"),
        (np.ones((2, 3)), np.array([0, np.inf, 0, 0, 0, 0]), "wanted"),
        (np.ones((3, 3)), np.zeros(6), "pixels"),
    ],
)
def test_what_is_not_finite_or_does_not_fit_is_refused(points, wanted, named):
    with pytest.raises(InputError, match=named):
        VisibilityFilter(PERSPECTIVE).step(points, np.zeros((2, 2)), np.ones(2, bool), wanted)


def test_unknown_and_illegal_options_are_refused():
    with pytest.raises(TypeError):
        SafetyOptions(speed=1.0)
    for name, value in (
        ("image_age", 0.0),
        ("reaction", math.nan),
        ("visibility_rate", -1.0),
        ("growing_px", -1),
    ):
        with pytest.raises(InputError, match=name):
            SafetyOptions(**{name: value})
    with pytest.raises(InputError, match="workspace"):
        SafetyOptions(workspace=[[0, 0, 0], [1, 0, 1]])
    with pytest.raises(InputError, match="least_features"):
        SafetyOptions(least_features=4.5)
