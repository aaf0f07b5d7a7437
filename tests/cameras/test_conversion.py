"""Conversions: exact where two formulas are one camera, else as near as the measured residual says."""

import json
import math

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from omniservo.cameras import UnifiedCamera
from omniservo.cameras.conversion import convert, to_unified, unified_image
from omniservo.cameras.conversion.residual import used_pixels
from omniservo.cameras.models import (
    DoubleSphere,
    Equirectangular,
    ExtendedUnified,
    KannalaBrandt,
    OcamPolynomial,
    Pinhole,
)
from omniservo.errors import InputError

KB = (0.0034823894022493434, 0.0007150348452162257, -0.0020532361418706202, 0.00020293673591811182)
ODD = (0.02, -0.03, 0.01, -0.002)
MASK = (((-0.5, -0.5), (60.0, -0.5), (-0.5, 60.0)),)
TUM_KB = KannalaBrandt(
    190.978, 190.973, 254.932, 256.897, 512, 512, k=KB, max_angle=math.radians(97.0), dead_zone=((9, 9), 5)
)


def random_rays(n=3000):
    return np.random.default_rng(3).normal(size=(n, 3))


def agree(a, b, tolerance=1e-9):
    """Whether both cameras see the same rays and send them to the same pixels nearer than 5000 px."""
    rays = random_rays()
    (pixels, valid), (others, also) = a.project(rays), b.project(rays)
    assert np.array_equal(valid, also)
    assert valid.any()
    near = valid & (np.abs(np.nan_to_num(pixels)).max(axis=1) < 5e3)
    return np.abs(pixels - others)[near].max() <= tolerance


focal = st.floats(100, 900)
signs = st.sampled_from([-1.0, 1.0])
angles = st.none() | st.floats(0.3, 3.0)


@settings(max_examples=40, deadline=None)
@given(focal, focal, signs, st.floats(0.0, 3.0), angles)
def test_unified_extended_and_double_sphere_are_one_camera(fx, fy, sign, xi, max_angle):
    camera = UnifiedCamera(sign * fx, fy, 320.0, 240.0, xi, 640, 480, max_angle=max_angle)
    for kind in (ExtendedUnified, DoubleSphere):
        model, residual = convert(camera, kind, largest_px=0.0)
        assert residual.largest_px == 0.0
        assert model.max_angle == max_angle
        assert abs(model.usable_angle - camera.usable_angle) < 1e-7
        assert agree(model, camera)
        back = to_unified(model, largest_px=0.0)
        assert back.camera.deviation_px == 0.0
        assert back.camera.xi == pytest.approx(xi, rel=1e-12, abs=1e-12)
        assert back.camera.fx == pytest.approx(sign * fx, rel=1e-12)


@settings(max_examples=20, deadline=None)
@given(focal, st.floats(0.0, 3.0))
def test_double_sphere_without_alpha_is_unified_with_the_same_xi(f, xi):
    model = DoubleSphere(f, -f, 320.0, 240.0, xi, 0.0, 640, 480)
    conversion = to_unified(model, largest_px=0.0)
    assert conversion.camera.xi == xi
    assert conversion.residual.largest_px == 0.0
    assert agree(model, conversion.camera)


def test_extended_unified_with_alpha_0_is_perspective_whatever_its_beta():
    model = ExtendedUnified(300.0, 300.0, 320.0, 240.0, 0.0, 1.7, 640, 480)
    assert agree(model, to_unified(model, largest_px=0.0).camera)


