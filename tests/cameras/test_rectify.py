"""Images resampled into perspective, cylindrical, equirectangular and other views."""

import math
import tracemalloc

import numpy as np
import pytest

from omniservo.cameras import (
    cylindrical_view,
    equirectangular_view,
    perspective_view,
    preset,
    rectify,
    tangent_view,
)
from omniservo.cameras.models import Equirectangular, KannalaBrandt
from omniservo.errors import InputError


def painted(camera, colour):
    """An image whose pixels are ``colour`` of their bearing; 0 where there is none."""
    v, u = np.mgrid[0 : camera.height, 0 : camera.width].astype(float)
    bearings, valid = camera.unproject(np.stack([u, v], axis=-1))
    return np.where(valid, colour(np.nan_to_num(bearings)), 0.0)


@pytest.mark.parametrize("name", ["fe185", "perspective", "para-catadioptric", "hyper-catadioptric"])
@pytest.mark.parametrize("direction", [(0.0, 0.0, 1.0), (0.5, -0.1, 0.8), (-0.9, 0.3, 0.2)])
def test_view_shows_at_each_pixel_what_its_bearing_sees(name, direction):
    camera = preset(name)

    def colour(b):
        return 100 + 50 * b[..., 0] + 30 * b[..., 1] - 20 * b[..., 2]

    view = tangent_view(camera, painted(camera, colour), direction, math.radians(50), (161, 121))
    v, u = np.mgrid[0:121, 0:161].astype(float)
    expected = colour(view.bearings(np.stack([u, v], axis=-1)))
    # away from where the source image ends or is dark
    bearings = view.bearings(np.stack([u, v], axis=-1))
    inner = view.valid & (bearings[..., 2] > math.cos(camera.usable_angle - 0.05))
    assert inner.any() or (name, direction[2]) == ("perspective", 0.2)
    assert np.abs(view.image - expected)[inner].max(initial=0.0) < 0.05
    assert (view.image[~view.valid] == 0).all()


VIEWS = {
    "perspective": perspective_view(1.2, (160, 120)),
    "cylindrical": cylindrical_view(math.radians(200), (240, 120)),
    "whole turn": cylindrical_view(2 * math.pi, (360, 120)),
    "equirectangular": equirectangular_view((240, 120)),
    "another camera": preset("fe185"),
}


@pytest.mark.parametrize("name", VIEWS)
@pytest.mark.parametrize("direction", [(0.0, 0.0, 1.0), (0.4, 0.3, 0.6)])
def test_every_view_shows_at_each_pixel_what_its_bearing_sees(name, direction):
    lens = KannalaBrandt(190.0, 191.0, 255.0, 256.0, 512, 512, k=(0.01, -0.004, 1e-3, -2e-4), max_angle=1.6)

    def colour(b):
        return 100 + 50 * b[..., 0] + 30 * b[..., 1] - 20 * b[..., 2]

    view = rectify(lens, painted(lens, colour), VIEWS[name], direction=direction)
    v, u = np.mgrid[0 : view.camera.height, 0 : view.camera.width].astype(float)
    bearings = view.bearings(np.stack([u, v], axis=-1))
    pixels, seen = lens.project(np.nan_to_num(bearings))
    inner = view.valid & (bearings[..., 2] > math.cos(1.5)) & (np.abs(pixels - 255.5) < 255.5).all(axis=-1)
    assert inner.mean() > 0.1
    assert np.abs(view.image - colour(bearings))[inner].max() < 0.05
    shown = seen & lens.in_image(np.nan_to_num(pixels, nan=-1e6)) & np.isfinite(bearings).all(axis=-1)
    assert np.array_equal(view.valid, shown)


@pytest.mark.parametrize("field", [1.0, math.pi, 2 * math.pi])
def test_cylinder_spans_its_field_and_is_invertible(field):
    view = cylindrical_view(field, (301, 200))
    v, u = np.mgrid[0:200, 0:301].astype(float)
    grid = np.stack([u, v], axis=-1)
    bearings, valid = view.unproject(grid)
    assert valid.all()
    assert np.linalg.norm(bearings, axis=-1) == pytest.approx(1.0)
    back, seen = view.project(3.0 * bearings)
    assert seen.all()
    assert np.abs(back - grid).max() < 1e-9
    left = view.unproject([-0.5 + 1e-9, 99.5])[0]
    assert math.atan2(left[0], left[2]) == pytest.approx(-field / 2, abs=1e-6)
    assert not view.project([0.0, 1.0, 0.0])[1]
    assert not view.unproject([np.nan, 0.0])[1]


def test_the_cylinder_refuses_what_other_cameras_refuse():
    view = cylindrical_view(1.0, (30, 20))
    for points in ([1.0, 2.0], [[1.0, 2.0, 3.0, 4.0]], ["a", "b", "c"]):
        with pytest.raises(InputError, match="points"):
            view.project(points)
    with pytest.raises(InputError, match="pixels"):
        view.unproject([1.0, 2.0, 3.0])
    assert view.project(np.empty((0, 4, 3)))[0].shape == (0, 4, 2)
    assert view.unproject(np.empty((0, 4, 2)))[0].shape == (0, 4, 3)


@pytest.mark.filterwarnings("error")
def test_a_point_that_has_no_number_on_the_cylinder_is_not_valid():
    cylinder = cylindrical_view(3.0, (100, 100))
    points = [[math.inf, 0.0, 1.0], [0.0, 1.0, 0.0], [1e-300, 1e300, 0.0], [1.0, 2.0, 3.0]]
    assert cylinder.project(points)[1].tolist() == [False, False, False, True]


