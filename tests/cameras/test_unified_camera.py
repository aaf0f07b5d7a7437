"""What a camera accepts and how it says no."""

import dataclasses
import math
import pickle

import numpy as np
import pytest

from omniservo.cameras import DeadZone, UnifiedCamera, preset
from omniservo.errors import InputError

GOOD = {"fx": 300.0, "fy": 301.0, "cx": 320.0, "cy": 240.0, "xi": 1.2, "width": 640, "height": 480}


@pytest.mark.parametrize(
    ("field", "value", "legal"),
    [
        ("fx", 0.0, "at least 1e-06 in size"),
        ("fy", math.nan, "finite"),
        ("cx", math.inf, "finite"),
        ("cy", "240", "number"),
        ("xi", -0.1, ">= 0"),
        ("xi", None, "number"),
        ("width", 0, ">= 1"),
        ("height", 480.5, "whole"),
        ("width", 10**9, "<= 100000"),
        ("skew", math.nan, "finite"),
        ("distortion", (0.1, 0.2), "four numbers"),
        ("distortion", "none", "four numbers"),
        ("distortion", (0.1, math.nan, 0, 0), "finite"),
        ("distortion", (1e9, 0, 0, 0), "<= 1e+06"),
        ("max_angle", 0.0, "> 0"),
        ("max_angle", 4.0, "<= 3.14159"),
        ("dead_zone", {"center": [1, 2]}, "center, radius"),
        ("dead_zone", {"center": [1, 2], "radius": -1}, "> 0"),
        ("dead_zone", {"center": [1, math.nan], "radius": 1}, "finite"),
        ("dead_zone", {"center": 3, "radius": 1}, "two numbers"),
        ("dead_zone", 5, "radius"),
    ],
)
def test_illegal_number_is_named_with_what_is_legal(field, value, legal):
    with pytest.raises(InputError) as caught:
        UnifiedCamera(**{**GOOD, field: value})
    assert field in str(caught.value)
    assert legal in str(caught.value)
    with pytest.raises(InputError, match=f"my.yaml: {field}"):
        UnifiedCamera.from_dict({"model": "unified", **GOOD, field: value}, source="my.yaml")


def test_missing_and_unknown_fields_are_named():
    with pytest.raises(InputError, match="here: xi: missing"):
        UnifiedCamera.from_dict({"model": "unified", **{k: v for k, v in GOOD.items() if k != "xi"}}, "here")
    with pytest.raises(InputError, match="focal: no such field; legal: .*max_angle"):
        UnifiedCamera.from_dict({"model": "unified", **GOOD, "focal": 3})
    with pytest.raises(InputError, match="model: 'ds' given; legal: 'unified'"):
        UnifiedCamera.from_dict({**GOOD, "model": "ds"})
    with pytest.raises(InputError, match="a mapping"):
        UnifiedCamera.from_dict([1, 2])


def test_null_stands_for_absent_in_a_file():
    fields = {
        "model": "unified",
        **GOOD,
        "max_angle": None,
        "dead_zone": None,
        "skew": None,
        "distortion": None,
    }
    assert UnifiedCamera.from_dict(fields) == UnifiedCamera(**GOOD)


def test_the_three_spellings_of_a_dead_zone_are_equal():
    spellings = [DeadZone((1, 2), 3), {"center": [1, 2], "radius": 3}, ((1, 2), 3)]
    cameras = {UnifiedCamera(**GOOD, dead_zone=s) for s in spellings}
    assert len(cameras) == 1


@pytest.mark.parametrize("points", [[1.0, 2.0], [[1, 2, 3, 4]], "abc", 5.0, [["a", "b", "c"]], [None, 1, 2]])
def test_points_of_another_shape_or_kind_are_refused(points):
    for method in (preset("fe185").project, preset("fe185").project_jacobian):
        with pytest.raises(InputError, match="points"):
            method(points)


def test_arrays_with_masked_entries_are_refused_and_those_without_are_read():
    camera = preset("fe185")
    for method, width in ((camera.project, 3), (camera.unproject, 2), (camera.in_image, 2)):
        given = np.ma.array(np.ones((2, width)), mask=np.zeros((2, width)))
        method(given)
        given[1] = np.ma.masked
        with pytest.raises(InputError, match=f"{width} masked entries"):
            method(given)


def test_ragged_pixels_are_refused():
    camera = preset("fe185")
    for method in (camera.unproject, camera.unproject_jacobian, camera.in_image):
        with pytest.raises(InputError, match="pixels"):
            method([[1.0, 2.0], [3.0]])
        with pytest.raises(InputError, match="pixels"):
            method([True, False])


def test_camera_is_a_value():
    camera = UnifiedCamera(**GOOD, dead_zone=((320, 240), 30), max_angle=1.6)
    same = UnifiedCamera(**GOOD, dead_zone=((320, 240), 30), max_angle=1.6)
    assert camera == same
    assert hash(camera) == hash(same)
    assert camera != preset("fe185")
    assert pickle.loads(pickle.dumps(camera)) == camera  # noqa: S301
    assert dataclasses.replace(camera, xi=0.5).xi == 0.5
    with pytest.raises(dataclasses.FrozenInstanceError):
        camera.fx = 3.0
    with pytest.raises(ValueError, match="read-only"):
        camera.parameters[0] = 1.0
    assert "fx=300.0" in repr(camera)


def test_dead_zone_is_not_part_of_the_image():
    camera = preset("para-catadioptric")
    zone = camera.dead_zone
    around = np.array([[1.0, 0.0], [0.0, -1.0], [math.sqrt(0.5), math.sqrt(0.5)]])
    assert not camera.in_image(zone.center + around * (zone.radius - 1e-6)).any()
    assert camera.in_image(zone.center + around * (zone.radius + 1e-6)).all()


def test_presets_are_as_described():
    paper = preset("fe185")
    assert (paper.fx, paper.fy, paper.cx, paper.cy, paper.xi) == (
        296.9365,
        298.4197,
        316.8076,
        254.9012,
        1.291,
    )
    assert (paper.width, paper.height) == (659, 432)
    assert math.degrees(paper.usable_angle) == pytest.approx(92.5)
    assert preset("perspective").xi == 0.0
    assert preset("para-catadioptric").xi == 1.0
    assert 0.8 <= preset("hyper-catadioptric").xi <= 0.97
    for name in ("para-catadioptric", "hyper-catadioptric"):
        camera = preset(name)
        assert camera.usable_angle > math.pi / 2
        rim = camera.project(
            [[math.sin(camera.max_angle) * s, 0.0, math.cos(camera.max_angle)] for s in (1, -1)]
        )
        assert rim[1].all()
        assert camera.in_image(rim[0]).all()
    with pytest.raises(InputError, match="legal: fe185"):
        preset("fe190")


def test_a_mirror_with_a_negative_focal_length_reflects_the_image():
    camera = UnifiedCamera(-300.0, 300.0, 320.0, 240.0, 0.9, 640, 480)
    right, _ = camera.project([0.2, 0.0, 1.0])
    assert right[0] < 320.0
