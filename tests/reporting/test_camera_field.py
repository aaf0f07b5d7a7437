"""Figures of what a camera sees."""

import math

import numpy as np
import pytest
from matplotlib import colors

from omniservo.cameras import UnifiedCamera, preset
from omniservo.errors import NotWritten
from omniservo.files import write_whole
from omniservo.reporting.camera_field import draw_field, past_right_angle, pixel_density
from omniservo.reporting.figure_files import write_drawings

MASKED = UnifiedCamera(
    300.0,
    300.0,
    320.0,
    240.0,
    1.2,
    640,
    480,
    mask=[[[10, 10], [60, 10], [10, 60]], [[600, 400], [630, 400], [615, 440]]],
)
DISTORTED = UnifiedCamera(500.0, 505.0, 320.0, 240.0, 0.9, 640, 480, distortion=(-0.1, 0.02, 1e-3, -5e-4))
CAMERAS = {
    "fisheye": preset("fe185"),
    "mirror": preset("para-catadioptric"),
    "perspective": preset("perspective"),
    "masked": MASKED,
    "distorted": DISTORTED,
}


def test_density_of_a_perspective_camera_is_the_known_one():
    camera = preset("perspective")
    u, v, density = pixel_density(camera)
    x = (0.5 * (u[1:] + u[:-1])[None, :] - camera.cx) / camera.fx
    y = (0.5 * (v[1:] + v[:-1])[:, None] - camera.cy) / camera.fy
    # solid angle of a pixel: cos³θ / (fx fy)
    known = np.sqrt(camera.fx * camera.fy * (1 + x**2 + y**2) ** 1.5) * math.pi / 180
    assert density == pytest.approx(known, rel=1e-4)


def test_density_is_nothing_where_nothing_is_seen():
    camera = preset("para-catadioptric")
    u, v, density = pixel_density(camera)
    column, row = np.searchsorted(u, camera.cx) - 1, np.searchsorted(v, camera.cy) - 1
    assert np.isnan(density[row, column])  # the dead zone
    assert np.isnan(density[0, 0])  # beyond the lens
    assert np.isfinite(density).mean() > 0.3


@pytest.mark.slow
@pytest.mark.parametrize("name", CAMERAS)
def test_field_is_drawn_with_its_limits(name, tmp_path):
    drawings = draw_field(CAMERAS[name], CAMERAS[name])
    assert [d.name for d in drawings] == ["camera-field", "camera-density"]
    axes = drawings[0].figure.axes[0]
    labels = {t.get_text() for t in drawings[0].figure.legends[0].get_texts()}
    assert "image" in labels
    assert ("dead zone" in labels) == (name == "mirror")
    assert ("mask" in labels) == (name == "masked")
    assert ("plans keep to" in labels) == (name == "distorted")
    assert any(label.startswith("usable to") for label in labels) == (name in ("fisheye", "mirror"))
    hatched = any(getattr(c, "hatches", None) and c.hatches[0] for c in axes.collections)
    assert hatched == (name in ("fisheye", "mirror", "masked")) == ("past 90°" in labels)
    beyond = {t.get_text() for t in drawings[1].figure.legends[0].get_texts()}
    assert ("90°: no plane Z = 1 beyond" in beyond) == (CAMERAS[name].usable_angle > np.pi / 2)
    assert axes.yaxis_inverted()
    files = write_drawings(drawings, tmp_path)
    assert sorted(f.suffix for f in files) == [".png", ".png", ".svg", ".svg"]
    assert all(f.stat().st_size > 5000 for f in files)
    assert colors.to_hex(axes.get_facecolor()) != "#ffffff"


def test_drawings_that_do_not_fit_on_the_disk_are_none_and_not_some(tmp_path, monkeypatch):
    written = []

    def full(path, content, *, force):
        if len(written) == 3:
            raise NotWritten(path, "No space left on device")
        written.append(write_whole(path, content, force=force))

    monkeypatch.setattr("omniservo.reporting.figure_files.write_whole", full)
    with pytest.raises(NotWritten):
        write_drawings(draw_field(MASKED, MASKED), tmp_path)
    assert len(written) == 3
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", CAMERAS)
def test_part_past_a_right_angle_is_that_of_all_pixels(name):
    camera = CAMERAS[name]
    v, u = np.mgrid[0 : camera.height, 0 : camera.width].astype(float)
    pixels = np.stack([u, v], axis=-1)
    rays, valid = camera.unproject(pixels)
    seen = valid & camera.in_image(pixels)
    assert past_right_angle(camera) == pytest.approx((rays[seen][:, 2] <= 0).mean(), abs=0.01)
    assert (past_right_angle(camera) > 0.02) == (name in ("fisheye", "mirror", "masked"))


@pytest.mark.parametrize(
    "camera",
    [
        UnifiedCamera(300, 300, 319.5, 239.5, 0.8, 640, 480, dead_zone=((320, 240), 900)),
        UnifiedCamera(300, 300, 5000, 239.5, 0.8, 640, 480, max_angle=1.0),
    ],
    ids=["a dead zone over all", "beside its lens"],
)
def test_a_camera_that_sees_nothing_is_drawn_all_the_same(camera):
    assert past_right_angle(camera) == 0.0
    field, density = draw_field(camera, camera)
    assert not np.isfinite(field.figure.axes[0].collections[0].get_array().filled(np.nan)).any()
    assert density.name == "camera-density"
    assert "UnifiedCamera" in camera._repr_html_()


@pytest.mark.parametrize("size", [(1, 3000), (3000, 1)])
def test_a_figure_of_an_image_a_pixel_wide_is_no_larger_than_a_page(size):
    camera = UnifiedCamera(100.0, 100.0, 0.5 * size[0] - 0.5, 0.5 * size[1] - 0.5, 0.8, *size)
    for drawing in draw_field(camera, camera):
        width, height = drawing.figure.get_size_inches()
        assert 0.1 * width < height <= 4.0 * width < 40.0
