"""``omniservo estimate`` on image files: tags and natural features in pictures of a fisheye."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from benchmarks.pictured_scenes import Face, crate, picture_of
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import preset
from omniservo.cli.main import main
from omniservo.estimation import estimate_two_view
from omniservo.perception import tag_cells, tag_picture
from omniservo.runs import estimate_images

CAMERA = preset("fe185")
GOAL = RigidTransform.from_components([0.06, -0.04, 0.05], Rotation.from_rotvec([0.03, -0.06, 0.1]))
EDGE = 0.09
TAGS = ("--features", "tags", "--dictionary", "tag36h11")


def tagged(depths):
    """Eight tags in two rows, each at its own depth, all upright."""
    side = 0.5 * EDGE * (1.0 + 2.0 / tag_cells("tag36h11"))
    faces = []
    for number, depth in enumerate(depths):
        column, row = number % 4, number // 4
        centre = np.array([0.13 * (column - 1.5), 0.14 * (row - 0.5), depth])
        picture = np.where(tag_picture("tag36h11", number, pixels_per_cell=1) > 0, 0.9, 0.03)
        sharp = np.kron(picture, np.ones((32, 32)))
        faces.append(Face(RigidTransform.from_translation(centre), np.array([side, side]), sharp))
    return faces


def written(folder, faces, rays=3):
    rng, files = np.random.default_rng(0), []
    for name, pose in (("initial", RigidTransform.identity()), ("goal", GOAL)):
        files += [f"--{name}", str(folder / f"{name}.png")]
        cv2.imwrite(files[-1], picture_of(faces, CAMERA, pose, rng, rays=rays))
    return files


@pytest.fixture(scope="module")
def crates(tmp_path_factory):
    return written(tmp_path_factory.mktemp("crates"), crate(np.random.default_rng(3)), rays=2)


def estimated(capsys, *arguments):
    """Exit code and JSON of the command."""
    with pytest.raises(SystemExit) as end:
        main(["estimate", "--camera", "fe185", *arguments, "--json"])
    return end.value.code, json.loads(capsys.readouterr().out)


def errors(answer):
    """Angles between the rotations and between the translations [deg], and the translation's length [m]."""
    t, rotation = np.array(answer["goal"]["translation"]), Rotation.from_quat(answer["goal"]["quaternion"])
    cosine = t @ GOAL.translation / (np.linalg.norm(t) * np.linalg.norm(GOAL.translation))
    turn = (GOAL.rotation.inv() * rotation).magnitude()
    return np.degrees(turn), np.degrees(np.arccos(min(cosine, 1.0))), float(np.linalg.norm(t))


@pytest.mark.slow
def test_tags_give_motion_a_report_and_a_file(tmp_path, capsys):
    files = written(tmp_path, tagged(0.25 + 0.03 * np.array([0, 4, 1, 6, 3, 7, 5, 2])))
    length = float(np.linalg.norm(GOAL.translation))
    report, out = tmp_path / "report.html", tmp_path / "estimate.json"
    written_to = ["--report", str(report), "--out", str(out)]
    code, answer = estimated(capsys, *files, *TAGS, "--displacement", str(length), *written_to)
    assert code == 0
    turn, swing, found = errors(answer)
    assert (turn < 0.2) & (swing < 1.0)
    assert found == pytest.approx(length)
    assert json.loads(out.read_text())["status"] == "ok"
    assert "<img" in report.read_text()


@pytest.mark.slow
def test_a_flat_board_is_refused_unless_the_target_is_said_to_be_flat(tmp_path, capsys):
    files = [*written(tmp_path, tagged(np.full(8, 0.3))), *TAGS]
    code, answer = estimated(capsys, *files)
    assert (code, answer["status"]) == (1, "planar_points")
    code, answer = estimated(capsys, *files, "--planar")
    assert (code, answer["status"]) == (0, "ok")
    turn, swing, _ = errors(answer)
    assert (turn < 0.2) & (swing < 1.0)


@pytest.mark.slow
def test_natural_features_of_crates_give_the_motion(crates, capsys):
    code, answer = estimated(capsys, *crates, "--features", "natural")
    assert (code, answer["status"]) == (0, "ok")
    turn, swing, _ = errors(answer)
    assert (turn < 0.2) & (swing < 1.0)


@pytest.mark.slow
def test_natural_features_tell_less_than_as_many_that_err_alone(crates):
    found = estimate_images("fe185", Path(crates[1]), Path(crates[3]), features="natural")
    matched = found.seen.matched
    alone = estimate_two_view(CAMERA, matched.initial, matched.goal, noise=matched.noise)
    ratio = np.trace(found.estimate.covariance) / np.trace(alone.covariance)
    assert 1.5 < ratio < 6.0


def test_identical_pictures_hold_no_motion(crates, capsys):
    code, answer = estimated(capsys, *crates[:3], crates[1], "--features", "natural")
    assert (code, answer["status"]) == (1, "no_motion")
    assert answer["goal"] is None


def test_a_flat_and_a_known_target_at_once_are_a_wrong_call(tmp_path, crates, capsys):
    target = tmp_path / "target.yaml"
    target.write_text("format: omniservo.target/1\npoints: [{name: a, position: [0, 0, 0]}]\n")
    with pytest.raises(SystemExit) as end:
        main(["estimate", "--camera", "fe185", *crates, "--planar", *TAGS, "--target", str(target)])
    assert end.value.code == 2
    assert "planar, target: both given" in capsys.readouterr().err
