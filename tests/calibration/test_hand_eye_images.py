"""The whole way from pictures and a poses file to flange_T_camera, a task and a report; and bad input."""

import json
import re

import numpy as np
import pytest
import yaml
from PIL import Image
from scipy.spatial.transform import RigidTransform, Rotation
from tests.calibration.hand_eye_scenes import (
    BASE_T_BOARD,
    FISHEYE,
    FLANGE_T_CAMERA,
    error_of,
    render_views,
)
from tests.cli.valid_output import check_output
from tests.tasks.test_load_task import changed, written

from omniservo.calibration import board_from_text, find_board
from omniservo.calibration.hand_eye import (
    calibrate_hand_eye,
    calibrate_hand_eye_images,
    load_hand_eye,
    load_robot_poses,
)
from omniservo.calibration.hand_eye.robot_poses_file import RobotPoses
from omniservo.camera_files import load_camera
from omniservo.cameras import preset
from omniservo.cli.main import main
from omniservo.errors import InputError
from omniservo.files.image_files import read_grey_image
from omniservo.perception import tag_cells, tag_picture
from omniservo.reporting.hand_eye_report import hand_eye_html
from omniservo.scenes.scene import Panel
from omniservo.targets import Tag, Target
from omniservo.tasks import load_task

BOARD_TEXT = "checkerboard:9x6:0.03"


@pytest.fixture(scope="module")
def views(tmp_path_factory):
    """Six rendered pictures of the board, one without it, and the file of their poses."""
    folder = tmp_path_factory.mktemp("views")
    base_T_flange, pictures, _ = render_views(1, 6, noise=2.0)
    pictures.append(np.full_like(pictures[0], 90))
    entries = []
    for k, (pose, picture) in enumerate(zip([*base_T_flange, base_T_flange[0]], pictures, strict=True)):
        Image.fromarray(picture).save(folder / f"view-{k}.png")
        entries.append(
            {
                "image": f"view-{k}.png",
                "translation": (1e3 * pose.translation).tolist(),
                "rotation_vector": pose.rotation.as_rotvec(degrees=True).tolist(),
            }
        )
    document = {"format": "omniservo.robot_poses/1", "units": {"length": "mm", "angle": "deg"}}
    (folder / "poses.yaml").write_text(yaml.safe_dump({**document, "base_T_flange": entries[::-1]}))
    return folder


def ended(arguments, capsys):
    """Return exit code, standard output and standard error of the command."""
    with pytest.raises(SystemExit) as end:
        main(arguments)
    said = capsys.readouterr()
    return end.value.code or 0, said.out, said.err


def call(views, *more, poses="poses.yaml", images="view-?.png", board=BOARD_TEXT):
    files = sorted(str(path) for path in views.glob(images))
    return ["robot", "calibrate-hand-eye", *files, "--poses", str(views / poses), "--camera", "fe185",
            "--board", board, *more]  # fmt: skip


@pytest.mark.slow
def test_command_writes_what_a_task_reads_and_a_report(views, tmp_path, capsys):
    out, report = tmp_path / "hand-eye.json", tmp_path / "report.html"
    code, said, _ = ended(call(views, "--out", str(out), "--report", str(report), "--json"), capsys)
    assert code == 0
    fields = check_output(said)
    assert fields["status"] == "ok"
    assert [image["used"] for image in fields["images"]] == [True] * 6 + [False]
    assert "no chequered pattern" in fields["images"][6]["reason"]
    assert fields["scatter_worst_m"] < 3e-4
    found, covariance = load_hand_eye(out)
    error = error_of(found, FLANGE_T_CAMERA)
    assert np.linalg.norm(error[:3]) < 1e-4
    assert np.degrees(np.linalg.norm(error[3:])) < 0.02
    assert error @ np.linalg.solve(covariance, error) < 17.0
    task = load_task(
        written(tmp_path, changed("arm", {"foot": [0, 0, -341], "flange_T_camera": "hand-eye.json"}))
    )
    mounted = task.arm.flange_T_camera.transform
    assert np.abs(mounted.as_matrix() - found.as_matrix()).max() < 1e-12
    np.testing.assert_allclose(task.arm.mount_covariance, covariance)
    text = report.read_text()
    assert text.count("<img ") == 3
    assert all(f"view-{k}.png" in text for k in range(7))
    assert "nan" not in re.sub(r'src="[^"]*"', "", text).lower()
    assert "<script" not in text


