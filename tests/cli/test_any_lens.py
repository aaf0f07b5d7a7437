"""Every command that takes a camera takes the files that people have, whatever model they hold."""

import json

import cv2
import numpy as np
import pytest
from benchmarks.lens_conversions import PUBLISHED
from benchmarks.pictured_scenes import crate, picture_of
from scipy.spatial.transform import RigidTransform, Rotation
from tests.cli.calling import call

from omniservo.camera_files import load_model, save_camera
from omniservo.cameras.conversion import to_unified
from omniservo.cameras.models import KannalaBrandt
from omniservo.estimation import TwoViewEstimate
from omniservo.risk.problem_around import problem_around

GOAL = RigidTransform.from_components([0.06, -0.04, 0.05], Rotation.from_rotvec([0.03, -0.06, 0.1]))
T265, COLOUR = PUBLISHED["RealSense T265, fisheye"], PUBLISHED["RealSense, colour"]
HALF = KannalaBrandt(
    0.5 * T265.fx, 0.5 * T265.fy, 0.5 * T265.cx - 0.25, 0.5 * T265.cy - 0.25, 424, 400, k=T265.k
)
"""A T265's fisheye at half of its pixels along each side: u' = u/2 − 1/4"""

FILES = {
    "kalibr": (T265, "kalibr", "camchain.yaml"),
    "ros": (COLOUR, "ros", "camera_info.yaml"),
    "kalibr, half": (HALF, "kalibr", "camchain.yaml"),
    "opencv": (HALF, "opencv", "fisheye.yml"),
    "camodocal": (HALF, "camodocal", "camera.yaml"),
    "ocamcalib": (PUBLISHED["Kodak, OCam, 235°"], "ocamcalib", "calib_results.txt"),
}


def written(folder, name):
    """The file of a lens, in a format that holds its model."""
    lens, format_name, file = FILES[name]
    save_camera(lens, folder / file, format_name)
    return folder / file


@pytest.fixture(scope="module")
def pictures(tmp_path_factory):
    """Two pictures of a crate through half of a T265's own lens, and the second one a little turned."""
    folder = tmp_path_factory.mktemp("pictures")
    faces, rng = crate(np.random.default_rng(3)), np.random.default_rng(0)
    bumped = RigidTransform.from_rotation(Rotation.from_rotvec([0.0, np.radians(0.5), 0.0]))
    for name, pose in (("initial", RigidTransform.identity()), ("goal", GOAL), ("bumped", bumped)):
        cv2.imwrite(str(folder / f"{name}.png"), picture_of(faces, HALF, pose, rng))
    return folder


@pytest.mark.parametrize("name", FILES)
def test_a_camera_is_shown_with_what_its_unified_form_costs(tmp_path, capsys, name):
    code, said, _ = call(capsys, "camera", "show", written(tmp_path, name))
    assert code == 0
    assert "as unified     at most " in said
    assert " px (" in said


@pytest.mark.slow
def test_an_estimate_uses_the_file_s_own_model_and_keeps_it(tmp_path, capsys, pictures):
    file = written(tmp_path, "kalibr, half")
    images = ("--initial", pictures / "initial.png", "--goal", pictures / "goal.png", "--features", "natural")
    out = tmp_path / "estimate.json"
    scale = ("--displacement", float(np.linalg.norm(GOAL.translation)))
    code, _, err = call(capsys, "estimate", "--camera", file, *images, *scale, "--out", out)
    assert code == 0, err
    found = TwoViewEstimate.load(out)
    assert found.camera.to_dict()["model"] == "kannala_brandt"
    error = GOAL.inv() * found.initial_T_goal
    assert error.rotation.magnitude() < np.radians(0.1)
    assert np.linalg.norm(error.translation) < 2e-3
    obstacles = tmp_path / "obstacles.json"
    obstacles.write_text(json.dumps({"format": "omniservo.obstacles/1"}))
    problem = problem_around(found, obstacles)
    assert problem.camera == to_unified(found.camera).camera
    assert problem.notices[0] == to_unified(found.camera).cost


@pytest.mark.slow
def test_a_bump_is_told_with_the_file_s_own_model(tmp_path, capsys, pictures):
    file = written(tmp_path, "opencv")
    now = ("camera", "check", pictures / "initial.png", pictures / "bumped.png", "--camera", file)
    code, said, _ = call(capsys, *now, "--model", "fisheye", "--size", "424x400", "--json")
    answer = json.loads(said)
    assert code == 1
    assert answer["moved"] is True
    assert np.degrees(answer["rotation_rad"]) == pytest.approx(0.5, abs=0.03)


def test_an_image_is_rectified_with_the_file_s_own_model(tmp_path, capsys, pictures):
    view = tmp_path / "view.png"
    file = written(tmp_path, "camodocal")
    code, _, err = call(capsys, "camera", "rectify", file, pictures / "initial.png", view)
    assert code == 0, err
    assert cv2.imread(str(view)).shape[:2] == (720, 960)


@pytest.mark.slow
def test_the_largest_px_refuses_only_where_it_is_given(tmp_path, capsys):
    file, out = written(tmp_path, "kalibr"), tmp_path / "goal.json"
    words = ("teach", "paper-example-1", "--camera", file, "--out", out)
    code, _, err = call(capsys, *words, "--largest-px", 3)
    assert (code, err.count("\n")) == (2, 1)
    assert "leaves 3.87 px (1.57 deg) of this kannala_brandt camera" in err
    assert "--max-angle DEG" in err
    assert not out.exists()
    assert call(capsys, *words)[0] == 0
    assert json.loads(out.read_text())["camera"] == {**load_model(file).to_dict(), "model_error": {
        "sigma_px": pytest.approx(0.2544), "length_px": pytest.approx(84.8)}}  # fmt: skip
    assert call(capsys, *words, "--force", "--max-angle", 85, "--largest-px", 1)[0] == 0
