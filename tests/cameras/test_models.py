"""What every other central model promises: both directions, the domain from both sides, plain values."""

import math

import mpmath
import numpy as np
import pytest

from omniservo.cameras import DeadZone, UnifiedCamera
from omniservo.cameras.models import (
    CentralModel,
    DoubleSphere,
    Equirectangular,
    ExtendedUnified,
    KannalaBrandt,
    OcamPolynomial,
    Pinhole,
    camera_from_dict,
)
from omniservo.errors import InputError

KB = (0.0034823894022493434, 0.0007150348452162257, -0.0020532361418706202, 0.00020293673591811182)
OCAM = (-179.471829787234, 0.0, 0.002316743, -3.635968e-06, 2.05464e-08)
RATIONAL = (-0.28, 0.07, 1e-3, -5e-4, 0.01, 0.1, 0.02, 0.003)
PRISM = (1e-3, 2e-3, -1e-3, 5e-4)

MODELS = {
    "kb": KannalaBrandt(190.978, 190.973, 254.93, 256.9, 512, 512, k=KB),
    "kb 97 deg": KannalaBrandt(190.978, 190.973, 254.93, 256.9, 512, 512, k=KB, max_angle=math.radians(97)),
    "kb folding": KannalaBrandt(-190.0, 191.0, 254.0, 256.0, 512, 512, k=(-0.1, 0.0, 0.0, 0.0), skew=2.0),
    "kb straight": KannalaBrandt(150.0, 150.0, 320.0, 240.0, 640, 480, k=(0.0, 0.0, 0.0, 0.0)),
    "eucm": ExtendedUnified(190.0, -191.0, 255.0, 256.0, 0.6, 1.1, 512, 512),
    "eucm 0.4": ExtendedUnified(190.0, 191.0, 255.0, 256.0, 0.4, 0.8, 512, 512, max_angle=1.5),
    "eucm 0.5": ExtendedUnified(190.0, 191.0, 255.0, 256.0, 0.5, 1.2, 512, 512),
    "eucm 1": ExtendedUnified(190.0, 191.0, 255.0, 256.0, 1.0, 1.2, 512, 512),
    "eucm 0": ExtendedUnified(190.0, 191.0, 255.0, 256.0, 0.0, 1.2, 512, 512),
    "ds": DoubleSphere(158.286, 158.274, 254.96, 256.89, -0.17213, 0.59312, 512, 512),
    "ds 1.7": DoubleSphere(400.0, 400.0, 254.96, 256.9, 1.7, 0.3, 512, 512),
    "ds 1.7, 0.9": DoubleSphere(400.0, 400.0, 254.96, 256.9, 1.7, 0.9, 512, 512),
    "ds 0.3, 0.4": DoubleSphere(-200.0, 200.0, 254.96, 256.9, 0.3, 0.4, 512, 512, max_angle=1.2),
    "ds 0": DoubleSphere(300.0, 300.0, 254.96, 256.9, 1.2, 0.0, 512, 512),
    "ocam": OcamPolynomial(OCAM, 320.0, 240.0, 640, 480, stretch=(0.999, 1e-3, -1e-3)),
    "ocam folding": OcamPolynomial((-200.0, 0.0, 2e-3, -9e-6), 318.0, 242.0, 640, 480),
    "ocam flat": OcamPolynomial((-300.0,), 318.0, 242.0, 640, 480, max_angle=0.9),
    "pinhole": Pinhole(420.0, 421.0, 320.0, 240.0, 640, 480, skew=1.0),
    "pinhole 4": Pinhole(420.0, -421.0, 320.0, 240.0, 640, 480, distortion=RATIONAL[:4]),
    "pinhole 5": Pinhole(420.0, 421.0, 320.0, 240.0, 640, 480, distortion=RATIONAL[:5]),
    "pinhole 8": Pinhole(220.0, 221.0, 320.0, 240.0, 640, 480, distortion=RATIONAL),
    "pinhole 12": Pinhole(420.0, 421.0, 320.0, 240.0, 640, 480, distortion=RATIONAL + PRISM),
    "pinhole 14": Pinhole(420.0, 421.0, 320.0, 240.0, 640, 480, distortion=RATIONAL + PRISM + (0.02, -0.03)),
    "pinhole folding": Pinhole(
        300.0, 300.0, 320.0, 240.0, 640, 480, distortion=(-0.5, 0.05, 3e-3, 4e-3, 0.01)
    ),
    "pinhole wide angle": Pinhole(420.0, 421.0, 320.0, 240.0, 640, 480, max_angle=0.4, distortion=RATIONAL),
    "equirectangular": Equirectangular(1024, 512),
    "equirectangular, 2 rad": Equirectangular(1000, 700, max_angle=2.0),
}
"""Every model, at least one of each that folds in its image, one that ends at max_angle, one mirrored"""