@pytest.mark.slow
def test_command_says_in_words_what_it_found(views, capsys):
    code, said, _ = ended(call(views), capsys)
    assert code == 0
    for words in ("translation", "±", "6 of 7 images used", "view-6.png: not used", "by each view alone"):
        assert words in said


@pytest.mark.slow
def test_a_copy_of_an_image_makes_the_result_no_surer(views, tmp_path):
    """Every view twice: σ was two fifths of what it is."""
    files = sorted(views.glob("view-?.png"))[:6]
    poses = load_robot_poses(views / "poses.yaml").of_images(files)
    copies = [tmp_path / file.name for file in files]
    for file, copy in zip(files, copies, strict=True):
        copy.write_bytes(file.read_bytes())
    camera, board = preset("fe185"), board_from_text(BOARD_TEXT)
    once = calibrate_hand_eye_images(camera, poses, files, board).result
    twice = calibrate_hand_eye_images(camera, [*poses, *poses], [*files, *copies], board).result
    assert np.array_equal(twice.covariance, once.covariance)
    assert [view.reason for view in twice.views[6:]] == [f"a copy of {file}" for file in files]


def test_where_there_is_no_pose_the_command_says_why_and_writes_the_report(views, tmp_path, capsys):
    out, report = tmp_path / "hand-eye.json", tmp_path / "report.html"
    more = ("--out", str(out), "--report", str(report))
    code, _, said = ended(call(views, *more, images="view-[0126].png"), capsys)
    assert code == 1
    assert "too_few_views: 3 of 4 views can be used; at least 4 are needed" in said
    assert "in 1 of the images: no chequered pattern of 9×6 inner corners" in " ".join(said.split())
    assert [line.startswith("omniservo: ") for line in said.splitlines()][-1]
    assert said.count("omniservo: ") == 1
    assert not out.exists()
    assert "No pose: too_few_views" in report.read_text()


@pytest.mark.slow
def test_tags_of_a_target_do_as_well(tmp_path):
    tags, panels = [], []
    for number, (x, y) in enumerate([(0.0, 0.0), (0.11, 0.0), (0.0, 0.11), (0.11, 0.11)]):
        target_T_tag = RigidTransform.from_translation([x, y, 0.0])
        tags.append(Tag("tag36h11", number, 0.08, target_T_tag))
        cells = tag_picture("tag36h11", number, pixels_per_cell=1) > 0
        side = 0.08 * len(cells) / tag_cells("tag36h11")
        picture = np.where(cells, 0.85, 0.03)
        panels.append(Panel(f"tag {number}", BASE_T_BOARD * target_T_tag, np.array([side, side]), picture))
    base_T_flange, pictures, _ = render_views(2, 4, noise=2.0, panels=tuple(panels))
    files = []
    for k, picture in enumerate(pictures):
        files.append(tmp_path / f"{k}.png")
        Image.fromarray(picture).save(files[-1])
    found = calibrate_hand_eye_images(FISHEYE, base_T_flange, files, Target(tags=tuple(tags)))
    error = error_of(found.result.flange_T_camera, FLANGE_T_CAMERA)
    assert np.linalg.norm(error[:3]) < 3e-4
    assert np.degrees(np.linalg.norm(error[3:])) < 0.05
    assert "Calibrated" in hand_eye_html(found)