@settings(max_examples=20, deadline=None)
@given(focal, st.lists(st.floats(-0.05, 0.05), min_size=4, max_size=4), st.floats(-2.0, 2.0))
def test_pinhole_with_four_numbers_is_unified_with_xi_0(f, distortion, skew):
    model = Pinhole(f, f, 320.0, 240.0, 640, 480, distortion=distortion, skew=skew)
    camera = to_unified(model, largest_px=0.0).camera
    assert camera.xi == 0.0
    assert camera.distortion == tuple(distortion)
    pixels = used_pixels(model, 21)
    rays = model.unproject(pixels)[0]
    assert np.abs(camera.project(rays)[0] - pixels).max() <= 1e-9
    again, residual = convert(camera, Pinhole, largest_px=0.0)
    assert (again.distortion, residual.largest_px) == ((), 0.0) or again.distortion == tuple(distortion)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("model", "bound"),
    [
        (TUM_KB, 0.03),
        (KannalaBrandt(190.978, -190.973, 254.932, 256.897, 512, 512, k=KB, skew=0.7), 0.08),
        (KannalaBrandt(300.0, 300.0, 620.0, 440.0, 1240, 880, k=ODD, max_angle=1.6), 0.2),
        (ExtendedUnified(191.148, 191.132, 254.959, 256.882, 0.62911, 1.04181, 512, 512), 0.06),
        (DoubleSphere(158.286, 158.274, 254.961, 256.889, -0.172131, 0.593118, 512, 512), 0.06),
        (
            OcamPolynomial(
                (-153.467, 0.0, 1.034692e-3, 5.138226e-6, -5.694855e-9),
                456.3,
                382.8,
                1024,
                768,
                max_angle=1.7,
            ),
            0.6,
        ),
        (Pinhole(420, 421, 320, 240, 640, 480, distortion=(-0.28, 0.07, 1e-3, -5e-4, 0.01)), 0.6),
    ],
    ids=[
        "kb 97 deg",
        "kb mirrored, skew",
        "kb, largest between the grids' pixels",
        "eucm",
        "ds",
        "ocam",
        "plumb bob",
    ],
)
def test_a_fit_is_as_near_as_its_residual_says(model, bound):
    """Measured again here, at random pixels, through the public calls alone."""
    conversion = to_unified(model)
    camera, residual = conversion.camera, conversion.residual
    assert 0.0 < residual.largest_px < bound
    assert camera.deviation_px == pytest.approx(residual.largest_px, rel=2e-3)
    assert residual.rms_px < residual.largest_px
    assert residual.lost == 0.0
    assert conversion.warnings == ()
    pixels = np.random.default_rng(8).uniform(-0.5, [model.width - 0.5, model.height - 0.5], (40_000, 2))
    rays, valid = model.unproject(pixels)
    there, seen = camera.project(rays[valid])
    assert seen.all()
    assert np.hypot(*(there - pixels[valid]).T).max() <= camera.deviation_px
    others, also = camera.unproject(pixels[valid])
    cross = np.linalg.norm(np.cross(others, rays[valid]), axis=1)
    assert np.arcsin(cross[also]).max() <= residual.largest_rad * 1.01
    assert (camera.max_angle, camera.dead_zone) == (model.max_angle, model.dead_zone)


@pytest.mark.parametrize(
    "model",
    [
        ExtendedUnified(138.2714, 139.866, 318.4097, 188.4144, 0.743203, 0.874398, 640, 480),
        KannalaBrandt(293.5616, 289.5201, 219.1022, 178.6351, 640, 480, k=(7.7148e-4, -8.5718e-3, 0.0, 0.0)),
    ],
    ids=["a ring's top between the grid's pixels", "beside a fold in the image's corner"],
)
def test_no_pixel_lies_farther_off_than_the_deviation_says(model):
    camera = to_unified(model).camera
    pixels = np.random.default_rng(8).uniform(-0.5, [639.5, 479.5], (400_000, 2))
    rays, valid = model.unproject(pixels)
    there, seen = camera.project(rays[valid])
    assert np.hypot(*(there - pixels[valid])[seen].T).max() <= camera.deviation_px


def test_a_sensor_that_is_turned_about_the_axis_is_refused_and_its_bearings_are_carried_all_the_same():
    turned = OcamPolynomial((-200.0, 0.0, 1e-3), 320.0, 240.0, 640, 480, stretch=(0.0, 1.0, -1.0))
    with pytest.raises(InputError, match="turned about the axis"):
        to_unified(turned)
    image, pixels = unified_image(turned), np.array([[100.0, 50.0], [600.0, 400.0]])
    rays = image.camera.unproject(image.carried(pixels))[0]
    np.testing.assert_allclose(rays, turned.unproject(pixels)[0], rtol=0.0, atol=1e-12)


def test_the_map_covers_the_field_and_its_borders():
    residual = to_unified(TUM_KB).residual
    assert len(residual.pixels) == len(residual.px) == len(residual.rad) > 5000
    rays = TUM_KB.unproject(residual.pixels)[0]
    assert np.arccos(rays[:, 2]).max() > TUM_KB.usable_angle - 1e-6
    assert residual.px.max() == residual.largest_px
    assert residual.rad[np.isfinite(residual.rad)].max() == residual.largest_rad


def test_the_largest_residual_is_nearly_the_least_that_is_possible():
    """A minimax fit oscillates: its largest residual is taken at many places, so it is near the rms."""
    residual = to_unified(TUM_KB).residual
    assert residual.largest_px < 1.5 * residual.rms_px


