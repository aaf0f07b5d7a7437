"""A camera that watches a scene: moved or not, whatever else has changed."""

import itertools
import json

import cv2
import numpy as np
import pytest
from benchmarks.camera_check import LENSES, WALLS, boards, bump, face, other_light, pair
from benchmarks.pictured_scenes import OTHER_LENS, picture_of
from benchmarks.real_coverage import RealSet
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.stats import chi2
from tests.cli.calling import call

from omniservo.calibration import check_camera
from omniservo.calibration.camera_check import _jacobian, _moved_pixels
from omniservo.camera_files import save_camera
from omniservo.cameras import preset
from omniservo.errors import InputError

STILL = RigidTransform.identity()
WIDE, NARROW = LENSES


@pytest.mark.slow
@pytest.mark.parametrize("name", LENSES)
def test_other_light_and_other_things_in_the_scene_are_no_motion_of_the_camera(name):
    found = pair(*LENSES[name], 0.0, 7).found
    assert found.moved is False
    assert found.displacement_px < 0.1
    assert found.probability > 0.01


@pytest.mark.slow
@pytest.mark.parametrize(("name", "size"), [(WIDE, 1.0), (NARROW, 40.0)])
def test_a_bump_is_noticed_and_its_rotation_lies_in_the_ellipsoid_that_is_stated(name, size):
    seen = pair(*LENSES[name], size, 8)
    found = seen.found
    assert found.moved is True
    off = (Rotation.from_rotvec(found.rotation).inv() * seen.was_T_now.rotation).as_rotvec()
    assert off @ np.linalg.solve(found.covariance[:3, :3], off) < chi2.ppf(0.999, 3)
    turn = np.linalg.norm(seen.was_T_now.rotation.as_rotvec())
    assert abs(found.angle - turn) < max(0.2 * turn, 4.0 * found.sigma)


@pytest.fixture(scope="module")
def room():
    """Two images of a room from one place, and one from a little aside."""
    rng = np.random.default_rng(3)
    walls = [face(rng, np.array(centre), np.array(turn), half) for centre, turn, half in WALLS]
    scene = walls + boards(rng, 2)
    moved = bump(OTHER_LENS, 5.0, np.random.default_rng(4))
    return [picture_of(scene, OTHER_LENS, pose, rng) for pose in (STILL, STILL, moved)]


@pytest.mark.slow
def test_what_moves_in_the_scene_is_not_the_camera(room):
    was, still, moved = room
    now = still.copy()
    now[:, :100] = moved[:, :100]
    found = check_camera(OTHER_LENS, was, now)
    assert found.moved is False
    assert found.displacement_px < 0.1


def test_a_camera_that_is_displaced_and_not_turned_moved(room):
    was, ahead = room[0], 0.03
    v, u = np.mgrid[: OTHER_LENS.height, : OTHER_LENS.width].astype(float)
    now_sees = OTHER_LENS.unproject(np.stack((u.ravel(), v.ravel()), axis=1))[0]
    # all of the scene is at distance 1: |s b + ahead| = 1
    along = ahead * now_sees[:, 2]
    distance = np.sqrt(along**2 + 1.0 - ahead**2) - along
    places = OTHER_LENS.project(distance[:, None] * now_sees + [0.0, 0.0, ahead])[0]
    places = places.reshape(*was.shape, 2).astype(np.float32)
    now = cv2.remap(was, places[..., 0], places[..., 1], cv2.INTER_CUBIC)
    found = check_camera(OTHER_LENS, was, now)
    assert found.moved is True
    off = np.concatenate((found.rotation, found.translation - [0.0, 0.0, ahead]))
    assert off @ np.linalg.solve(found.covariance, off) < chi2.ppf(0.999, 6)


def test_where_half_of_the_image_stands_still_and_half_moves_nothing_is_said(room):
    was, still, moved = room
    now = still.copy()
    now[:, :160] = moved[:, :160]
    found = check_camera(OTHER_LENS, was, now)
    assert found.moved is None
    assert "two motions" in found.reason
    assert found.to_dict()["rotation_rad"] is None


def test_images_that_show_nothing_in_common_say_nothing_of_the_camera(room):
    rng = np.random.default_rng(9)
    other = [face(rng, np.array([0.0, 0.0, 1.0]), np.zeros(3), 1.4)]
    assert check_camera(OTHER_LENS, room[0], picture_of(other, OTHER_LENS, STILL, rng)).moved is None
    grey = np.full((240, 320), 90, dtype=np.uint8)
    found = check_camera(OTHER_LENS, grey, room[0])
    assert (found.moved, found.features) == (None, 0)
    assert "0 features" in found.reason