def test_visp_files_and_matrices_are_read(tmp_path):
    poses = [
        RigidTransform.from_components([0.1, 0.2, 0.3 + k], Rotation.from_rotvec([0.1, k, 0.2]))
        for k in range(3)
    ]
    for k, pose in enumerate(poses):
        rows = "".join(
            f"  - [{x!r}]\n" for x in [*pose.translation.tolist(), *pose.rotation.as_rotvec().tolist()]
        )
        (tmp_path / f"pose_fPe_{k + 9}.yaml").write_text(f"rows: 6\ncols: 1\ndata: \n{rows}")
    listed = {"rPe": [{"R": p.rotation.as_matrix().tolist(), "t": p.translation.tolist()} for p in poses]}
    (tmp_path / "visp.json").write_text(json.dumps(listed))
    own = {
        "format": "omniservo.robot_poses/1",
        "base_T_flange": [{"matrix": p.as_matrix().tolist()} for p in poses],
    }
    (tmp_path / "own.yaml").write_text(yaml.safe_dump(own))
    numbered = load_robot_poses(tmp_path / "pose_fPe_%d.yaml")
    images = [tmp_path / name for name in ("image-11.png", "image-9.png", "image-10.png")]
    assert numbered.numbers == (9, 10, 11)
    for found, order in (
        (numbered.of_images(images), (2, 0, 1)),
        (load_robot_poses(tmp_path / "visp.json").of_images(images), (0, 1, 2)),
        (load_robot_poses(tmp_path / "own.yaml").of_images(images), (0, 1, 2)),
    ):
        for pose, k in zip(found, order, strict=True):
            assert np.abs(pose.as_matrix() - poses[k].as_matrix()).max() < 1e-12


GOOD = {"translation": [0.1, 0.2, 0.3], "quaternion": [0.0, 0.0, 0.0, 1.0]}


@pytest.mark.parametrize(
    ("entry", "named"),
    [
        ({**GOOD, "quaternion": [0, 0, 0, 1.1]}, "base_T_flange[1]: quaternion: norm 1.1 given; legal: 1"),
        ({**GOOD, "translation": [0, float("nan"), 0]}, "base_T_flange[1]: translation: nan at index (1,)"),
        ({**GOOD, "translation": [0, 1]}, "base_T_flange[1]: translation: shape (2,) given; (3,) is needed"),
        ({**GOOD, "speed": 1}, "base_T_flange[1]: speed: no such field; legal: image, translation"),
        ({"translation": [0, 0, 0]}, "base_T_flange[1]: needed: translation with quaternion"),
        ({**GOOD, "rotation_vector": [0, 0, 0]}, "base_T_flange[1]: needed:"),
        (
            {"matrix": np.diag([1, 1, 1.1, 1]).tolist()},
            "base_T_flange[1]: matrix: R Rᵀ is off the identity by 0.21",
        ),
        (
            {"matrix": np.diag([1, 1, -1, 1]).tolist()},
            "base_T_flange[1]: matrix: a reflection; legal: a rotation",
        ),
        ({**GOOD, "image": "a.png"}, "base_T_flange[0]: image: missing"),
        ([1, 2, 3], "base_T_flange[1]: [1, 2, 3] given; a mapping"),
    ],
)
def test_wrong_poses_are_one_message_with_the_place(entry, named, tmp_path):
    file = tmp_path / "poses.yaml"
    file.write_text(json.dumps({"format": "omniservo.robot_poses/1", "base_T_flange": [GOOD, entry]}))
    with pytest.raises(InputError, match=re.escape(named)) as said:
        load_robot_poses(file)
    assert str(said.value).startswith(str(file))


