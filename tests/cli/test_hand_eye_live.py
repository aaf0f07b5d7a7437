"""`robot calibrate-hand-eye --on`: views taken live, joints read with each, calibrate as files do."""

import json
import signal
from dataclasses import replace

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation
from tests.calibration.hand_eye_scenes import FLANGE_T_CAMERA, error_of, render_views
from tests.hardware.wall_clock_arm import WallClockArm

from omniservo.calibration import board_from_text
from omniservo.calibration.boards import BoardView
from omniservo.calibration.hand_eye import load_hand_eye
from omniservo.calibration.hand_eye.pose_choice import PoseChoice
from omniservo.cameras import preset
from omniservo.cli.main import main
from omniservo.hardware.rtde import UR_JOINTS
from omniservo.hardware.rtde.server import UrStandIn
from omniservo.robots import Arm, CameraImage, RobotState
from omniservo.runs.open_hardware import listen_to_arm
from omniservo.runs.watch_camera import ArmViewsOfBoard, watch_camera
from omniservo.tasks import load_robot

BOARD = "checkerboard:9x6:0.03"


@pytest.fixture(scope="module")
def views():
    """Six images of the board from the RX60, with the joints (6,) at each."""
    poses, images, _ = render_views(1, 6, noise=2.0)
    near = np.radians([0.0, 45.0, 60.0, 0.0, 75.0, 0.0])
    return [(image, Arm.rx60().inverse_near(pose, near)) for pose, image in zip(poses, images, strict=True)]


class Guided:
    """An arm and its camera, one view further at each image, until somebody presses Ctrl-C."""

    def __init__(self, *views, end=lambda: None, late=0.0):
        self.views, self.shown, self._end, self._late = views, 0, end, late

    def image(self):
        if self.shown == len(self.views):
            self._end()
        else:
            self.shown += 1
        return CameraImage(float(self.shown), self.views[self.shown - 1][0])

    def read(self):
        return RobotState(self.shown - self._late, self.views[self.shown - 1][1], np.zeros(6))

    def close(self):
        pass


def watched(*views, **options):
    ended = []
    guided = Guided(*views, end=lambda: ended.append(True), **options)
    choice = ArmViewsOfBoard(guided, preset("fe185"), board_from_text(BOARD))
    return watch_camera(guided, choice, stopped=lambda: bool(ended)), choice


@pytest.mark.slow
def test_each_view_is_kept_once_with_the_joints_that_were_read(views):
    watch, choice = watched(*(view for view in views for _ in range(3)))
    assert len(watch.images) == len(choice.poses.joints) == len(views)
    for (image, joints), kept, read in zip(views, watch.images, choice.poses.joints, strict=True):
        assert np.array_equal(kept, image)
        assert np.array_equal(read, joints)


@pytest.mark.slow
def test_an_arm_that_turns_is_not_kept_though_its_image_stands(views):
    image, joints = views[0]
    turning = [(image, joints + 1e-3 * k) for k in range(4)]
    watch, _ = watched(*turning)
    assert watch.images == []
    assert "let the arm stand" in watch.last.words
    assert len(watched(*turning, turning[-1])[0].images) == 1


def test_an_image_that_moves_though_the_arm_stands_is_not_kept(views):
    watch, _ = watched(views[0], (views[1][0], views[0][1]))
    assert watch.images == []
    assert "moves though the arm stands" in watch.last.words


@pytest.mark.slow
def test_a_board_that_was_hidden_in_between_does_not_stand_still(views):
    hidden = (np.full_like(views[0][0], 90), views[0][1])
    watch, _ = watched(views[0], hidden, views[0])
    assert watch.images == []
    assert len(watched(views[0], hidden, views[0], views[0])[0].images) == 1


def test_joints_from_before_the_image_are_not_taken(views):
    watch, _ = watched(views[0], views[0], views[0], late=0.5)
    assert watch.images == []
    assert "no joint state since" in watch.last.words


def board_seen(lens, board, turn):
    """The board's view in front of the camera, turned about the camera's z, then y, then x [deg]."""
    turned = Rotation.from_euler("zyx", turn[::-1], degrees=True)
    points = turned.apply(board.points - board.points.mean(axis=0))
    pixels, seen = lens.project(points + np.array([0.0, 0.0, 0.4]))
    assert seen.all()
    return BoardView.of(board, np.arange(len(points)), pixels)


@pytest.mark.parametrize("roll", [0.0, 80.0])
@pytest.mark.parametrize(
    ("axis", "name"), list(enumerate(["tilted up and down", "tilted left and right", "about its axis"]))
)
def test_a_turn_about_each_axis_of_the_camera_is_missing_until_it_was_made(axis, name, roll):
    lens, board = preset("fe185"), board_from_text(BOARD)
    choice, joints = PoseChoice(lens, board), np.zeros(6)

    def show(turn):
        view = board_seen(lens, board, turn)
        choice.judge(view, joints)
        assert choice.judge(view, joints).kept

    start = np.array([0.0, 0.0, roll])
    show(start)
    assert len(choice.missing()) == 4
    for other in range(3):
        if other != axis:
            show(start + 32.0 * np.eye(3)[other])
    assert [name in words for words in choice.missing()] == [True, False]
    assert choice.missing()[-1] == "7 more views"
    show(start - 32.0 * np.eye(3)[axis])
    assert choice.missing() == ("6 more views",)


