"""Hand-eye calibration with cameras of any model: drawn corners, and rendered boards by command."""

import json

import numpy as np
import pytest
import yaml
from benchmarks.lens_conversions import PUBLISHED
from benchmarks.pictured_scenes import Face, picture_of
from PIL import Image
from scipy.spatial.transform import RigidTransform
from scipy.stats import chi2
from tests.calibration.hand_eye_scenes import (
    BASE_T_BOARD,
    BOARD,
    FLANGE_T_CAMERA,
    draw_camera,
    draw_views,
    error_of,
)

from omniservo.calibration.hand_eye import calibrate_hand_eye
from omniservo.camera_files import save_camera
from omniservo.cameras.conversion import to_unified
from omniservo.cli.main import main

T265 = PUBLISHED["RealSense T265, fisheye"]


def calibrated(camera, drawn):
    return calibrate_hand_eye(
        camera, base_T_flange=drawn.base_T_flange, image_points=drawn.pixels, object_points=drawn.points
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", PUBLISHED)
def test_exact_corners_give_the_exact_poses(name):
    lens = PUBLISHED[name]
    drawn = draw_views(np.random.default_rng(2), lens, 6, px=0.0)
    found = calibrated(lens, drawn)
    assert np.abs(error_of(found.flange_T_camera, FLANGE_T_CAMERA)).max() < 1e-6
    assert np.abs(error_of(found.base_T_board, BASE_T_BOARD)).max() < 1e-6


@pytest.mark.parametrize("name", PUBLISHED)
def test_both_poses_lie_within_the_stated_uncertainty(name):
    lens = PUBLISHED[name]
    drawn = draw_views(np.random.default_rng(1), lens, 12, position=5e-4, rotation=np.radians(0.1))
    found = calibrated(lens, drawn)
    for pose, true, covariance in (
        (found.flange_T_camera, FLANGE_T_CAMERA, found.covariance),
        (found.base_T_board, BASE_T_BOARD, found.board_covariance),
    ):
        error = error_of(pose, true)
        assert error @ np.linalg.solve(covariance, error) < chi2.ppf(0.999, 6)


def test_the_nearest_unified_camera_would_not_have_given_them():
    drawn = draw_views(np.random.default_rng(2), T265, 6, px=0.0)
    found = calibrated(to_unified(T265).camera, drawn)
    assert np.abs(error_of(found.flange_T_camera, FLANGE_T_CAMERA)).max() > 1e-4


@pytest.mark.slow
def test_rendered_boards_and_a_file_of_that_model_give_the_mount_by_command(tmp_path, capsys):
    """Six pictures of a chequered board through a T265's own lens, and its Kalibr file."""
    save_camera(T265, tmp_path / "camchain.yaml", "kalibr")
    rng, square = np.random.default_rng(5), BOARD.square
    cells = (np.indices((BOARD.rows + 3, BOARD.columns + 3)).sum(axis=0) % 2).astype(float)
    cells[[0, -1]] = cells[:, [0, -1]] = 1.0
    half = 0.5 * square * np.array([BOARD.columns + 3, BOARD.rows + 3])
    printed = np.kron(0.05 + 0.8 * cells, np.ones((24, 24)))
    middle = RigidTransform.from_translation(BOARD.points.mean(axis=0))
    entries, images = [], []
    for k in range(6):
        base_T_camera = draw_camera(rng, cone=30.0, distance=(0.3, 0.45))
        face = Face(base_T_camera.inv() * BASE_T_BOARD * middle, half, printed)
        picture = picture_of([face], T265, RigidTransform.identity(), rng, rays=1)
        images.append(str(tmp_path / f"view-{k}.png"))
        Image.fromarray(picture).save(images[-1])
        pose = base_T_camera * FLANGE_T_CAMERA.inv()
        turn = pose.rotation.as_rotvec().tolist()
        entries.append(
            {"image": f"view-{k}.png", "translation": pose.translation.tolist(), "rotation_vector": turn}
        )
    poses = tmp_path / "poses.yaml"
    poses.write_text(yaml.safe_dump({"format": "omniservo.robot_poses/1", "base_T_flange": entries}))
    options = ["--camera", str(tmp_path / "camchain.yaml"), "--board", "checkerboard:9x6:0.03", "--json"]
    with pytest.raises(SystemExit) as end:
        main(["robot", "calibrate-hand-eye", *images, "--poses", str(poses), *options])
    assert not end.value.code
    answer = json.loads(capsys.readouterr().out)
    found = RigidTransform.from_components(answer["flange_T_camera"]["translation"], FLANGE_T_CAMERA.rotation)
    assert np.abs(error_of(found, FLANGE_T_CAMERA)).max() < 5e-4