def test_wrong_input_is_one_message(views, tmp_path, capsys):
    entries = [GOOD] * 3
    for name, text in (
        ("three", json.dumps({"format": "omniservo.robot_poses/1", "base_T_flange": entries})),
        ("format", json.dumps({"format": "omniservo.poses", "base_T_flange": entries})),
        ("empty", yaml.safe_dump({"format": "omniservo.robot_poses/1", "base_T_flange": []})),
        ("other", (views / "poses.yaml").read_text().replace("view-3", "picture-3")),
    ):
        (tmp_path / f"{name}.yaml").write_text(text)
    (views / "noimage.png").write_text("picture")
    small = views / "small-1.png"
    Image.fromarray(np.zeros((100, 120), dtype=np.uint8)).save(small)
    for arguments, named in (
        (call(views, poses=tmp_path / "three.yaml"), "3 poses given for 7 images"),
        (call(views, poses=tmp_path / "format.yaml"), "format: 'omniservo.poses' given; legal"),
        (call(views, poses=tmp_path / "empty.yaml"), "base_T_flange: [] given; a list of poses"),
        (call(views, poses=tmp_path / "other.yaml"), "no pose for"),
        (call(views, poses="none.yaml"), "no such file"),
        (call(views, poses="pose_%d.yaml"), "no file of this name"),
        (call(views, "--camera", "fe186"), "fe186"),
        (call(views, board="checkerboard:9x6"), "checkerboard"),
        (call(views, "--target", "x.yaml"), "--board or --target"),
        (call(views, "--out", str(views / "poses.yaml")), "exists"),
        (call(views, images="noimage.png", poses=tmp_path / "three.yaml"), "3 poses given for 1 images"),
        (
            call(views, images="[sv]*-[0123].png", poses=_named(tmp_path, views)),
            "small-1.png: image: 120×100 given",
        ),
    ):
        code, _, said = ended(arguments, capsys)
        assert code == 2, arguments
        assert named in said.splitlines()[-1]
        assert said.count("omniservo: ") == 1


def _named(tmp_path, views):
    """A poses file that names small-1.png too."""
    document = yaml.safe_load((views / "poses.yaml").read_text())
    document["base_T_flange"].append({**document["base_T_flange"][0], "image": "small-1.png"})
    (tmp_path / "named.yaml").write_text(json.dumps(document))
    return tmp_path / "named.yaml"


@pytest.mark.parametrize(
    ("field", "value", "named"),
    [
        (
            "format",
            "omniservo.hand_eye/9",
            "format: 'omniservo.hand_eye/9' given; legal: 'omniservo.hand_eye/1'",
        ),
        ("flange_T_camera", [0, 0, 0], "flange_T_camera: [0, 0, 0] given; legal: a mapping"),
        ("covariance", np.diag([1.0, 1, 1, 1, 1, -1]).tolist(), "covariance: not symmetric and positive"),
        ("covariance", [[1.0]], "covariance: shape (1, 1) given"),
    ],
)
def test_a_changed_hand_eye_file_is_refused(field, value, named, tmp_path):
    document = {"format": "omniservo.hand_eye/1", "flange_T_camera": GOOD, "covariance": np.eye(6).tolist()}
    (tmp_path / "hand-eye.json").write_text(json.dumps({**document, field: value}))
    with pytest.raises(InputError, match=re.escape(named)):
        load_hand_eye(tmp_path / "hand-eye.json")


def test_files_and_names_of_before_say_tool_for_the_flange(tmp_path):
    poses, file = tmp_path / "poses.json", tmp_path / "hand-eye.json"
    poses.write_text(json.dumps({"format": "omniservo.robot_poses/1", "base_T_tool": [GOOD]}))
    found = load_robot_poses(poses)
    np.testing.assert_allclose(found.base_T_flange[0].translation, GOOD["translation"])
    with pytest.warns(DeprecationWarning, match="base_T_tool is called base_T_flange now"):
        assert found.base_T_tool is found.base_T_flange
    mount = {"format": "omniservo.hand_eye/1", "tool_T_camera": GOOD, "covariance": np.eye(6).tolist()}
    file.write_text(json.dumps(mount))
    np.testing.assert_allclose(load_hand_eye(file)[0].translation, GOOD["translation"])
    file.write_text(json.dumps({**mount, "tool_T_camera": [0]}))
    with pytest.raises(InputError, match="tool_T_camera: .* a mapping"):
        load_hand_eye(file)
    poses.write_text(
        json.dumps({"format": "omniservo.robot_poses/1", "base_T_tool": [GOOD], "base_T_flange": [GOOD]})
    )
    with pytest.raises(InputError, match="base_T_flange: no such field"):
        load_robot_poses(poses)