def test_a_bad_conversion_is_refused_with_its_residual_unless_asked_for():
    panorama = Equirectangular(1000, 500)
    with pytest.raises(InputError, match=r"leaves \d+ px .* of this equirectangular camera, at pixel"):
        to_unified(panorama, largest_px=1.0)
    with pytest.raises(InputError, match=r"leaves 0.0\d+ px .*legal: at most 0.001 px"):
        to_unified(TUM_KB, largest_px=0.001)
    narrow = to_unified(Equirectangular(1000, 500, max_angle=0.2), largest_px=2.0)
    assert narrow.residual.largest_px < narrow.camera.deviation_px < 2.0
    with pytest.raises(InputError, match="Equirectangular: nothing of this class fits a kannala_brandt"):
        convert(TUM_KB, Equirectangular)
    with pytest.raises(InputError, match="largest_px"):
        to_unified(TUM_KB, largest_px=math.nan)


def test_a_fold_inside_the_image_is_said_and_stays_outside_the_camera():
    folding = KannalaBrandt(190.0, 191.0, 254.0, 256.0, 512, 512, k=(-0.1, 0.0, 0.0, 0.0))
    conversion = to_unified(folding)
    assert "kannala_brandt formula is one-to-one only up to 104.607 deg" in conversion.warnings[0]
    assert "unified camera stays one-to-one only up to" in conversion.warnings[-1]
    assert conversion.camera.usable_angle <= folding.usable_angle
    assert conversion.residual.lost < 0.02


def test_a_distorted_pinhole_camera_with_a_mask_is_a_unified_one():
    fields = {"distortion": (-0.25, 0.08, 1e-3, 5e-4), "mask": MASK}
    found = to_unified(Pinhole(500.0, 501.0, 320.0, 240.0, 640, 480, **fields))
    assert found.camera == UnifiedCamera(500.0, 501.0, 320.0, 240.0, 0.0, 640, 480, **fields)


@pytest.mark.slow
def test_a_mask_is_kept_and_costs_nothing():
    fields = {"k": KB, "max_angle": 1.2}
    masked = KannalaBrandt(190.0, 190.0, 255.0, 255.0, 512, 512, **fields, mask=MASK)
    bare = to_unified(KannalaBrandt(190.0, 190.0, 255.0, 255.0, 512, 512, **fields))
    found = to_unified(masked)
    assert found.camera.mask == masked.mask
    assert found.camera.distortion == pytest.approx(bare.camera.distortion, rel=0.05)
    assert found.residual.largest_px < bare.residual.largest_px + 0.02


@pytest.mark.parametrize(
    "kind", [KannalaBrandt, ExtendedUnified, DoubleSphere, OcamPolynomial, UnifiedCamera]
)
def test_a_fisheye_is_written_as_any_other_class(kind):
    model, residual = convert(TUM_KB, kind, largest_px=0.5)
    assert type(model) is kind
    pixels = used_pixels(TUM_KB, 31)
    error = np.hypot(*(model.project(TUM_KB.unproject(pixels)[0])[0] - pixels).T)
    assert error.max() <= residual.largest_px * 1.001 + 1e-12
    assert (residual.largest_px == 0.0) == (kind is KannalaBrandt)


def test_a_narrow_fisheye_is_written_as_a_distorted_pinhole():
    narrow = KannalaBrandt(400.0, 400.0, 320.0, 240.0, 640, 480, k=KB)
    model, residual = convert(narrow, Pinhole, largest_px=0.05)
    assert residual.largest_px < 0.05
    assert len(model.distortion) in (5, 8)


def test_tum_vis_camera_in_three_models_is_one_camera_to_85_degrees(shared_data):
    """Kalibr's and VINS-Mono's files hold the same numbers; Basalt's are calibrations of their own."""
    folder = shared_data / "calibrations"
    chain = (folder / "kalibr/rpng_open_vins__tum_vi_kalibr_imucam_chain.yaml").read_text()
    cam0 = yaml.safe_load(chain.split("\n", 1)[1])["cam0"]
    kb = KannalaBrandt(*cam0["intrinsics"], 512, 512, k=cam0["distortion_coeffs"])
    basalt = {}
    for name in ("ds", "eucm"):
        path = folder / f"basalt/VladyslavUsenko_basalt-mirror__tumvi_512_{name}_calib.json"
        basalt[name] = json.loads(path.read_text())["value0"]["intrinsics"][0]["intrinsics"]
    ds = DoubleSphere(**basalt["ds"], width=512, height=512)
    eucm = ExtendedUnified(**basalt["eucm"], width=512, height=512)
    rays = random_rays(50_000)
    rays = rays[rays[:, 2] > math.cos(math.radians(85)) * np.linalg.norm(rays, axis=1)]
    models = [kb, ds, eucm]
    for group in (models, [to_unified(model).camera for model in models]):
        pixels = [model.project(rays)[0] for model in group]
        for i in range(3):
            assert np.hypot(*(pixels[i] - pixels[i - 1]).T).max() < 1.0
