"""Every format by one table: what a file says, and the camera that it is; and back."""

import json
from functools import partial

import cv2
import numpy as np
import pytest
from tests.calibration.format_samples import CAMERAS, OCAM, PY_OCAM, SAMPLES

from omniservo.camera_files import FORMATS, closest_model, load_camera, load_model, save_camera
from omniservo.camera_files.camera_files import WRITTEN
from omniservo.cameras import UnifiedCamera
from omniservo.cameras.conversion import to_unified
from omniservo.cameras.models import (
    DoubleSphere,
    Equirectangular,
    ExtendedUnified,
    KannalaBrandt,
    OcamPolynomial,
    Pinhole,
)
from omniservo.errors import InputError


def numbers(value):
    """Flatten what to_dict gives into words and numbers."""
    if isinstance(value, dict):
        return [part for key in sorted(value) for part in [key, *numbers(value[key])]]
    if isinstance(value, list | tuple):
        return [part for inner in value for part in numbers(inner)]
    return [value]


def fields_of(camera):
    """A camera's fields; a pinhole's distortion with the zeros that may be left out."""
    fields = camera.to_dict()
    if isinstance(camera, Pinhole):
        fields["distortion"] = [*fields["distortion"], *[0.0] * 14][:14]
    return fields


def assert_same(one, other):
    """Equal, numbers to a few roundings."""
    assert type(one) is type(other)
    for a, b in zip(numbers(fields_of(one)), numbers(fields_of(other)), strict=True):
        assert a == (pytest.approx(b, rel=1e-14, abs=1e-14) if isinstance(b, float) else b)


@pytest.mark.parametrize("sample", SAMPLES)
def test_sample_is_read_to_its_numbers(tmp_path, sample):
    text, options, expected = SAMPLES[sample]
    path = tmp_path / "camera.dat"  # the name says nothing
    path.write_text(text)
    assert_same(load_model(path, **options), expected)


@pytest.mark.parametrize(
    ("format_name", "suffix"),
    [(name, ".yaml") for name in FORMATS]
    + [(name, ".json") for name in ("own", "kalibr", "ros", "opencv")]
    + [("opencv", ".xml")],
)
@pytest.mark.parametrize("camera", CAMERAS)
def test_written_file_is_read_back_equal_or_nothing_is_written(tmp_path, format_name, camera, suffix):
    path = tmp_path / f"camera{suffix}"
    try:
        save_camera(CAMERAS[camera], path, format_name)
    except InputError as error:
        assert format_name in str(error) or "format" in str(error)  # noqa: PT017
        assert not any(tmp_path.iterdir())
        kinds = WRITTEN[format_name].kinds
        plain = {"unified, plain", "Kannala-Brandt", "EUCM", "double sphere", "OCam", "pinhole", "lens"}
        assert camera not in plain or not isinstance(CAMERAS[camera], kinds)
        return
    assert_same(load_model(path), CAMERAS[camera])


def test_every_model_but_equirectangular_has_a_foreign_format():
    held = {kind for written in WRITTEN.values() for kind in written.kinds}
    assert {type(camera) for camera in CAMERAS.values()} - held == {Equirectangular}


@pytest.mark.parametrize("suffix", [".yaml", ".json", ".xml"])
@pytest.mark.parametrize("camera", ["unified", "Kannala-Brandt", "pinhole, eight"])
def test_opencv_reads_what_we_write_as_opencv(tmp_path, camera, suffix):
    model = CAMERAS[camera]
    save_camera(model, tmp_path / f"camera{suffix}", "opencv")
    storage = cv2.FileStorage(str(tmp_path / f"camera{suffix}"), cv2.FILE_STORAGE_READ)
    matrix, distortion = (
        storage.getNode("camera_matrix").mat(),
        storage.getNode("distortion_coefficients").mat(),
    )
    points = np.random.default_rng(3).uniform([-0.5, -0.4, 0.8], [0.5, 0.4, 1.5], (50, 3))
    still, rows = np.zeros(3), points.reshape(-1, 1, 3)
    if camera == "unified":
        xi = storage.getNode("xi").real()
        pixels, _ = cv2.omnidir.projectPoints(rows, still, still, matrix, xi, distortion)
    elif camera == "Kannala-Brandt":
        pixels, _ = cv2.fisheye.projectPoints(rows, still, still, matrix, distortion)
    else:
        pixels, _ = cv2.projectPoints(rows, still, still, matrix, distortion)
    assert np.abs(pixels.reshape(-1, 2) - model.project(points)[0]).max() < 1e-9