@pytest.mark.slow
def test_the_real_arm_s_views_agree_as_far_as_its_poses_do(shared_data):
    """A Franka's eight: what is left is the robot's, and by its lengths the board is larger than stated."""
    folder = shared_data / "visp_franka_eye_in_hand"
    images = sorted(folder.glob("franka_image-*.png"))
    base_T_flange = load_robot_poses(folder / "franka_pose_rPe_%d.yaml").of_images(images)
    camera = load_camera(folder / "franka_camera.xml")
    board = board_from_text("checkerboard:9x6:0.0236")
    views = [find_board(read_grey_image(path), board, camera) for path in images]
    pixels, points = [view.pixels for view in views], [view.object_points for view in views]
    stated = calibrate_hand_eye(camera, base_T_flange, pixels, points)
    assert stated.used == tuple(range(8))
    assert stated.scatter_worst[0] < 7e-3
    assert np.degrees(stated.scatter_worst[1]) < 0.8
    assert stated.board_size_disputed
    sized = calibrate_hand_eye(camera, base_T_flange, pixels, [stated.board_scale * p for p in points])
    assert not sized.board_size_disputed
    assert sized.scatter_worst[0] < 4.5e-3
    assert sized.robot_position_m < 0.35 * stated.robot_position_m


TABLE = """image,x,y,z,qx,qy,qz,qw
b.png, 0.1, 0.2, 0.3, 0, 0, 0.6, 0.8

a.png, 0.4, 0.5, 0.6, 1, 0, 0, 0
"""