def test_turns_about_the_axis_are_counted_across_half_a_turn():
    lens, board = preset("fe185"), board_from_text(BOARD)
    choice = PoseChoice(lens, board)
    for turn in (170.0, 190.0):
        view = board_seen(lens, board, [0.0, 0.0, turn])
        choice.judge(view, np.zeros(6))
        assert choice.judge(view, np.zeros(6)).kept
    assert np.degrees(choice.spread) == pytest.approx([0.0, 0.0, 20.0], abs=0.1)


def test_a_board_that_looks_the_same_turned_counts_as_turned_least():
    lens, board = preset("fe185"), board_from_text("checkerboard:7x7:0.03")
    choice, joints = PoseChoice(lens, board), np.zeros(6)
    for turn in (0.0, 180.0, 90.0):
        view = replace(board_seen(lens, board, [0.0, 0.0, turn]), turnable=True)
        choice.judge(view, joints)
        choice.judge(view, joints)
    assert len(choice.joints) == 1
    turned = replace(board_seen(lens, board, [0.0, 0.0, 195.0]), turnable=True)
    choice.judge(turned, joints)
    assert choice.judge(turned, joints).kept
    assert np.degrees(choice.spread[2]) == pytest.approx(15.0, abs=0.1)


@pytest.fixture
def robot(tmp_path):
    """A robot file of the RX60 behind a controller's names."""
    path = tmp_path / "robot.yaml"
    names = dict(zip(Arm.rx60().joint_names, UR_JOINTS, strict=True))
    mount = {"translation": [0.0, 0.0, 0.1]}
    fields = {"format": "omniservo.robot/1", "driver": "rtde", "joints": names}
    fields |= {"arm": {"model": "rx60", "flange_T_camera": mount}}
    path.write_text(yaml.safe_dump(fields | {"camera": {"source": "v4l2:0", "calibration": "fe185"}}))
    return path


def run(arguments, capsys):
    try:
        main(["robot", "calibrate-hand-eye", *map(str, arguments), "--board", BOARD])
        code = 0
    except SystemExit as end:
        code = end.code or 0
    return code, capsys.readouterr()


def guided(monkeypatch, *views):
    ends = []

    def end():
        if not ends:
            ends.append(True)
            signal.raise_signal(signal.SIGINT)

    both = Guided(*(view for view in views for _ in range(2)), end=end)
    monkeypatch.setattr("omniservo.runs.open_hardware.listen_to_arm", lambda robot, arm, driver: both)
    monkeypatch.setattr("omniservo.runs.open_hardware.open_robot_camera", lambda robot: both)
    return both


@pytest.mark.slow
def test_live_finds_the_mount_and_files_repeat_it(views, robot, monkeypatch, tmp_path, capsys):
    guided(monkeypatch, *views)
    out, again = tmp_path / "hand-eye.json", tmp_path / "again.json"
    code, said = run(["--on", robot, "--out", out], capsys)
    assert code == 0, said.err
    assert "stopped: 6 of 12 images kept; still missing:" in said.out
    off = error_of(load_hand_eye(out)[0], FLANGE_T_CAMERA)
    assert np.linalg.norm(off[:3]) < 2e-3
    assert np.linalg.norm(off[3:]) < np.radians(0.5)
    folder = tmp_path / "hand-eye-images"
    files = sorted(folder.glob("*.png"))
    assert len(files) == len(json.loads((folder / "poses.json").read_text())["base_T_flange"]) == 6
    given = [*files, "--poses", folder / "poses.json", "--camera", "fe185", "--out", again]
    assert run(given, capsys)[0] == 0
    assert again.read_bytes() == out.read_bytes()


def test_a_folder_that_is_there_is_kept_and_refused_at_once(views, robot, monkeypatch, tmp_path, capsys):
    both = guided(monkeypatch, *views)
    (tmp_path / "hand-eye-images").mkdir()
    code, said = run(["--on", robot, "--out", tmp_path / "hand-eye.json"], capsys)
    assert code == 2
    assert "hand-eye-images: exists" in said.err
    assert both.shown == 0


@pytest.mark.slow
def test_too_few_views_write_nothing(views, robot, monkeypatch, tmp_path, capsys):
    guided(monkeypatch, *views[:3])
    code, said = run(["--on", robot, "--out", tmp_path / "hand-eye.json"], capsys)
    assert code == 1
    assert "3 of 6 images kept, at least 4 are needed; nothing was written" in said.err
    assert list(tmp_path.iterdir()) == [robot]


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (["a.png", "--poses", "p.yaml"], "give images, --poses and --camera, or --on"),
        (["--on", "robot.yaml", "a.png"], "--on: goes without images"),
        (["--on", "robot.yaml"], "give --out or --save"),
        (["--camera-source", "0"], "--camera-source: goes with --on"),
        (["a.png", "--poses", "p", "--camera", "fe185", "--save", "kept"], "--save: goes with --on"),
    ],
)
def test_a_wrong_call_is_one_message(arguments, named, robot, monkeypatch, tmp_path, capsys):
    monkeypatch.chdir(tmp_path)
    code, said = run(arguments, capsys)
    assert code == 2
    assert named in said.err


def test_an_arm_is_listened_to_without_a_program_of_ours(robot):
    with UrStandIn(WallClockArm()) as controller:
        text = robot.read_text()
        robot.write_text(text + f"address: {controller.address}\n")
        loaded = load_robot(robot)
        arm = listen_to_arm(loaded, loaded.loaded_arm())
        try:
            assert np.array_equal(arm.read().joint_positions, WallClockArm().joints)
            assert controller._program is None
        finally:
            arm.close()