MIRRORS = [UnifiedCamera(300.0, 300.0, 320.0, 240.0, xi, 640, 480) for xi in (0.0, 0.3, 0.9, 1.0, 1.5)]

SKIPS_POLES = ("equirectangular", "equirectangular, 2 rad")


@pytest.fixture(params=MODELS)
def model(request):
    """Every model in turn."""
    return MODELS[request.param]


def angle_of(rays):
    return np.arctan2(np.hypot(rays[..., 0], rays[..., 1]), rays[..., 2])


def at_angle(angle, azimuth):
    angle, azimuth = np.broadcast_arrays(angle, azimuth)
    sine = np.sin(angle)
    return np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), np.cos(angle)], axis=-1)


def image_pixels(model):
    """Return a grid with the image's border, and random pixels."""
    grid = np.meshgrid(np.linspace(-0.5, model.width - 0.5, 71), np.linspace(-0.5, model.height - 0.5, 61))
    random = np.random.default_rng(5).uniform(-0.5, [model.width - 0.5, model.height - 0.5], (4000, 2))
    return np.vstack([np.stack(grid, axis=-1).reshape(-1, 2), random])


def test_every_model_and_the_unified_camera_is_a_central_model(model):
    assert isinstance(model, CentralModel)


def test_pixels_come_back(model):
    pixels = image_pixels(model)
    bearings, valid = model.unproject(pixels)
    assert valid.sum() > 0.1 * len(pixels)
    assert np.abs(np.linalg.norm(bearings[valid], axis=1) - 1).max() < 1e-12
    assert np.isnan(bearings[~valid]).all()
    again, seen = model.project(bearings[valid])
    assert seen.all()
    assert np.abs(again - pixels[valid]).max() <= 1e-9


def test_pixels_round_the_border_of_the_domain_come_back(model):
    """From the last valid pixel outwards and inwards, along rays from the axis."""
    around = np.linspace(0, 2 * np.pi, 97)
    rim, valid = model.project(at_angle(model.usable_angle * (1 - 1e-7), around))
    if not valid.all() or np.abs(rim).max() > 1e5:
        pytest.skip("the image of the rim is at infinity or a seam")
    middle = model.project([0.0, 0.0, 1.0])[0]
    for beyond in np.concatenate([np.linspace(-1e-5, 1e-5, 41), np.linspace(-1e-13, 1e-13, 21), [0.0]]):
        pixels = middle + (1 + beyond) * (rim - middle)
        bearings, valid = model.unproject(pixels)
        again, seen = model.project(bearings[valid])
        assert seen.all()
        if valid.any():
            assert np.abs(again - pixels[valid]).max() <= 1e-9
        assert np.isnan(bearings[~valid]).all()


def test_a_pixel_and_a_point_give_the_same_alone_and_among_others(model):
    """Blocks are worked on four numbers at a time, what is left over one by one."""
    pixels = np.vstack([image_pixels(model)[:1500], [[np.nan, 0.0], [1e300, 1e300], [-1e4, 2e4]]])
    bearings, valid = model.unproject(pixels)
    again, seen = model.project(bearings)
    for i in [0, 1, 5, 510, 511, 512, 513, *range(1490, len(pixels))]:
        bearing, ok = model.unproject(pixels[i])
        assert ok == valid[i]
        assert np.array_equal(bearing, bearings[i], equal_nan=True)
        pixel, ok = model.project(bearings[i])
        assert ok == seen[i]
        assert np.array_equal(pixel, again[i], equal_nan=True)


@pytest.mark.parametrize(
    "lens",
    [
        UnifiedCamera(300.0, 300.0, 320.0, 240.0, 0.6, 640, 480, distortion=(-0.3, 0.05, 0.06, -0.08)),
        Pinhole(420.0, 421.0, 320.0, 240.0, 640, 480, distortion=(-0.28, 0.07, 0.1, -0.1, 0.01)),
    ],
)
def test_distortion_too_strong_for_the_fixed_steps_is_inverted_all_the_same(lens):
    rng = np.random.default_rng(3)
    rays = at_angle(lens.usable_angle * np.sqrt(rng.random(5000)), rng.uniform(0, 2 * np.pi, 5000))
    pixels, valid = lens.project(rays)
    assert valid.all()
    bearings, seen = lens.unproject(pixels)
    assert seen.all()
    assert np.abs(lens.project(bearings)[0] - pixels).max() <= 1e-9