def test_poses_are_read_from_a_table(tmp_path):
    file = tmp_path / "poses.csv"
    file.write_text(TABLE)
    first, second = load_robot_poses(file).of_images([tmp_path / "a.png", tmp_path / "b.png"])
    np.testing.assert_allclose(first.translation, [0.4, 0.5, 0.6])
    np.testing.assert_allclose(second.translation, [0.1, 0.2, 0.3])
    np.testing.assert_allclose(first.rotation.as_quat(), [1, 0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(second.rotation.as_quat(), [0, 0, 0.6, 0.8], atol=1e-12)
    file.write_text("z,x,y,rx,ry,rz\n3,1,2,0.1,0.2,0.3\n")
    (only,) = load_robot_poses(file).of_images([tmp_path / "any.png"])
    np.testing.assert_allclose(only.translation, [1, 2, 3])
    np.testing.assert_allclose(only.rotation.as_rotvec(), [0.1, 0.2, 0.3])


def test_blanks_may_stand_between_and_any_name_will_do(tmp_path):
    file = tmp_path / "robot.txt"
    file.write_text("x y z rx ry rz\n1 2  3 0.1\t0.2 0.3\n\n4 5 6 0 0 0\n")
    first, second = load_robot_poses(file).of_images([tmp_path / "1.png", tmp_path / "2.png"])
    np.testing.assert_allclose(first.translation, [1, 2, 3])
    np.testing.assert_allclose(first.rotation.as_rotvec(), [0.1, 0.2, 0.3])
    np.testing.assert_allclose(second.translation, [4, 5, 6])


@pytest.mark.parametrize(
    "text",
    [
        "# flange\n# timestamp tx ty tz qx qy qz qw\n1305031098.6659 0.1 0.2 0.3 0 0 0.6 0.8\n",
        "#timestamp tx ty tz qx qy qz qw\n1305031098.6659 0.1 0.2 0.3 0 0 0.6 0.8\n",
        "Time,x,y,z,qw,qx,qy,qz,\n1305031098.6659,0.1,0.2,0.3,0.8,0,0,0.6,\n",
    ],
)
def test_times_of_a_trajectory_are_not_used_and_its_header_may_be_a_comment(tmp_path, text):
    file = tmp_path / "trajectory.txt"
    file.write_text(text)
    (pose,) = load_robot_poses(file).base_T_flange
    np.testing.assert_allclose(pose.translation, [0.1, 0.2, 0.3])
    np.testing.assert_allclose(pose.rotation.as_quat(), [0, 0, 0.6, 0.8], atol=1e-12)
    file.write_text(text.replace("0.6", "0.7"))
    line = 1 + text.splitlines().index(text.splitlines()[-1])
    with pytest.raises(InputError, match=f"line {line}: quaternion: norm 1.063 given"):
        load_robot_poses(file)


def test_images_sorted_by_letters_are_refused_where_only_their_order_says_whose_the_poses_are(tmp_path):
    file = tmp_path / "poses.csv"
    lines = [f"{k},0,0,0,0,0" for k in range(1, 12)]
    file.write_text("\n".join(["x,y,z,rx,ry,rz", *lines]))
    by_number = [tmp_path / f"view-{k}.png" for k in range(1, 12)]
    poses = load_robot_poses(file)
    assert [pose.translation[0] for pose in poses.of_images(by_number)] == list(range(1, 12))
    with pytest.raises(InputError, match=r"sorted by letters: view-1\.png, view-10\.png, view-11\.png, …"):
        poses.of_images(sorted(by_number))
    assert poses.of_images(by_number[::-1])[0].translation[0] == 1  # an order that someone chose
    named = [tmp_path / name for name in ("a-2.png", "b-10.png", "b-9.png")]
    assert len(RobotPoses("given", poses.base_T_flange[:3]).of_images(named)) == 3
    file.write_text("\n".join(["image,x,y,z,rx,ry,rz", *(f"view-{k + 1}.png,{lines[k]}" for k in range(11))]))
    found = load_robot_poses(file).of_images(sorted(by_number))
    assert [pose.translation[0] for pose in found[:3]] == [1, 10, 11]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("0.1 0.2 0.3 0 0 0\n", "line 1: numbers without a header; write above them what they are: x,y,z"),
        ("0.1, 0.2, 0.3, 0, 0, 0, 1\n", "line 1: numbers without a header"),
        ("# t x y z\n0.1 0.2 0.3 0 0 0 1\n", "line 1: 't,x,y,z' given; legal: a header of x,y,z"),
        ("", "line 1: '' given; legal: a header of x,y,z with qx,qy,qz,qw or rx,ry,rz"),
        ("x,y,z\n1,2,3\n", "line 1: 'x,y,z' given"),
        ("x,x,y,z,rx,ry,rz\n1,1,2,3,0,0,0\n", "line 1: 'x,x,y,z,rx,ry,rz' given"),
        ("x,y,z,rx,ry,rz\n", "no poses below the header"),
        ("x,y,z,rx,ry,rz\n1,2,3,0,0\n", "line 2: 5 entries; the header has 6"),
        (
            "x,y,z,rx,ry,rz\n1,2,3,0,0,0\n1,two,3,0,0,0\n",
            "line 3: translation: '1,two,3' given; legal: numbers",
        ),
        ("x,y,z,rx,ry,rz\n1,2,3,0,nan,0\n", "line 2: rotation_vector: .*finite"),
        ("x,y,z,rx,ry,rz\n335,-32,308,0,0,0\n", r"line 2: translation: 456.2 m from the base .*length: mm"),
        (
            "x,y,z,rx,ry,rz\n0.3,0,0.3,-178,15,0\n",
            r"line 2: rotation_vector: a turn by 178.6 rad .*angle: deg",
        ),
        ("x,y,z,qx,qy,qz,qw\n1,2,3,0,0,0,2\n", "line 2: quaternion: norm 2 given"),
        (TABLE + "a.png,1,2,3,0,0,0,1\n", "line 5: image: 'a.png': given twice"),
        (TABLE + ",1,2,3,0,0,0,1\n", "line 5: image: '': a file's name is needed"),
    ],
)
def test_a_bad_table_of_poses_is_one_message(tmp_path, text, message):
    file = tmp_path / "poses.csv"
    file.write_text(text)
    with pytest.raises(InputError, match=message) as raised:
        load_robot_poses(file)
    assert str(file) in str(raised.value)
