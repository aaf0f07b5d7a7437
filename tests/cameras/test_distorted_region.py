"""The polygon inside a distorted image: inside beyond doubt, and nearly as large as can be."""

from fractions import Fraction

import numpy as np
import pytest
from scipy.optimize import minimize

from omniservo.cameras import DeadZone, UnifiedCamera
from omniservo.cameras.distorted_region import _edges_inside, dead_zone_on_plane
from omniservo.errors import InputError
from omniservo.verification.distorted_region import region
from omniservo.verification.plan_file import Camera


def area(polygon):
    x, y = polygon.T
    return 0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y)


def pixels_of(camera, m):
    """K D(m), in floats or exact fractions."""
    k1, k2, p1, p2 = (
        (type(m[0])(k) for k in camera.distortion) if isinstance(m[0], Fraction) else camera.distortion
    )
    x, y = m
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * k2)
    dx = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    dy = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    if isinstance(x, Fraction):
        fx, fy, cx, cy, s = (Fraction(v) for v in (camera.fx, camera.fy, camera.cx, camera.cy, camera.skew))
        return fx * dx + s * dy + cx, fy * dy + cy
    return camera.fx * dx + camera.skew * dy + camera.cx, camera.fy * dy + camera.cy


def inside(polygon, m):
    along = np.roll(polygon, -1, axis=0) - polygon
    away = m[:, None] - polygon
    return (along[:, 0] * away[..., 1] - along[:, 1] * away[..., 0] >= 0).all(axis=1)


def plane_points(camera, points):
    d = points[:, 2] + camera.xi * np.linalg.norm(points, axis=1)
    return points[:, :2] / d[:, None]


@pytest.mark.parametrize("margin", [0.0, 12.0])
def test_polygon_is_convex_and_counter_clockwise(distorted_camera, margin):
    polygon = distorted_camera.image_limits(margin).polygon
    along = np.roll(polygon, -1, axis=0) - polygon
    turn = along[:, 0] * np.roll(along[:, 1], -1) - along[:, 1] * np.roll(along[:, 0], -1)
    assert (turn > 0).all()
    assert 3 <= len(polygon) <= 40


@pytest.mark.parametrize("margin", [0.0, 12.0])
def test_every_ray_inside_the_polygon_is_inside_the_image_by_the_margin(distorted_camera, margin):
    camera = distorted_camera
    limits = camera.image_limits(margin)
    polygon = limits.polygon
    rng = np.random.default_rng(5)
    # inside, and on the edges themselves
    corners = rng.integers(0, len(polygon), (20_000, 2))
    share = rng.uniform(0, 1, (20_000, 1))
    chords = share * polygon[corners[:, 0]] + (1 - share) * polygon[corners[:, 1]]
    t = np.linspace(0, 1, 201)[:, None, None]
    edges = ((1 - t) * polygon + t * np.roll(polygon, -1, axis=0)).reshape(-1, 2)
    m = np.vstack([chords, edges])
    u, v = pixels_of(camera, m.T)
    assert u.min() >= -0.5 + margin
    assert u.max() <= camera.width - 0.5 - margin
    assert v.min() >= -0.5 + margin
    assert v.max() <= camera.height - 0.5 - margin
    bearings, valid = camera.unproject(np.stack([u, v], axis=1))
    assert valid.all()
    assert np.abs(plane_points(camera, bearings) - m).max() < 1e-8


def test_cones_of_the_polygon_are_the_polygon(distorted_camera, rays):
    limits = distorted_camera.image_limits(3.0)
    valid = distorted_camera.project(rays)[1]
    points = rays[valid]
    cones = points @ limits.normals.T <= limits.kappas
    assert limits.names[:2] == ("domain", "polygon 0")
    assert cones[:, 0].all()
    assert (cones[:, 1:].all(axis=1) == inside(limits.polygon, plane_points(distorted_camera, points))).all()


def test_no_ray_that_folds_passes(distorted_camera, rays):
    limits = distorted_camera.image_limits()
    seen = (rays @ limits.normals.T <= limits.kappas).all(axis=1)
    pixels, valid = distorted_camera.project(rays)
    assert seen.sum() > 100
    assert valid[seen].all()
    assert (pixels[seen] >= -0.5).all()
    assert (pixels[seen] <= [distorted_camera.width - 0.5, distorted_camera.height - 0.5]).all()