@pytest.fixture(scope="module")
def photographs(shared_data):
    """A calibrated fisheye and three of its photographs of a room."""
    data = RealSet.read("fisheye2")
    return data.calibrated().camera, list(data.images.values())[:3]


@pytest.mark.slow
def test_photographs_under_other_light_and_with_another_third_are_not_moved_and_turned_ones_are(photographs):
    camera, images = photographs
    was, _, other = images
    v, u = np.mgrid[: camera.height, : camera.width].astype(float)
    bearings, valid = camera.unproject(np.stack((u, v), axis=-1))
    turn = Rotation.from_rotvec([0.003, -0.004, 0.002])
    seen = camera.project(turn.apply(np.where(valid[..., None], bearings, 1.0).reshape(-1, 3)))[0]
    places = seen.reshape(*was.shape, 2).astype(np.float32)
    turned = cv2.remap(was, places[..., 0], places[..., 1], cv2.INTER_CUBIC)
    for image, moved, motion in ((was, False, Rotation.identity()), (turned, True, turn)):
        now = other_light(image, np.random.default_rng(1))
        now[:, : camera.width // 3] = other[:, : camera.width // 3]
        found = check_camera(camera, was, now)
        assert found.moved is moved
        off = (Rotation.from_rotvec(found.rotation).inv() * motion).as_rotvec()
        assert off @ np.linalg.solve(found.covariance[:3, :3], off) < chi2.ppf(0.999, 3)


@pytest.mark.slow
def test_photographs_from_places_apart_are_never_said_to_stand_still(photographs):
    camera, images = photographs
    for one, other in itertools.combinations(images, 2):
        assert check_camera(camera, one, other).moved is not False


def test_the_derivative_is_that_of_points_at_distance_one_seen_from_where_the_camera_is():
    bearings = np.array([[0.1, -0.2, 1.0], [-0.3, 0.1, 1.0], [0.0, 0.0, 1.0]])
    bearings /= np.linalg.norm(bearings, axis=1, keepdims=True)
    at = _moved_pixels(OTHER_LENS, bearings, np.zeros(6))
    np.testing.assert_allclose(at, OTHER_LENS.project(bearings)[0])
    jacobian = _jacobian(OTHER_LENS, bearings, np.zeros(6))
    # a point on the axis: turning about y moves it along −x, moving along x too
    f = OTHER_LENS.fx
    np.testing.assert_allclose(jacobian[2, :, 1], [-f, 0.0], atol=1e-3)
    np.testing.assert_allclose(jacobian[2, :, 3], [-f, 0.0], atol=1e-3)


@pytest.mark.slow
def test_the_command_exits_with_1_where_the_camera_moved_and_prints_what_scripts_read(room, tmp_path, capsys):
    camera = tmp_path / "camera.yaml"
    save_camera(OTHER_LENS, camera, "own")
    files = []
    for number, image in enumerate(room):
        files.append(str(tmp_path / f"{number}.png"))
        cv2.imwrite(files[-1], other_light(image, np.random.default_rng(number)) if number else image)
    still = call(capsys, "camera", "check", files[0], files[1], "--camera", camera, "--json")
    moved = call(capsys, "camera", "check", files[0], files[2], "--camera", camera, "--json")
    assert (still[0], moved[0]) == (0, 1)
    said = [json.loads(out) for _, out, _ in (still, moved)]
    assert [s["moved"] for s in said] == [False, True]
    assert {"rotation_rad", "direction", "sigma", "false_alarm_rate"} <= set(said[0])
    assert np.linalg.norm(said[1]["direction"]) == pytest.approx(1.0)
    assert "the camera moved" in moved[2]


def test_an_image_of_another_size_is_refused(room):
    with pytest.raises(InputError, match="240"):
        check_camera(OTHER_LENS, room[0], room[0][:100])


def test_the_command_names_the_image_that_has_another_size(tmp_path, capsys):
    width, height = preset("fe185").width, preset("fe185").height
    cv2.imwrite(str(tmp_path / "ours.png"), np.zeros((height, width), np.uint8))
    other = tmp_path / "other.png"
    cv2.imwrite(str(other), np.zeros((60, 80), np.uint8))
    ours = tmp_path / "ours.png"
    code, _, err = call(capsys, "camera", "check", ours, other, "--camera", "fe185", "--quiet")
    assert (code, err) == (2, f"omniservo: {other}: 80×60 px; the camera has {width}×{height}\n")
