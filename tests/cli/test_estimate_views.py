"""``omniservo estimate IMAGE IMAGE IMAGE …``: rendered images of a fisheye, in any order."""

import json
import shutil

import cv2
import jsonschema
import numpy as np
import pytest
from benchmarks.pictured_scenes import Face, crate, motion, picture_of
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import preset
from omniservo.errors import InputError
from omniservo.perception import DotKind, tag_cells, tag_picture
from omniservo.perception.feature_kind import MatchedPoints
from omniservo.perception.join_images import join_images
from omniservo.runs import ImageScale, estimate_many_images
from omniservo.schemas import json_schema

from .calling import call

CAMERA = preset("fe185")
POSES = [RigidTransform.identity()] + [motion(np.random.default_rng(k), 0.1, 0.15) for k in (1, 2, 3)]
ORDER = (2, 0, 3, 1)
EDGE = 0.12
NATURAL = ("--camera", "fe185", "--features", "natural")
TAGS = ("--camera", "fe185", "--features", "tags", "--dictionary", "tag36h11")


def length(a, b):
    return float(np.linalg.norm(POSES[a].translation - POSES[b].translation))


def written(folder, faces, rays):
    rng, files = np.random.default_rng(0), []
    for number, pose in enumerate(POSES):
        files.append(folder / f"image-{number}.png")
        cv2.imwrite(str(files[-1]), picture_of(faces, CAMERA, pose, rng, rays=rays))
    return [files[k] for k in ORDER]


@pytest.fixture(scope="module")
def crates(tmp_path_factory):
    return written(tmp_path_factory.mktemp("crates"), crate(np.random.default_rng(3)), 2)