def bernstein_bounds(camera, p, q, pieces=32):
    """Exact bounds of u and v along an edge, in fractions: the largest and smallest Bernstein coefficient."""
    nodes = [Fraction(i, 5) for i in range(6)]
    binomials = [1, 5, 10, 10, 5, 1]
    matrix = [[b * t**k * (1 - t) ** (5 - k) for k, b in enumerate(binomials)] for t in nodes]
    inverse = np.linalg.inv(np.array(matrix, dtype=float))
    exact = [[Fraction(x).limit_denominator(1000) for x in row] for row in inverse]
    product = [[sum(exact[i][k] * matrix[k][j] for k in range(6)) for j in range(6)] for i in range(6)]
    assert all(product[i][j] == (i == j) for i in range(6) for j in range(6))
    lows, highs = [], []
    for piece in range(pieces):
        samples = []
        for t in nodes:
            s = (piece + t) / pieces
            m = tuple(Fraction(a) + s * (Fraction(b) - Fraction(a)) for a, b in zip(p, q, strict=True))
            samples.append(pixels_of(camera, m))
        for axis in (0, 1):
            coefficients = [sum(c * w[axis] for c, w in zip(row, samples, strict=True)) for row in exact]
            lows.append((axis, min(coefficients)))
            highs.append((axis, max(coefficients)))
    return lows, highs


@pytest.mark.parametrize("which", ["barrel", "tangential"])
def test_edges_stay_in_the_image_in_exact_arithmetic(which):
    distortion = {"barrel": (-0.28, 0.07, 1e-3, -5e-4), "tangential": (1e-3, 2e-3, 3e-3, 4e-3)}[which]
    camera = UnifiedCamera(420.0, 415.0, 320.0, 240.0, 0.3, 640, 480, distortion=distortion, skew=1.5)
    margin = Fraction(2)
    polygon = camera.image_limits(2.0).polygon
    for p, q in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
        lows, highs = bernstein_bounds(camera, p, q)
        size = (camera.width, camera.height)
        assert all(low >= Fraction(-1, 2) + margin for _, low in lows)
        assert all(high <= size[axis] - Fraction(1, 2) - margin for axis, high in highs)


@pytest.mark.parametrize("margin", [0.0, 5.0, 31.7])
def test_the_independent_verifier_proves_the_polygon(distorted_camera, margin):
    c = distorted_camera
    exact = Camera(
        *(Fraction(v) for v in (c.fx, c.fy, c.cx, c.cy, c.skew, c.xi)),
        tuple(Fraction(k) for k in c.distortion),
        Fraction(c.width),
        Fraction(c.height),
        None if c.max_angle is None else Fraction(c.max_angle),
        None,
    )
    polygon = tuple((Fraction(x), Fraction(y)) for x, y in c.image_limits(margin).polygon.tolist())
    assert region(exact, polygon, Fraction(margin)).verdict == "holds"


@pytest.mark.parametrize("xi", [0.0, 0.9])
def test_lens_wider_than_the_model_does_not_disturb(xi):
    camera = UnifiedCamera(400, 400, 320, 240, xi, 640, 480, distortion=(0.1, 0.02, 0, 0), max_angle=np.pi)
    without = UnifiedCamera(400, 400, 320, 240, xi, 640, 480, distortion=(0.1, 0.02, 0, 0))
    assert np.array_equal(camera.image_limits(3.0).polygon, without.image_limits(3.0).polygon)


def test_barrel_polygon_covers_98_percent_of_the_largest_convex_part():
    """Independent: with barrel distortion every image edge bows inwards on the plane, so the largest
    convex part is cut by one tangent at each edge; the four tangent points are optimised directly."""
    camera = UnifiedCamera(420.0, 420.0, 330.0, 230.0, 0.0, 640, 480, distortion=(-0.28, 0.07, 0.0, 0.0))
    sides = [((-0.5, None), 480), ((None, -0.5), 640), ((639.5, None), 480), ((None, 479.5), 640)]

    def tangent(side, share):
        (u, v), length = side
        position = share * length - 0.5

        def plane(s):
            pixel = (u, s) if v is None else (s, v)
            bearing, _ = camera.unproject(pixel)
            return bearing[:2] / bearing[2]

        along = plane(position + 1e-4) - plane(position - 1e-4)
        point = plane(position)
        normal = np.array([along[1], -along[0]])
        normal *= np.sign(normal @ point)
        return normal, normal @ point

    def quadrilateral(shares):
        lines = [tangent(s, share) for s, share in zip(sides, shares, strict=True)]
        return np.array(
            [
                np.linalg.solve([a[0], b[0]], [a[1], b[1]])
                for a, b in zip(lines, lines[1:] + lines[:1], strict=True)
            ]
        )

    best = minimize(lambda s: -abs(area(quadrilateral(s))), [0.5] * 4, method="Nelder-Mead")
    polygon = camera.image_limits().polygon
    assert area(polygon) >= 0.98 * -best.fun
    assert area(polygon) <= 1.001 * -best.fun


def test_pincushion_polygon_covers_98_percent_of_the_convex_region():
    camera = UnifiedCamera(420.0, 420.0, 330.0, 230.0, 0.0, 640, 480, distortion=(0.3, 0.2, 0.0, 0.0))
    s = np.linspace(0, 1, 400, endpoint=False)
    border = np.vstack(
        [
            np.column_stack([-0.5 + 640 * s, 0 * s - 0.5]),
            np.column_stack([0 * s + 639.5, -0.5 + 480 * s]),
            np.column_stack([639.5 - 640 * s, 0 * s + 479.5]),
            np.column_stack([0 * s - 0.5, 479.5 - 480 * s]),
        ]
    )
    region = plane_points(camera, camera.unproject(border)[0])
    assert area(camera.image_limits().polygon) >= 0.98 * area(region)