def test_upright_lines_stay_upright_on_the_cylinder():
    camera = preset("fe185")
    image = painted(camera, lambda b: 255.0 * np.exp(-(((b[..., 0] - 0.8 * b[..., 2]) / 0.01) ** 2)))
    view = rectify(camera, image, cylindrical_view(math.radians(120), (480, 200)))
    columns = (view.image * np.arange(480)).sum(axis=1) / view.image.sum(axis=1)
    assert np.ptp(columns[20:-20]) < 0.2


def test_centre_and_borders_of_the_view_lie_where_asked():
    camera = preset("fe185")
    view = tangent_view(camera, np.zeros((432, 659)), (1.0, 0.0, 1.0), math.radians(60), (201, 101))
    centre = view.bearings([100.0, 50.0])
    assert centre == pytest.approx([math.sqrt(0.5), 0.0, math.sqrt(0.5)])
    left, right = view.bearings([[-0.5, 50.0], [200.5, 50.0]])
    assert math.acos(left @ right) == pytest.approx(math.radians(60))
    assert right[0] > left[0]
    assert view.bearings([100.0, -0.5])[1] < 0.0  # up in the view is up in the image


def test_image_of_a_straight_line_becomes_straight():
    """A plane through the centre is a line in the world; its curved image is straight in the view."""
    camera = preset("fe185")
    normal = np.array([0.35, 1.0, -0.55]) / np.linalg.norm([0.35, 1.0, -0.55])
    image = painted(camera, lambda b: 255.0 * np.exp(-(((b @ normal) / 0.006) ** 2)))
    view = tangent_view(camera, image, (0.2, 0.3, 0.9), math.radians(70), (400, 300))
    columns = np.arange(20, 380)
    rows = (view.image * np.arange(300)[:, None]).sum(axis=0)[columns] / view.image.sum(axis=0)[columns]
    fit = np.polynomial.Polynomial.fit(columns, rows, 1)
    assert np.abs(rows - fit(columns)).max() < 0.15
    source_rows = np.array([image[:, c].argmax() for c in range(150, 500, 10)])
    bent = np.polynomial.Polynomial.fit(np.arange(150, 500, 10), source_rows, 1)
    assert np.abs(source_rows - bent(np.arange(150, 500, 10))).max() > 5


def test_colour_and_integer_images_keep_their_type():
    camera = preset("perspective")
    image = np.random.default_rng(0).integers(0, 256, (480, 640, 3), dtype=np.uint8)
    view = tangent_view(camera, image, (0, 0, 1), 2 * math.atan(320 / 420), (640, 480))
    assert view.image.dtype == np.uint8
    assert np.array_equal(view.image, image)  # the camera's own view
    assert view.valid.all()


def test_large_views_take_little_memory():
    camera = preset("fe185")
    image = np.full((camera.height, camera.width), 100, dtype=np.uint8)
    tracemalloc.start()
    seen = tangent_view(camera, image, [0.0, 0.0, 1.0], 1.5, (2048, 1024))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert seen.valid.all()
    assert (seen.image == 100).all()
    assert peak < 40 * seen.image.size  # bytes


def test_up_turns_the_view():
    camera = preset("fe185")
    view = tangent_view(camera, np.zeros((432, 659)), (0, 0, 1), 1.0, (11, 11), up=(1.0, 0.0, 0.0))
    assert view.bearings([5.0, 0.0])[0] > 0.1
    straight_down = tangent_view(camera, np.zeros((432, 659)), (0, 1, 0), 1.0, (11, 11))
    assert straight_down.bearings([5.0, 5.0]) == pytest.approx([0, 1, 0], abs=1e-12)
    assert straight_down.bearings([5.0, 0.0])[2] > 0.1  # there the axis is up


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"image": np.zeros((10, 10))}, "image"),
        ({"image": np.zeros((432, 659), dtype=complex)}, "image"),
        ({"direction": (0, 0, 0)}, "direction"),
        ({"direction": (0, np.nan, 1)}, "direction"),
        ({"field_of_view": math.pi}, "field_of_view"),
        ({"field_of_view": 0.0}, "field_of_view"),
        ({"size": (0, 5)}, "size"),
        ({"size": (5.5, 5)}, "size: 5.5 given; a whole number"),
        ({"size": 5}, "size"),
        ({"up": (0, 0, 2)}, "up"),
        ({"up": (0, 0, 0)}, "up"),
    ],
)
def test_what_is_no_view_is_refused(change, named):
    arguments = {
        "image": np.zeros((432, 659)),
        "direction": (0, 0, 1),
        "field_of_view": 1.0,
        "size": (5, 5),
        **change,
    }
    with pytest.raises(InputError, match=named):
        tangent_view(preset("fe185"), **arguments)


@pytest.mark.parametrize(
    "made",
    [
        lambda: cylindrical_view(7.0, (10, 10)),
        lambda: cylindrical_view(1.0, (10, 20_000)),
        lambda: equirectangular_view((16_384, 16_384)),
        lambda: perspective_view(1.0, (10,)),
        lambda: rectify(preset("fe185"), np.zeros((432, 659)), Equirectangular(100_000, 100_000)),
    ],
)
def test_views_that_cannot_be_are_refused(made):
    with pytest.raises(InputError, match="field_of_view|size|view: 100000x100000 given"):
        made()