def test_opencv_reads_camodocal_files_of_every_kind(tmp_path):
    for camera, field in (("Kannala-Brandt", "mu"), ("pinhole, four", "fx"), ("unified", "gamma1")):
        model = CAMERAS[camera]
        save_camera(model, tmp_path / "camera.yaml", "camodocal", force=True)
        storage = cv2.FileStorage(str(tmp_path / "camera.yaml"), cv2.FILE_STORAGE_READ)
        assert storage.getNode("projection_parameters").getNode(field).real() == model.fx


@pytest.mark.parametrize(
    ("polynomial", "within"), [((-206.5, 0.0, 2.2e-3, -4.9e-6, 1.9e-8), 0.02), (None, 4.0)]
)
def test_written_ocamcalib_inverse_polynomial_inverts_as_the_file_says(tmp_path, polynomial, within):
    camera = OcamPolynomial(polynomial or OCAM.coefficients, 456.25, 382.5, 1024, 768, stretch=OCAM.stretch)
    save_camera(camera, tmp_path / "calib_results.txt", "ocamcalib")
    text = (tmp_path / "calib_results.txt").read_text()
    said = float(text.partition("within ")[2].split()[0])
    assert said < within
    rows = [list(map(float, line.split())) for line in text.splitlines() if line and not line.startswith("#")]
    inverse, (row, column), (c, d, e) = np.array(rows[1][1:]), rows[2], rows[3]
    pixels = np.random.default_rng(5).uniform([0, 0], [1023, 767], (200, 2))
    bearings, valid = camera.unproject(pixels)
    # ocam_functions.c, world2cam: x down the rows, y along the columns, z backwards
    x, y, z = bearings[valid][:, 1], bearings[valid][:, 0], -bearings[valid][:, 2]
    flat = np.hypot(x, y)
    rho = np.polynomial.polynomial.polyval(np.arctan(z / flat), inverse)
    rows_seen = c * x / flat * rho + d * y / flat * rho + row
    columns_seen = e * x / flat * rho + y / flat * rho + column
    assert valid.all()
    assert np.abs(np.column_stack([columns_seen, rows_seen]) - pixels).max() < 1.1 * said


def test_py_ocamcalib_pixels_have_the_rays_that_its_cam2world_gives(tmp_path):
    """Its formula: S⁻¹ (pixel − centre) = (x, y), and the ray (x, y, a0 + a1ρ + …)."""
    stretch = np.array([[1.0033, 1.5e-4], [1.75e-4, 1.0]])
    path = tmp_path / "calibration.json"
    path.write_text(json.dumps({**PY_OCAM, "stretch_matrix": stretch.tolist()}))
    camera = load_model(path, size=(1032, 778))
    pixels = np.random.default_rng(3).uniform([60.0, 40.0], [970.0, 730.0], (200, 2))
    x, y = np.linalg.solve(stretch, (pixels - PY_OCAM["distortion_center"]).T)
    z = np.polynomial.polynomial.polyval(np.hypot(x, y), PY_OCAM["taylor_coefficient"])
    rays, valid = camera.unproject(pixels)
    assert valid.all()
    expected = np.stack([x, y, z], axis=-1) / np.sqrt(x * x + y * y + z * z)[:, None]
    np.testing.assert_allclose(rays, expected, atol=1e-12)
    assert camera.project(expected)[0] == pytest.approx(pixels, abs=1e-6)