def test_the_ocam_inverse_holds_up_to_the_fold_where_its_slope_is_almost_infinite():
    lens = MODELS["ocam folding"]
    angle = lens.usable_angle * (1.0 - np.logspace(-1, -13, 2000))
    rays = at_angle(angle, np.linspace(0, 40, len(angle)))
    pixels, valid = lens.project(rays)
    assert valid.all()
    bearings, seen = lens.unproject(pixels)
    assert seen.all()
    assert np.linalg.norm(bearings - rays, axis=1).max() < 1e-12


def test_rays_come_back_over_the_whole_domain(model):
    rng = np.random.default_rng(2)
    limit = model.usable_angle
    angle = np.concatenate(
        [rng.uniform(0, limit, 4000), limit * (1 - np.logspace(-3, -15, 400)), [0.0, 1e-9, 1e-160, limit]]
    )
    rays = at_angle(angle, rng.uniform(0.1, 2 * np.pi - 0.1, len(angle)))
    pixels, valid = model.project(rays)
    sure = angle < min(limit * (1 - 1e-9), math.pi - 1e-6)
    assert valid[sure].all()
    near = valid & (np.abs(np.nan_to_num(pixels)).max(axis=1) < 5e3)
    bearings, seen = model.unproject(pixels[near])
    assert seen.all()
    again, seen = model.project(bearings)
    assert seen.all()
    assert np.abs(again - pixels[near]).max() <= 1e-9
    inner = (angle < 0.99 * limit)[near]
    assert np.linalg.norm(bearings - rays[near], axis=1)[inner].max() < 1e-9


def test_validity_is_the_angle_from_the_axis(model):
    rays = np.random.default_rng(7).normal(size=(20_000, 3)) * 3.0
    valid = model.project(rays)[1]
    clear = np.abs(angle_of(rays) - model.usable_angle) > 1e-7
    assert (valid == (angle_of(rays) < model.usable_angle))[clear].all()


def test_points_just_inside_and_just_outside_the_domain(model):
    if model.usable_angle > 3.14:
        pytest.skip("only the direction straight back is outside")
    azimuth = np.linspace(0, 2 * np.pi, 73)
    assert model.project(at_angle(model.usable_angle * (1 - 1e-8), azimuth))[1].all()
    assert not model.project(at_angle(model.usable_angle * (1 + 1e-7), azimuth))[1].any()


def test_pixels_grow_away_from_the_axis_up_to_the_end_of_the_domain(model):
    """One-to-one: along each azimuth the image of the ray never turns back."""
    if isinstance(model, Equirectangular):
        pytest.skip("its poles lie at 90 degrees")
    angle = np.linspace(0, min(model.usable_angle, math.pi - 1e-3), 400)[1:-1]
    for azimuth in np.linspace(0.1, 6.2, 12):
        pixels, valid = model.project(at_angle(angle, azimuth))
        assert valid.all()
        assert (np.diff(np.hypot(*(pixels - model.project([0, 0, 1.0])[0]).T)) > 0).all()


def test_max_angle_is_the_limit_inclusive():
    lens = KannalaBrandt(190.0, 190.0, 255.0, 255.0, 512, 512, k=KB, max_angle=1.2)
    assert lens.usable_angle == 1.2
    assert lens.project(at_angle(1.2, np.linspace(0, 6, 50)))[1].all()
    assert lens.warnings == ()


@pytest.mark.parametrize("model", [m for m in MODELS.values() if m.max_angle is None] + MIRRORS, ids=repr)
def test_a_lens_that_ends_a_rounding_before_its_formula_sees_what_the_formula_does(model):
    """The denominator of the last radius was 0 by rounding: a ZeroDivisionError."""
    angle = model.usable_angle
    pixels = np.random.default_rng(5).uniform(-0.5, [model.width - 0.5, model.height - 0.5], (200, 2))
    for last in (math.nextafter(angle, 0.0), float(f"{angle:.15g}")):
        ended = camera_from_dict({**model.to_dict(), "max_angle": min(last, math.pi)})
        assert ended.usable_angle == pytest.approx(angle, abs=1e-14)
        assert np.array_equal(ended.unproject(pixels)[1], model.unproject(pixels)[1])


