"""How exactly a camera's parameters are known travels with the camera, and every estimate counts it."""

import json
import re

import numpy as np
import pytest
from board_views import draw_views
from typer.testing import CliRunner

import omniservo
from omniservo import UnifiedCamera, calibrate_camera, estimate_two_view, estimate_views
from omniservo.camera_files import closest_model, load_model, save_camera
from omniservo.cameras import preset
from omniservo.cli.main import app
from omniservo.errors import InputError

RNG = np.random.default_rng(40)
ROOT = np.diag([2.0, 2.0, 1.0, 1.0, 0.02]) @ RNG.normal(size=(5, 5))
COVARIANCE = ROOT @ ROOT.T
EXACT = preset("fe185")
KNOWN = UnifiedCamera.from_dict({**EXACT.to_dict(), "calibration_covariance": COVARIANCE})
POINTS = RNG.uniform([-0.3, -0.2, 0.4], [0.3, 0.2, 0.8], (40, 3))
STEP = np.array([0.15, 0.05, 0.02])
VIEWS = [EXACT.project(POINTS - k * STEP)[0] + 0.1 * RNG.normal(size=(40, 2)) for k in range(3)]


@pytest.mark.parametrize("format_name", ["own", "mei", "camodocal", "kalibr", "basalt"])
def test_a_covariance_is_saved_and_loaded_in_every_format(tmp_path, format_name):
    save_camera(KNOWN, tmp_path / "camera.yaml", format_name)
    assert load_model(tmp_path / "camera.yaml") == KNOWN
    assert load_model(tmp_path / "camera.yaml") != EXACT


def test_parameters_of_another_model_are_not_those_that_were_calibrated():
    assert "calibration_covariance" not in closest_model(KNOWN, "ocamcalib")[0].to_dict()


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (np.eye(4), r"shape \(4, 4\)"),
        (np.triu(np.ones((5, 5))), "symmetric"),
        (-np.eye(9), "negative"),
        (np.full((5, 5), np.nan), "finite"),
    ],
)
def test_what_is_no_covariance_is_refused(value, words):
    with pytest.raises(InputError, match=f"calibration_covariance.*{words}"):
        UnifiedCamera.from_dict({**EXACT.to_dict(), "calibration_covariance": value})


def test_two_views_count_what_the_camera_states_where_nothing_else_is_given():
    own, given, exact, other = (
        estimate_two_view(camera, *VIEWS[:2], noise=0.1, calibration_covariance=covariance).covariance
        for camera, covariance in (
            (KNOWN, None),
            (EXACT, COVARIANCE),
            (EXACT, None),
            (KNOWN, 0.25 * COVARIANCE),
        )
    )
    np.testing.assert_allclose(own, given, rtol=1e-9)
    np.testing.assert_allclose(other - exact, 0.25 * (own - exact), rtol=1e-6, atol=1e-15)
    assert np.trace(own) > 1.5 * np.trace(exact)


def test_many_views_count_what_the_camera_states_where_nothing_else_is_given():
    own, given = (
        estimate_views(camera, VIEWS, noise=0.1, calibration_covariance=covariance)
        for camera, covariance in ((KNOWN, None), (EXACT, COVARIANCE))
    )
    assert own.status == given.status == "ok"
    np.testing.assert_allclose(own.two_view(2).covariance, given.two_view(2).covariance, rtol=1e-6)


def test_a_planar_estimate_counts_it_too():
    flat = np.column_stack([POINTS[:, :2], 0.5 + 0.5 * POINTS[:, 0]])
    views = [EXACT.project(flat - k * STEP)[0] for k in range(2)]
    own, exact = (estimate_two_view(c, *views, method="homography", noise=0.1) for c in (KNOWN, EXACT))
    for found in (own, exact):
        assert found.status in ("ok", "ambiguous")
    if own.status == exact.status == "ok":
        assert np.trace(own.covariance) > np.trace(exact.covariance)


def test_a_calibration_states_its_covariance_in_its_camera():
    seen = draw_views(EXACT, np.random.default_rng(0), views=8, distances=(0.08, 0.2))
    calibrated = calibrate_camera(*seen, (EXACT.width, EXACT.height), distortion="none")
    stated = np.array(calibrated.camera.calibration_covariance)
    np.testing.assert_allclose(stated, calibrated.covariance, rtol=1e-9, atol=1e-15)
    mirrored = np.array(calibrated.mirrored().calibration_covariance)
    np.testing.assert_allclose(np.diag(mirrored), np.diag(stated))
    np.testing.assert_allclose(mirrored[0, 1], -stated[0, 1])


def test_the_camera_is_shown_with_what_its_parameters_are_known_to(tmp_path):
    save_camera(KNOWN, tmp_path / "camera.json")
    shown = CliRunner().invoke(app, ["camera", "show", str(tmp_path / "camera.json")])
    assert shown.exit_code == 0, shown.output
    assert "known to (1 σ)" in shown.output
    assert "fx ± " in shown.output
    assert omniservo.load_camera(tmp_path / "camera.json").calibration_covariance is not None


@pytest.mark.parametrize(
    ("format_name", "words", "kept"),
    [("kalibr", "fx ± .*written with it", True), ("ocamcalib", "left out, since .* Ocam", False)],
)
def test_a_conversion_says_what_becomes_of_the_covariance(tmp_path, format_name, words, kept):
    save_camera(KNOWN, tmp_path / "camera.json")
    call = [
        "camera",
        "convert",
        str(tmp_path / "camera.json"),
        str(tmp_path / "out.yaml"),
        "--to",
        format_name,
    ]
    said = CliRunner().invoke(app, [*call, "--largest-px", "5"])
    assert said.exit_code == 0, said.output
    assert re.search(f"calibration_covariance: .*{words}", said.output)
    said = CliRunner().invoke(app, [*call, "--largest-px", "5", "--force", "--json"])
    assert json.loads(said.output)["calibration_covariance"] is kept
