"""Conventions of the suites that others wrote are carried over right, and what is absent says so."""

import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform

pytest.importorskip("benchmarks.comparisons", reason="benchmarks/ is not part of this copy")

from benchmarks.comparisons.machine_vision import compare as machine_vision
from benchmarks.comparisons.mrcal import compare as mrcal
from benchmarks.comparisons.opengv import past_90
from benchmarks.comparisons.visp import april_tags

from omniservo import preset
from omniservo.servoing import servo_method


@pytest.fixture(scope="module")
def suite():
    if not april_tags.DATA.is_dir():
        pytest.skip(f"Debian's {april_tags.PACKAGE} is not installed")
    return april_tags


@pytest.mark.parametrize("name", ["tag36h11", "tagCircle49h12"])
def test_the_suites_own_corners_are_counted_as_right_and_a_half_pixel_or_a_quarter_turn_is_not(suite, name):
    family = suite.load_family(name)
    count = suite.counted(family, family.listed)
    assert (count.corners, count.poses, count.false) == (5, 5, 0)
    turned = {number: np.roll(corners, 1, axis=0) for number, corners in family.listed.items()}
    assert suite.counted(family, turned).corners == 0
    off = {number: corners + suite.PIXEL_ORIGIN + 0.01 for number, corners in family.listed.items()}
    assert suite.counted(family, off).corners == 0


def test_every_tag_of_a_family_of_the_suite_is_found_within_its_limits(suite):
    family = suite.load_family("tagStandard41h12")
    count = suite.counted(family, suite.by_us(family.image, family.name, suite.camera()))
    assert (count.tags, count.false, count.corners, count.poses) == (5, 0, 5, 5)


def test_a_suite_that_is_absent_says_what_to_install(monkeypatch, tmp_path):
    monkeypatch.setattr(april_tags, "DATA", tmp_path / "none")
    monkeypatch.setattr(mrcal, "COMMAND", "no-such-command")
    monkeypatch.setattr(past_90.shutil, "which", lambda name: None)
    for lines in (april_tags.lines(), mrcal.lines(), past_90.lines(1)):
        assert next(lines).startswith("Not run: ")


@pytest.mark.parametrize("two_views", [True, False])
def test_half_of_the_points_drawn_lie_past_90_degrees_and_their_pose_is_the_stated_one(two_views):
    camera = preset(past_90.CAMERA)
    scene = past_90.draw_scene(np.random.default_rng(1), camera, (20, 0.0), 1e-6, two_views)
    bearings, valid = camera.unproject(scene.pixels)
    assert valid.all()
    assert (bearings[:, 2] < 0.0).sum() >= 10
    score = past_90.Score()
    score.add(scene, past_90.ours(scene), 0.0)
    assert score.rotation[0] < 0.01
    assert score.place[0] < 0.05


def test_opengv_gives_the_pose_of_bearings_without_noise(tmp_path):
    program = past_90.built(tmp_path)
    if isinstance(program, str):
        pytest.skip(program)
    for two_views, case in ((True, (20, 0.0)), (False, (6, 0.0))):
        scores = past_90.compare(program, case, 1e-6, two_views, 1)
        assert scores["OpenGV RANSAC"].rotation[0] < 0.01
        assert scores["OpenGV RANSAC"].place[0] < 0.05


def test_two_cameras_differ_by_nothing_but_a_rotation_if_that_is_all():
    turn = past_90.Rotation.from_rotvec([0.1, -0.2, 0.3])
    pixels = np.random.default_rng(0).uniform(50.0, 400.0, (30, 2))
    camera = preset("perspective")
    shifted = [camera.unproject(pixels + step)[0] for step in ([0.0, 0.0], [1.0, 0.0], [0.0, 1.0])]
    made = mrcal.Made(0.0, 0.0, 0, np.stack(shifted), np.zeros(30), 0.0, "")
    assert mrcal.apart(made, turn.apply(shifted[0]))[0] < 1e-9
    moved = camera.unproject(pixels + 0.3 * np.sign(pixels - 200.0))[0]
    assert 0.05 < mrcal.apart(made, turn.apply(moved))[0] < 0.4


def test_mrcal_projects_as_ours_does(monkeypatch):
    if mrcal.shutil.which(mrcal.COMMAND) is None:
        pytest.skip(f"Debian's {mrcal.PACKAGE} is not installed")
    chosen = {name: mrcal.LENSES[name] for name in ("OPENCV8", "STEREOGRAPHIC")}
    monkeypatch.setattr(mrcal, "LENSES", chosen)
    rows = [row.strip("| ").split(" | ") for row in mrcal.projection_rows()]
    assert [row[0] for row in rows] == list(chosen)
    for _, points, pixels, bearings in rows:
        assert int(points) > 800
        assert float(pixels) < 1e-9
        assert float(bearings) < 1e-9
    camera, numbers = chosen["OPENCV8"]
    monkeypatch.setattr(mrcal, "LENSES", {"OPENCV8": (camera, (numbers[0] * 1.001, *numbers[1:]))})
    assert float(next(mrcal.projection_rows()).split("|")[3]) > 0.01


def test_a_run_of_our_own_law_differs_by_nothing_and_one_of_another_does(monkeypatch, tmp_path):
    random = np.random.default_rng(1)
    points, goal = machine_vision.scene(random)
    start = machine_vision.drawn_start(points, (5, 60), random)
    law, poses, twists = servo_method("ibvs", machine_vision.GAIN), [start], []
    for _ in range(5):
        twists.append(law.step(machine_vision.measured(points, goal, poses[-1])))
        turn_first = np.concatenate((twists[-1][3:], twists[-1][:3]))
        poses.append(poses[-1] * RigidTransform.from_exp_coords(turn_first))
    run = {"law": "IBVS", "poses": [pose.as_matrix() for pose in poses], "twists": twists}
    assert machine_vision.apart(points, goal, run) < 1e-12
    assert machine_vision.apart(points, goal, {**run, "law": "PBVS"}) > 1e-2
    monkeypatch.setattr(machine_vision, "PYTHON", tmp_path / "python")
    assert "is missing" in next(machine_vision.lines())