def test_what_a_double_sphere_with_xi_1_does_not_show_has_no_bearing():
    """All directions are in the disc of radius 1/α: pixels beyond it saw straight back."""
    sphere = DoubleSphere(206.0, 206.0, 320.0, 240.0, 1.0, 0.4, 1400, 1400)
    pixels = 320.0 + 206.0 / 0.4 * np.array([0.0, 0.5, 0.999, 1.001, 1.5])
    pixels = np.column_stack([pixels, np.full(5, 240.0)])
    bearings, valid = sphere.unproject(pixels)
    assert valid.tolist() == [True, True, True, False, False]
    again, seen = sphere.project(bearings[valid])
    assert seen.all()
    np.testing.assert_allclose(again, pixels[valid], rtol=0.0, atol=1e-9)
    parabolic = DoubleSphere(206.0, 206.0, 320.0, 240.0, 1.0, 0.0, 640, 480)
    assert parabolic.unproject([1e6, 240.0])[1]


def test_the_panorama_s_derivatives_are_those_of_its_side_of_the_seam():
    """A step over the seam is a step over the whole image: it was taken for a slope of 10⁷ px/m."""
    panorama = Equirectangular(1000, 500)
    points = np.array([[1e-7, 0.1, -1.0], [-1e-7, -0.4, -2.0], [1e-6, 0.999999, -1e-6], [0.3, 0.2, -1.0]])
    pixels, slopes, valid = panorama.project_jacobian(points)
    assert valid.all()
    assert np.array_equal(pixels, panorama.project(points)[0])
    for point, slope in zip(points, slopes, strict=True):
        for k in range(3):
            derivative = mpmath.diff(lambda s, p=point, k=k: _longitude(p, k, s), 0)
            assert slope[0, k] == pytest.approx(500 / math.pi * float(derivative), rel=1e-9, abs=1e-9)
            derivative = mpmath.diff(lambda s, p=point, k=k: _latitude(p, k, s), 0)
            assert slope[1, k] == pytest.approx(500 / math.pi * float(derivative), rel=1e-9, abs=1e-9)


def _longitude(point, k, step):
    x, _, z = (mpmath.mpf(float(c)) + step * (i == k) for i, c in enumerate(point))
    return -mpmath.atan2(x, -z)  # which is smooth straight behind


def _latitude(point, k, step):
    x, y, z = (mpmath.mpf(float(c)) + step * (i == k) for i, c in enumerate(point))
    return mpmath.atan2(y, mpmath.hypot(x, z))


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("model", [MODELS["kb"], MODELS["equirectangular"]], ids=["kb", "equirectangular"])
def test_derivatives_at_what_is_no_point_are_not_valid_and_warn_of_nothing(model):
    points = [[math.inf, 0.0, 1.0], [1e200, 0.0, 1.0], [0.0, 0.0, 0.0], [math.nan, 1.0, 1.0], [0.1, 0.2, 1.0]]
    assert model.project_jacobian(points)[2].tolist() == [False] * 4 + [True]
    assert model.unproject_jacobian([[math.inf, 0.0], [60.0, 50.0]])[2].tolist() == [False, True]


def test_numbers_by_name_or_in_no_order_are_no_list_of_numbers():
    for k in ({1: 0.1, 2: 0.2, 3: 0.3, 4: 0.4}, {0.1, 0.2, 0.3, 0.4}):
        with pytest.raises(InputError, match="^k: .* legal: four numbers"):
            KannalaBrandt(300.0, 300.0, 320.0, 240.0, 640, 480, k=k)
        with pytest.raises(InputError, match=r"^dead_zone.center: .* legal: two numbers \[u, v\]"):
            DeadZone(dict(list(k.items())[:2]) if isinstance(k, dict) else {3.0, 4.0}, 5.0)


def test_not_a_number_is_not_valid_and_does_not_spread(model):
    points = np.array([[np.nan, 0, 1], [np.inf, 0, 1], [0, 0, 0], [0, 0, 1e200], [0.0, 0.0, 1.0]])
    pixels, valid = model.project(points)
    assert valid.tolist() == [False, False, False, False, True]
    assert np.isnan(pixels[:4]).all()
    bad = np.array([[np.nan, 0], [np.inf, 0], [1e300, 1e300], pixels[4]])
    bearings, valid = model.unproject(bad)
    assert valid.tolist() == [False, False, False, True]
    assert np.isnan(bearings[:3]).all()
    assert bearings[3] == pytest.approx([0, 0, 1], abs=1e-12)