@pytest.mark.parametrize("margin", [0.0, 10.0])
def test_circle_of_the_lens_binds_a_distorted_camera_too(margin):
    """A fisheye whose circle fits in the image: the polygon covers 98% of the shrunk circle, no more."""
    camera = UnifiedCamera(
        1336.3, 1335.8, 716.9, 705.8, 2.2134, 1500, 1450, distortion=(0.0168, 1.65, 4e-4, 4e-4), max_angle=1.5
    )
    limits = camera.image_limits(margin)
    azimuth = np.linspace(0, 2 * np.pi, 2000)
    circle = np.stack(
        [np.sin(1.5) * np.cos(azimuth), np.sin(1.5) * np.sin(azimuth), np.cos(1.5) + 0 * azimuth], 1
    )
    rim = camera.project(circle)[0]
    corners = np.stack(pixels_of(camera, limits.polygon.T), axis=1)
    distance = np.linalg.norm(corners[:, None] - rim[None], axis=2).min()
    assert distance >= margin
    radius = np.sin(1.5) / (np.cos(1.5) + camera.xi)
    assert area(limits.polygon) >= 0.98 * np.pi * (radius - 1.02 * margin / 1335.8) ** 2


def test_dead_zone_on_the_plane_holds_all_that_the_zone_covers(distorted_camera):
    camera = distorted_camera
    center = (camera.cx + 3.0, camera.cy - 2.0)
    zone = DeadZone(center, 40.0)
    disc = dead_zone_on_plane(camera, zone, 5.0)
    a = np.linspace(0, 2 * np.pi, 721)
    rim = np.column_stack([center[0] + 45 * np.cos(a), center[1] + 45 * np.sin(a)])
    bearings, valid = camera.unproject(rim)
    assert valid.all()
    plain = plane_points(camera, bearings)
    pixels = np.column_stack([plain, np.ones(len(plain))]) @ camera.matrix[:2].T
    distance = np.linalg.norm(pixels - disc.center, axis=1)
    assert distance.max() <= disc.radius
    assert disc.radius <= 1.15 * distance.max()


def test_dead_zone_at_the_fold_is_refused():
    camera = UnifiedCamera(
        300, 300, 320, 240, 0.0, 640, 480, distortion=(-0.35, 0, 0, 0), dead_zone=((320, 240), 190)
    )
    with pytest.raises(InputError, match="dead_zone"):
        camera.image_limits()


def test_image_that_shows_nothing_usable_is_refused():
    camera = UnifiedCamera(300, 300, 5000, 240, 0.0, 640, 480, distortion=(-0.35, 0, 0, 0))
    with pytest.raises(InputError, match="usable part"):
        camera.image_limits()


def test_equal_cameras_share_the_polygon():
    fields = {"distortion": (-0.1, 0.01, 0.0, 0.0)}
    first = UnifiedCamera(400, 400, 320, 240, 1.0, 640, 480, **fields).image_limits(2.0)
    assert UnifiedCamera(400, 400, 320, 240, 1.0, 640, 480, **fields).image_limits(2) is first


def outline_extremes(camera, polygon):
    """Least and largest pixel of the distorted outline, by samples that miss less than 1e-7 px."""
    along = np.roll(polygon, -1, axis=0) - polygon
    points = polygon[:, None] + np.linspace(0.0, 1.0, 20_001)[:, None] * along[:, None]
    pixels = np.stack(pixels_of(camera, np.moveaxis(points, -1, 0)), axis=-1)
    return pixels.min(axis=(0, 1)), pixels.max(axis=(0, 1))


@pytest.mark.parametrize("k1", [-0.1, 0.08])
def test_an_outline_that_leaves_the_image_by_a_millionth_of_a_pixel_is_not_proven(k1):
    """At every edge of the image, wherever between the looks along a side the outline is farthest out."""
    rng = np.random.default_rng(7)
    camera = UnifiedCamera(300.0, 300.0, 320.0, 240.0, 1.0, 640, 480, distortion=(k1, 0.01, 1e-3, -2e-3))
    for _ in range(20):
        corners = (
            0.9
            * rng.uniform(0.8, 1.0, (5, 1))
            * np.column_stack(
                [f(2.0 * np.pi * (np.arange(5) + rng.uniform(0.0, 0.6)) / 5.0) for f in (np.cos, np.sin)]
            )
        )
        least, most = outline_extremes(camera, corners)
        assert _edges_inside(camera, corners, least - 1e-2, most + 1e-2)
        for axis in range(2):
            step = np.eye(2)[axis] * 1e-6
            wide = np.ones(2) - np.eye(2)[axis]
            assert not _edges_inside(camera, corners, least + step - wide, most + 1.0)
            assert not _edges_inside(camera, corners, least - 1.0, most - step + wide)