@pytest.fixture(scope="module")
def tags(tmp_path_factory):
    side = 0.5 * EDGE * (1.0 + 2.0 / tag_cells("tag36h11"))
    faces = []
    for number, depth in enumerate((0.5, 0.62, 0.55, 0.7, 0.58, 0.5)):
        centre = np.array([0.17 * (number % 3 - 1), 0.18 * (number // 3 - 0.5), depth])
        picture = np.where(tag_picture("tag36h11", number, pixels_per_cell=1) > 0, 0.9, 0.03)
        pose = RigidTransform.from_translation(centre)
        faces.append(Face(pose, np.array([side, side]), np.kron(picture, np.ones((32, 32)))))
    return written(tmp_path_factory.mktemp("tags"), faces, 3)


def true_poses():
    return [POSES[ORDER[0]].inv() * POSES[k] for k in ORDER]


def squares(poses, covariances):
    """Squared errors of the motions in their covariances, 6 numbers each: 0.1% exceed 22.5."""
    listed = []
    for pose, true, spread in zip(poses, true_poses(), covariances, strict=True):
        if np.any(spread):
            turn = (true.rotation.inv() * pose.rotation).as_rotvec()
            off = np.concatenate((pose.translation - true.translation, turn))
            listed.append(off @ np.linalg.pinv(spread, rcond=1e-12) @ off)
    return listed


@pytest.mark.slow
def test_the_command_gives_every_motion_in_any_order_within_its_stated_error_and_what_one_more_would_gain(
    capsys, crates, tags
):
    known = length(ORDER[0], ORDER[-1])
    code, out, _ = call(capsys, "estimate", *NATURAL, "--displacement", known, "--json", *crates)
    assert code == 0
    answer = json.loads(out)
    jsonschema.validate(answer, json_schema("views"))
    assert answer["status"] == "ok"
    assert [image["status"] for image in answer["images"]] == ["ok"] * 4
    found = [
        RigidTransform.from_components(
            image["pose"]["translation"], Rotation.from_quat(image["pose"]["quaternion"])
        )
        for image in answer["images"]
    ]
    for pose, true in zip(found, true_poses(), strict=True):
        assert np.linalg.norm(pose.translation - true.translation) < 1e-3
        assert np.degrees((pose.rotation.inv() * true.rotation).magnitude()) < 0.1
    assert max(squares(found, [image["covariance"] for image in answer["images"]])) < 23.0
    assert answer["further"][0]["position_sigma"][1] < answer["further"][0]["position_sigma"][0]
    code, out, _ = call(capsys, "estimate", *TAGS, *tags[:3])
    assert "3 of 3 images joined" in out
    assert "no scale was given" in out
    assert "one more image from" in out


@pytest.mark.slow
def test_an_image_of_something_else_is_named_and_the_others_are_joined(tmp_path, capsys, crates):
    other = tmp_path / "other.png"
    faces = crate(np.random.default_rng(77))
    cv2.imwrite(str(other), picture_of(faces, CAMERA, POSES[1], np.random.default_rng(5)))
    code, out, _ = call(capsys, "estimate", *NATURAL, "--json", other, *crates[:3])
    answer = json.loads(out)
    assert code == 0
    assert answer["images"][0]["status"] in ("not_matched", "too_few_points", "no_pose")
    assert answer["images"][0]["reason"]
    assert [image["status"] for image in answer["images"][1:]] == ["ok"] * 3
    assert answer["frame"] == str(crates[0])


@pytest.mark.slow
@pytest.mark.parametrize("given", ["edge", "length", "target"])
def test_tags_give_the_scale_by_their_size_by_a_length_and_by_a_target(tmp_path, tags, given):
    scale = ImageScale(edge=EDGE) if given == "edge" else ImageScale(length=(0, 1, EDGE))
    dictionary = "tag36h11"
    if given == "target":
        file = tmp_path / "target.yaml"
        tag = {"dictionary": "tag36h11", "id": 0, "edge": EDGE, "translation": [0.0, 0.0, 0.0]}
        fields = {"format": "omniservo.target/1", "points": [], "tags": [{**tag, "quaternion": [0, 0, 0, 1]}]}
        file.write_text(json.dumps(fields))
        scale = ImageScale(target=file)
    found = estimate_many_images(CAMERA, tags, features="tags", dictionary=dictionary, scale=scale).estimate
    assert found.status == "ok", found.message
    assert found.is_metric
    assert max(squares(found.initial_T_views, found.covariance)) < 23.0
    assert found.size_sigma < 0.01


@pytest.mark.slow
def test_several_tags_of_one_size_tell_the_scale_better_than_one(tags):
    options = {"features": "tags", "dictionary": "tag36h11"}
    one = estimate_many_images(CAMERA, tags, **options, scale=ImageScale(length=(0, 1, EDGE)))
    all_of_them = estimate_many_images(CAMERA, tags, **options, scale=ImageScale(edge=EDGE))
    assert all_of_them.estimate.size_sigma < 0.5 * one.estimate.size_sigma


@pytest.mark.slow
def test_the_poses_of_an_arm_give_the_scale(tmp_path, capsys, tags):
    rng = np.random.default_rng(8)
    mount = RigidTransform.from_components([0.03, 0.0, 0.08], Rotation.from_rotvec([0.0, 0.0, 0.3]))
    entries = []
    for file, k in zip(tags, ORDER, strict=True):
        flange = POSES[k] * mount.inv()
        place = flange.translation + 2e-4 * rng.normal(size=3)
        turn = flange.rotation.as_quat().tolist()
        entries.append({"image": file.name, "translation": place.tolist(), "quaternion": turn})
    poses = tmp_path / "poses.json"
    poses.write_text(json.dumps({"format": "omniservo.robot_poses/1", "base_T_flange": entries}))
    fields = {
        "format": "omniservo.hand_eye/1",
        "flange_T_camera": {
            "translation": mount.translation.tolist(),
            "quaternion": mount.rotation.as_quat().tolist(),
        },
        "covariance": (np.diag([1e-4] * 3 + [5e-4] * 3) ** 2).tolist(),
        "robot_position_m": 2e-4,
        "robot_rotation_rad": 3e-4,
    }
    file = tmp_path / "mount.json"
    file.write_text(json.dumps(fields))
    scale = ImageScale(poses=str(poses), mount=file)
    tagged = {"features": "tags", "dictionary": "tag36h11"}
    found = estimate_many_images(CAMERA, tags, **tagged, scale=scale).estimate
    assert found.status == "ok", found.message
    assert max(squares(found.initial_T_views, found.covariance)) < 23.0
    assert found.size_sigma < 0.01
    out = tmp_path / "estimate.json"
    code, _, _ = call(capsys, "estimate", *TAGS, *tags[:3], "--poses", poses, "--mount", file, "--out", out)
    assert code == 0
    assert json.loads(out.read_text())["is_metric"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((*NATURAL, "--planar"), "for two images"),
        (("--features", "natural"), "camera: missing"),
        ((*NATURAL, "--length", "0:1"), "length: '0:1' given; legal: I:J:METRES"),
        ((*NATURAL, "--length", "0:1:0.1", "--displacement", "0.1"), "displacement, length: all given"),
        ((*NATURAL, "--tag-edge", "0.1"), "edge: given with features: 'natural'"),
        ((*NATURAL, "--poses", "poses.csv"), "mount: missing"),
        ((*TAGS, "--target", "none.yaml"), "none.yaml"),
    ],
)
def test_wrong_calls_are_named(capsys, crates, arguments, message):
    code, _, err = call(capsys, "estimate", *arguments, *crates)
    assert code == 2
    assert message in err.replace("\n", " ")


def test_a_length_between_points_that_are_not_there_is_named(tags):
    scale = ImageScale(length=(0, 400, 0.1))
    with pytest.raises(InputError, match="length: point 400 given; in the first image and another are 0, 1"):
        estimate_many_images(CAMERA, tags, features="tags", dictionary="tag36h11", scale=scale)


@pytest.mark.parametrize("place", [0, 3])
def test_no_motion_is_written_where_the_first_or_the_last_image_is_not_joined(tmp_path, capsys, tags, place):
    """A file without a pose was written, and the command ended with 0."""
    blank, out = tmp_path / "blank.png", tmp_path / "estimate.json"
    cv2.imwrite(str(blank), np.full((CAMERA.height, CAMERA.width), 128, dtype=np.uint8))
    images = [*tags[:3]]
    images.insert(place, blank)
    code, _, err = call(capsys, "estimate", *TAGS, "--tag-edge", EDGE, "--out", out, *images)
    assert code == 1
    assert f"{out} is not written: {blank} has no pose: not_matched: 0 tags found" in err.replace("\n", " ")
    assert not out.exists()


@pytest.mark.slow
def test_identical_images_hold_no_motion(tmp_path, capsys, crates):
    files = [tmp_path / f"{k}.png" for k in range(3)]
    for file in files:
        shutil.copy(crates[0], file)
    code, out, err = call(capsys, "estimate", *NATURAL, *files)
    assert code == 1
    assert "no_motion" in err + out


def test_two_images_as_arguments_are_the_initial_and_the_goal(capsys, tags):
    one = call(capsys, "estimate", *TAGS, *tags[:2], "--json")
    other = call(capsys, "estimate", *TAGS, "--initial", tags[0], "--goal", tags[1], "--json")
    first, second = json.loads(one[1]), json.loads(other[1])
    assert first["status"] == "ok"
    assert first["goal"] == second["goal"]


class Chained(DotKind):
    """Three points, each seen in two neighbouring images."""

    places = np.array([[100.0, 100.0], [200.0, 120.0], [300.0, 200.0]])

    def match(self, camera, initial, goal):
        a, b = int(initial[0, 0]), int(goal[0, 0])
        if abs(a - b) > 1:
            raise InputError("too far apart")
        return MatchedPoints(self.places + a, self.places + b)


def test_points_at_the_same_place_of_an_image_are_chained_over_images_that_share_no_match():
    images = [np.full((CAMERA.height, CAMERA.width), k, dtype=np.uint8) for k in range(4)]
    joined = join_images(CAMERA, images, Chained())
    assert len(joined) == 3
    assert joined.visible.all()
    np.testing.assert_allclose(joined.pixels[3] - joined.pixels[0], 3.0)
