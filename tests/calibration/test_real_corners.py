"""Calibration of real lenses from their corners, against independent adjustments of the same corners."""

import json

import numpy as np
import pytest
from board_views import board

from omniservo import calibrate_camera

SETS = {
    "mei": ("mei_paracatadioptric/mei.json", "mei_paracatadioptric/mei.json"),
    "fisheye1": ("fisheye1/fisheye1.json", "fisheye1/fisheye1.json"),
    "camodocal": ("camodocal_fisheye/camodocal.json", "camodocal_fisheye/camodocal.json"),
    "vinsfusion": ("vinsfusion_calib/all85_corners.json", "vinsfusion_calib/pairs.json"),
}


def corners(folder, name):
    path, reference = SETS[name]
    fields, fits = json.loads((folder / path).read_text()), json.loads((folder / reference).read_text())
    lists = [v["corners"] for v in fields["views"]] if "views" in fields else fields["images"].values()
    pixels = [np.array(c) for c in lists]
    target = board(*fields["board_inner_corners"], fields["square_mm"] / 1000.0)
    return pixels, [target] * len(pixels), fields["image_size"], fits.get("models", fits)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "asked", "taken"),
    [
        ("mei", "auto", "none"),
        ("mei", "radtan", "radtan"),
        ("fisheye1", "auto", "none"),
        ("fisheye1", "radtan", "radtan"),
        ("camodocal", "none", "none"),
        ("camodocal", "auto", "radtan"),
        ("vinsfusion", "auto", "radtan"),
    ],
)
def test_real_corners_fit_as_well_as_the_reference_and_none_is_lost_unnamed(shared_data, name, asked, taken):
    pixels, points, size, reference = corners(shared_data, name)
    found = calibrate_camera(pixels, points, size, distortion=asked)
    assert found.status == "ok", found.message
    assert found.distortion == taken, found.distortion_reason
    wanted = reference[{"none": "ba_pure", "radtan": "ba_radtan"}[taken]]
    assert found.rms_px <= 1.03 * wanted["rms_px"]
    assert found.views_used == tuple(range(len(pixels)))
    assert sum(len(rows) for rows in found.corners_dropped.values()) <= 0.005 * sum(map(len, pixels))
    assert found.held_out.px <= 1.2 * found.rms_px
    if name == "mei":
        assert found.coverage.largest_angle > np.radians(100.0)
    if taken == "none":
        ours = np.array([found.camera.fx, found.camera.fy, found.camera.cx, found.camera.cy, found.camera.xi])
        theirs = np.array([wanted[key] for key in ("fx", "fy", "cx", "cy", "xi")])
        assert (np.abs(ours - theirs) <= 2.0 * found.standard_deviations).all()


@pytest.mark.slow
def test_wrong_views_among_real_ones_are_found(shared_data):
    pixels, points, size, _ = corners(shared_data, "fisheye1")
    rng = np.random.default_rng(0)
    pixels[4] = pixels[4][rng.permutation(48)]
    pixels[9] = pixels[9].reshape(8, 6, 2).swapaxes(0, 1).reshape(48, 2)
    pixels[12][30] += [9.0, 4.0]
    found = calibrate_camera(pixels, points, size, distortion="none")
    assert set(found.views_dropped) == {4, 9}
    assert set(found.corners_dropped) == {12}
    assert set(found.corners_dropped[12]) == {30}
    assert found.rms_px < 0.387  # what all 15 views leave; the two that were spoilt are among the worst
