"""Masks: convex polygons in which the camera sees itself or nothing."""

import json
import math
import re

import numpy as np
import pytest
from matplotlib.path import Path as Outline
from scipy.spatial import ConvexHull

from omniservo.camera_files import load_model, save_camera
from omniservo.cameras import UnifiedCamera
from omniservo.cameras.image_mask import distance_beyond, outward_edges
from omniservo.errors import InputError

SQUARE = [[100, 100], [200, 100], [200, 180], [100, 180]]
PENTAGON = [[400.5, 300.0], [450.0, 310.0], [460.0, 350.0], [420.0, 380.0], [390.0, 340.0]]


def camera(mask=(), **changes):
    return UnifiedCamera(300, 310, 320, 240, 1.1, 640, 480, mask=mask, **changes)


def test_a_pixel_in_a_polygon_is_not_in_the_image_either_way_round():
    rng = np.random.default_rng(1)
    pixels = rng.uniform([-0.5, -0.5], [639.5, 479.5], size=(20_000, 2))
    inside = np.zeros(len(pixels), dtype=bool)
    for polygon in (SQUARE, PENTAGON):
        inside |= Outline(polygon).contains_points(pixels)
    assert 100 < inside.sum() < 5000
    for mask in ([SQUARE, PENTAGON], [SQUARE[::-1], PENTAGON[2:] + PENTAGON[:2]]):
        assert np.array_equal(camera(mask).in_image(pixels), ~inside)


def test_the_border_of_a_polygon_belongs_to_the_image():
    masked = camera([SQUARE])
    assert masked.in_image([[100, 140], [150, 180], [200, 100]]).all()
    assert not masked.in_image([[100.001, 140], [150, 179.999], [math.nan, 1]]).any()


def test_the_edges_are_those_of_the_convex_hull():
    rng = np.random.default_rng(2)
    for _ in range(50):
        points = rng.normal(size=(12, 2)) * 100 + [300, 200]
        hull = ConvexHull(points)
        corners = points[hull.vertices][:: rng.choice([-1, 1])]
        pixels = rng.uniform(0, 600, size=(200, 2))
        reference = (pixels @ hull.equations[:, :2].T + hull.equations[:, 2]).max(axis=1)
        mask = camera([corners]).mask
        assert np.allclose(distance_beyond(mask, pixels), reference, atol=1e-9)
        assert np.allclose(np.linalg.norm(outward_edges(mask[0])[:, :2], axis=1), 1.0)


def test_a_corner_that_is_nearly_none_does_not_turn_a_polygon_inside_out():
    """The turn at one corner is but rounding here; the side that is inside was told by it."""
    polygons = (
        ((36.7, 43.2), (111.25714285714285, 51.5), (260.37142857142857, 68.1), (61.6, -180.47142857142853)),
        ((2.9, 419.7), (53.42857142857142, 441.0333333333333), (103.95714285714286, 462.3666666666666),
         (66.9, 268.1142857142857)),
    )  # fmt: skip
    for polygon in polygons:
        for corners in (polygon, polygon[::-1]):
            masked = camera([corners])
            assert not masked.in_image(np.mean(corners, axis=0)).any()
            assert masked.in_image([600.0, 400.0])


def test_limits_hold_the_polygons_grown_by_the_margin():
    masked = camera([SQUARE, PENTAGON])
    limits = masked.image_limits(3.0)
    pixel = np.array([95.0, 140.0])
    assert [len(lines) for lines in limits.mask] == [4, 5]
    assert max(lines @ [*pixel, -1.0] for lines in limits.mask[:1])[3] == pytest.approx(2.0)
    assert camera().image_limits().mask == ()


def test_cameras_with_different_masks_differ_and_files_keep_them(tmp_path):
    masked, plain = camera([SQUARE, PENTAGON]), camera()
    assert masked != plain
    assert masked == camera([SQUARE, PENTAGON])
    assert len({masked, plain, camera([SQUARE, PENTAGON])}) == 2
    assert UnifiedCamera.from_dict(json.loads(json.dumps(masked.to_dict()))) == masked
    assert "mask" not in plain.to_dict()
    assert UnifiedCamera.from_dict({**plain.to_dict(), "mask": None}) == plain
    for name, form in (("c.json", "own"), ("c.yaml", "own"), ("m.yaml", "mei"), ("k.yaml", "kalibr")):
        save_camera(masked, tmp_path / name, form)
        assert load_model(tmp_path / name) == masked


STAR = [[100 + 50 * math.sin(0.8 * math.pi * k), 100 + 50 * math.cos(0.8 * math.pi * k)] for k in range(5)]

BAD = {
    "number": (5, "mask: 5 given; legal: a list of polygons"),
    "text": ("mask.png", "mask: 'mask.png' given; legal: a list of polygons"),
    "polygon number": ([7], r"mask\[0\]: 7 given; legal: corners"),
    "two corners": ([SQUARE, SQUARE[:2]], r"mask\[1\]: 2 given; legal: corners \[u, v\], 3 to 64"),
    "many corners": (
        [[[math.sin(0.1 * k), math.cos(0.1 * k)] for k in range(65)]],
        r"mask\[0\]: 65 given; legal: .* 3 to 64",
    ),
    "many polygons": ([SQUARE] * 65, "mask: 65 given; legal: a list of polygons, 0 to 64"),
    "corner of three": ([[[0, 0, 0], [1, 0, 0], [0, 1, 0]]], r"mask\[0\]: shape \(3, 3\) given"),
    "ragged": ([[[0, 0], [1], [0, 1]]], r"mask\[0\]: "),
    "NaN": ([[[0, 0], [1, math.nan], [0, 1]]], r"mask\[0\]: nan at index \(1, 1\)"),
    "infinite": ([[[0, 0], [1, math.inf], [0, 1]]], r"mask\[0\]: inf at index"),
    "far": ([[[0, 0], [1e7, 0], [0, 1]]], r"mask\[0\]: 1e\+07 given; legal: -1e6 to 1e6 px"),
    "collinear": ([[[0, 0], [5, 5], [9, 9], [0, 9]]], r"mask\[0\]: corner 1 lies on a line"),
    "one line": ([[[0, 0], [5, 5], [9, 9]]], r"mask\[0\]: corner . lies on a line"),
    "twice": ([[[0, 0], [0, 0], [9, 9], [0, 9]]], r"mask\[0\]: corners 0 and 1 are 0 px apart"),
    "dented": (
        [[[0, 0], [9, 0], [2, 2], [0, 9]]],
        r"mask\[0\]: not convex: it turns the other way at corner 2",
    ),
    "star": ([STAR], r"mask\[0\]: not convex: it runs round more than once"),
    "bow tie": ([[[0, 0], [9, 9], [9, 0], [0, 9]]], r"mask\[0\]: not convex"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_is_no_convex_polygon_is_refused_with_the_reason(name):
    given, message = BAD[name]
    with pytest.raises(InputError, match=message) as caught:
        camera(given)
    assert re.match(r"mask(\[\d+\])?: ", str(caught.value))