def test_tum_vi_camera_is_the_same_in_four_formats_to_85_degrees(shared_data):
    folder = shared_data / "calibrations"
    kannala = load_model(folder / "kalibr/rpng_open_vins__tum_vi_kalibr_imucam_chain.yaml", name="cam0")
    assert load_model(folder / "mei_yaml/HKUST-Aerial-Robotics_VINS-Mono__tum_config.yaml") == kannala
    others = [
        load_model(folder / f"basalt/VladyslavUsenko_basalt-mirror__tumvi_512_{kind}_calib.json", name="cam0")
        for kind in ("ds", "eucm")
    ]
    assert [type(other) for other in others] == [DoubleSphere, ExtendedUnified]
    angle, round_ = np.meshgrid(np.radians(np.linspace(0, 85, 86)), np.linspace(0, 2 * np.pi, 60))
    rays = np.stack([np.sin(angle) * np.cos(round_), np.sin(angle) * np.sin(round_), np.cos(angle)], axis=-1)
    pixels, valid = kannala.project(rays)
    assert valid.all()
    for other in others:
        seen, valid = other.project(rays)
        assert valid.all()
        assert np.linalg.norm(seen - pixels, axis=-1)[kannala.in_image(pixels)].max() < 1.0


def test_mei_toolbox_value_projects_as_the_toolbox_says(shared_data):
    path = shared_data / "calibrations/mei_toolbox/mei_toolbox_golden.json"
    golden = json.loads(path.read_text())
    pixel, valid = load_model(path, size=(640, 480)).project(np.array(golden["X"]))
    assert valid
    assert np.abs(pixel - golden["pixel"]).max() < 1e-9


def real_files(shared_data):
    files = sorted((shared_data / "calibrations").glob("*/*.*"))
    return [*files, shared_data / "visp_franka_eye_in_hand/franka_camera.xml"]


def real_models(shared_data):
    for path in real_files(shared_data):
        size = (640, 480) if path.parent.name == "mei_toolbox" else None
        try:
            yield path, load_model(path, size=size)
        except InputError as error:
            assert " cameras; say which: --camera-name" in str(error), error  # noqa: PT017
            for name in str(error).partition("name one of: ")[2].split(", "):
                yield path, load_model(path, name=name, size=size)


def test_every_real_camera_is_read_and_read_back_from_each_format_that_holds_it(tmp_path, shared_data):
    count = 0
    for path, model in real_models(shared_data):
        held = 0
        for format_name in FORMATS:
            out = tmp_path / f"{count}-{format_name}.yaml"
            try:
                save_camera(model, out, format_name)
            except InputError:
                continue
            assert_same(load_model(out), model)
            held += 1
        assert held >= 2, path
        count += 1
    assert count >= 28


def test_opencv_data_without_a_camera_says_so(shared_data):
    path = shared_data / "opencv_omnidir/omni_calib_data.xml"
    with pytest.raises(
        InputError, match=r"no camera in it: camera_matrix, K or M is needed; found: objectPoints"
    ):
        load_model(path)


CONVERTED = [
    ("kalibr/rpng_open_vins__tum_vi_kalibr_imucam_chain.yaml", "cam0", "mei", UnifiedCamera, 0.1),
    ("kalibr/rpng_open_vins__tum_vi_kalibr_imucam_chain.yaml", "cam0", "ocamcalib", OcamPolynomial, 0.3),
    ("basalt/VladyslavUsenko_basalt-mirror__tumvi_512_ds_calib.json", "cam0", "colmap", KannalaBrandt, 0.5),
    ("mei_yaml/KITTI-360__image_02.yaml", None, "ros", KannalaBrandt, 0.5),
]


@pytest.mark.parametrize(("file", "name", "format_name", "kind", "largest_px"), CONVERTED)
def test_closest_model_is_as_close_as_its_residual_says(
    tmp_path, shared_data, file, name, format_name, kind, largest_px
):
    camera = load_model(shared_data / "calibrations" / file, name=name)
    model, residual = closest_model(camera, format_name, largest_px=largest_px)
    assert type(model) is kind
    save_camera(model, tmp_path / "camera", format_name)
    read = load_model(tmp_path / "camera")
    assert_same(read, model)
    pixels = np.random.default_rng(2).uniform([0, 0], [camera.width - 1, camera.height - 1], (2000, 2))
    rays, valid = camera.unproject(pixels)
    seen, also = read.project(rays)
    assert (valid & also).mean() > 0.6
    assert np.linalg.norm(seen - pixels, axis=1)[valid & also].max() <= 1.05 * residual.largest_px


NARROW = KannalaBrandt(
    190.978, 190.973, 254.932, 256.897, 512, 512,
    k=(3.48e-3, 7.15e-4, -2.05e-3, 2.03e-4), max_angle=1.2, deviation_px=0.25,
)  # fmt: skip