def test_shapes_types_and_wrong_arguments(model):
    rays = at_angle(0.3, np.linspace(0, 6, 24))
    pixels, valid = model.project(rays.reshape(2, 3, 4, 3))
    assert pixels.shape == (2, 3, 4, 2)
    assert valid.shape == (2, 3, 4)
    assert np.array_equal(pixels.reshape(-1, 2), model.project(rays)[0])
    assert model.unproject(pixels)[0].shape == (2, 3, 4, 3)
    assert model.project(np.empty((0, 3)))[0].shape == (0, 2)
    assert model.project([1, 2, 5])[0].shape == (2,)
    assert model.in_image(pixels).shape == (2, 3, 4)
    for wrong in ([1.0, 2.0], [["a", "b", "c"]], [[1, 2, 3], [1]], 3.0, [True, True, True]):
        with pytest.raises(InputError, match="points"):
            model.project(wrong)
    with pytest.raises(InputError, match="pixels"):
        model.unproject([1.0, 2.0, 3.0])


def test_the_dictionary_gives_an_equal_model(model):
    again = camera_from_dict(model.to_dict())
    assert type(again) is type(model)
    assert again == model
    assert hash(again) == hash(model)
    assert again.to_dict() == model.to_dict()


def test_lens_fields_are_checked_and_kept():
    mask = (((0.0, 0.0), (20.0, 0.0), (0.0, 20.0)),)
    lens = ExtendedUnified(190, 191, 255, 256, 0.6, 1.1, 512, 512, dead_zone=((250, 250), 30), mask=mask)
    assert lens.dead_zone == DeadZone((250.0, 250.0), 30.0)
    assert lens.in_image([[250.0, 260.0], [5.0, 5.0], [100.0, 100.0], [512.0, 5.0]]).tolist() == [
        False,
        False,
        True,
        False,
    ]
    assert camera_from_dict(lens.to_dict()) == lens


def test_a_formula_that_folds_inside_the_image_is_warned_of():
    folding = MODELS["kb folding"]
    (warning,) = folding.warnings
    assert f"{math.degrees(folding.usable_angle):.3f} deg" in warning
    share = 1 - folding.unproject(image_pixels(folding))[1].mean()
    assert abs(float(warning.split("image: ")[1].split("%")[0]) / 100 - share) < 0.03
    assert MODELS["kb"].warnings == ()
    assert MODELS["equirectangular"].warnings == ()


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: KannalaBrandt(0.0, 1, 1, 1, 9, 9, k=KB), "fx"),
        (lambda: KannalaBrandt(1, 1, 1, 1, 9, 9, k=KB[:3]), "k: .*four numbers"),
        (lambda: KannalaBrandt(1, 1, math.nan, 1, 9, 9, k=KB), "cx"),
        (lambda: ExtendedUnified(1, 1, 1, 1, 1.1, 1, 9, 9), "alpha"),
        (lambda: ExtendedUnified(1, 1, 1, 1, 0.5, 0.0, 9, 9), "beta"),
        (lambda: DoubleSphere(1, 1, 1, 1, -1.0, 0.5, 9, 9), "xi"),
        (lambda: OcamPolynomial((1.0, 2.0), 1, 1, 9, 9), "a0 = 1 given; legal: below 0"),
        (lambda: OcamPolynomial((-1.0,), 1, 1, 9, 9, stretch=(1, 1, 1)), "stretch"),
        (lambda: Pinhole(1, 1, 1, 1, 9, 9, distortion=(1, 2, 3)), "0, 4, 5, 8, 12 or 14"),
        (lambda: Pinhole(1, 1, 1, 1, 9, 9, distortion=(0.0,) * 13 + (2.0,)), "tilt"),
        (lambda: Equirectangular(9.5, 9), "width"),
        (lambda: Equirectangular(9, 9, max_angle=4.0), "max_angle"),
        (lambda: camera_from_dict({"model": "other"}), "camera: model: 'other' given; legal: unified, kann"),
        (lambda: camera_from_dict({"model": "eucm", "fx": 1}, "f.json"), "f.json: fy: missing"),
        (lambda: camera_from_dict({**MODELS["eucm"].to_dict(), "k": 1}), "camera: k: no such field"),
        (lambda: camera_from_dict([1]), "camera: list given"),
    ],
)
def test_wrong_fields_are_named(make, message):
    with pytest.raises(InputError, match=message):
        make()


def test_the_unified_camera_is_read_too():
    camera = UnifiedCamera(300.0, 300.0, 320.0, 240.0, 0.9, 640, 480)
    assert camera_from_dict(camera.to_dict()) == camera