@pytest.mark.parametrize("first", FORMATS)
def test_a_deviation_stays_from_format_to_format_without_a_conversion(tmp_path, first):
    camera = next(
        c for c in CAMERAS.values() if c.deviation_px and isinstance(c, WRITTEN[first].kinds or object)
    )
    save_camera(camera, tmp_path / "first", first)
    loaded = load_model(tmp_path / "first")
    assert loaded.deviation_px == 1 / 3
    for second in FORMATS:
        if not WRITTEN[second].kinds or isinstance(camera, WRITTEN[second].kinds):
            model, residual = closest_model(loaded, second)
            save_camera(model, tmp_path / second, second)
            assert (load_model(tmp_path / second).deviation_px, residual) == (1 / 3, None)


@pytest.mark.slow
def test_every_conversion_of_a_chain_adds_its_residual_to_the_deviation(tmp_path):
    camera, total = NARROW, 0.25
    for format_name in ("mei", "ros", "ocamcalib", "kalibr"):
        model, residual = closest_model(camera, format_name)
        assert residual.largest_px > 0.0
        total += residual.largest_px
        save_camera(model, tmp_path / format_name, format_name)
        camera = load_model(tmp_path / format_name)
        assert total < camera.deviation_px < 0.25 + 1.002 * (total - 0.25)
    pixels = np.random.default_rng(4).uniform([0, 0], [511, 511], (2000, 2))
    rays, valid = NARROW.unproject(pixels)
    seen, also = camera.project(rays)
    apart = np.linalg.norm(seen - pixels, axis=1)[valid & also]
    assert apart.max() <= camera.deviation_px - 0.25 + 1e-3


def test_an_exact_equivalent_keeps_the_deviation():
    same = closest_model(CAMERAS["pinhole, deviation"], "mei")[0]
    assert (type(same), same.deviation_px) == (UnifiedCamera, 1 / 3)
    sphere = DoubleSphere(300.0, 300.0, 320.0, 240.0, 0.0, 0.6, 640, 480, deviation_px=2.5)
    assert to_unified(sphere).camera.deviation_px == 2.5


TRACKING = """cam0:
  camera_model: pinhole
  distortion_model: equidistant
  distortion_coeffs: [-0.0073, 0.0435, -0.0412, 0.0077]
  intrinsics: [285.4, 286.3, 416.2, 402.7]
  resolution: [848, 800]
"""


@pytest.mark.slow
def test_a_fisheye_file_that_describes_more_than_its_lens_sees_is_read_with_max_angle(tmp_path):
    path = tmp_path / "camera.yaml"
    path.write_text(TRACKING)
    for read in (partial(load_camera, largest_px=1.0), lambda file: closest_model(load_model(file), "mei")):
        with pytest.raises(InputError, match=r"formula reaches 1\d\d.*--max-angle DEG"):
            read(path)
    camera = load_camera(path, max_angle=np.radians(82.0))
    assert 0.0 < camera.deviation_px < 0.3
    assert camera.max_angle == pytest.approx(np.radians(82.0))
    narrow = load_model(path, max_angle=1.2)
    save_camera(narrow, path, "kalibr", force=True)
    assert load_model(path, max_angle=1.4) == narrow, "a file's own limit stays where it is less"


def test_a_model_that_the_format_holds_is_not_converted():
    for camera in CAMERAS.values():
        assert closest_model(camera, "own") == (camera, None)


def test_a_conversion_worse_than_allowed_is_refused_with_its_residual(shared_data):
    path = shared_data / "calibrations/ocamcalib/premnirmal_Homing-in-Scale-Space__calib_results.txt"
    with pytest.raises(InputError, match=r"its closest model, UnifiedCamera, is up to \d.* px away; legal"):
        closest_model(load_model(path), "mei")
    with pytest.raises(InputError, match=r"calib_results\.txt: .* px"):
        load_camera(path, largest_px=1.0)
    assert load_camera(path).deviation_px > 1.0


def test_an_exact_equivalent_needs_no_allowance(shared_data):
    path = shared_data / "visp_franka_eye_in_hand/franka_camera.xml"
    camera = load_camera(path, largest_px=0.0)
    assert (camera.xi, camera.fx, camera.deviation_px) == (0.0, 607.5931396484375, 0.0)
