"""Tasks on real robots: where things are seen from there, and who is refused before anything moves."""

import json
import time
from contextlib import closing
from itertools import product
from pathlib import Path

import jsonschema
import numpy as np
import pytest
import yaml
from scipy.spatial.transform import RigidTransform

import omniservo.robots
import omniservo.runs.open_hardware as open_hardware_module
import omniservo.runs.robot_check as robot_check
from omniservo.calibration.camera_delay import CameraDelay
from omniservo.cli.main import main
from omniservo.cli.robot_file import RobotParts
from omniservo.errors import InputError, NoSolutionError, NotInControl, ProtectiveStop
from omniservo.hardware.rtde.server import UrStandIn
from omniservo.robots import ArmMode, RobotState
from omniservo.runs.begun_as_recorded import begun_as_recorded
from omniservo.runs.loop_delay import LoopDelay
from omniservo.runs.on_robot import on_robot, sensor_of
from omniservo.runs.open_hardware import open_bare, open_hardware, open_robot
from omniservo.runs.robot_delay import RobotDelay
from omniservo.runs.robot_records import StoredDelay, require_check, save_check, save_delay, stored_delay
from omniservo.runs.run_inputs import RunInputs
from omniservo.runs.safety_of_task import safety_of_task
from omniservo.safety import SafetyOptions
from omniservo.scenes import scene_of_task
from omniservo.schemas import json_schema
from omniservo.tasks import TaughtGoal, load_robot, load_task
from omniservo.tracking import ReplanOptions

TASK = load_task("ur5e-table")
MOUNT = TASK.arm.flange_T_camera.transform
BOX = {"min": [-1.0, -1.0, 0.1], "max": [1.0, 1.0, 1.2]}


@pytest.fixture
def robot_file(tmp_path):
    """Write a robot file with the task's arm, mount and camera."""

    def write(**changes):
        camera = {"source": "folder:images?rate=30", "calibration": TASK.camera.to_dict()}
        arm = {
            "model": TASK.arm.model,
            "flange_T_camera": {
                "translation": MOUNT.translation.tolist(),
                "quaternion": MOUNT.rotation.as_quat().tolist(),
            },
        }
        fields = {"format": "omniservo.robot/1", "driver": "rtde", "arm": arm, "camera": camera, **changes}
        path = tmp_path / "robot.yaml"
        path.write_text(yaml.safe_dump(fields))
        return path

    return write


class StandingArm:
    """An arm that stands, in a mode."""

    def __init__(self, joints, mode=ArmMode.READY):
        self.joints, self.mode = np.array(joints), mode
        self.commands = []

    def read(self):
        return RobotState(time.monotonic(), self.joints, np.zeros(6), self.mode)

    def command(self, joint_velocities):
        self.commands.append(np.array(joint_velocities))

    def stop(self):
        pass

    def close(self):
        pass


def test_everything_stays_where_it_is_in_the_arms_base_frame(robot_file):
    scene = scene_of_task(TASK)
    joints = scene.start_joints + np.deg2rad([3.0, -2.0, 4.0, 1.0, 2.0, -5.0])
    robot = load_robot(robot_file())
    begun, there = on_robot(TASK, robot, robot.loaded_arm(), joints)
    assert np.array_equal(there.start_joints, joints)
    for before, after in zip(scene.bodies, there.bodies, strict=True):
        assert np.allclose(before.world_T_box.as_matrix(), after.world_T_box.as_matrix(), atol=1e-9)
    goals = [
        task.start.world_T_camera.transform * task.teach.initial_T_goal.transform for task in (TASK, begun)
    ]
    assert np.allclose(goals[0].as_matrix(), goals[1].as_matrix(), atol=1e-9)
    assert np.allclose(
        there.world_T_camera(joints).as_matrix(), begun.start.world_T_camera.transform.as_matrix()
    )
    assert np.allclose(there.arm.joint_speed, 0.1 * scene.arm.joint_speed)
    assert begun.servo.time_limit == pytest.approx(10.0 * TASK.servo.time_limit)


def test_a_workspace_of_the_robot_file_is_in_the_base_frame(robot_file):
    robot = load_robot(robot_file(workspace=BOX))
    joints = scene_of_task(TASK).start_joints
    plain = TASK.model_copy(update={"planning": TASK.planning.model_copy(update={"workspace": None})})
    begun, _ = on_robot(plain, robot, robot.loaded_arm(), joints)
    world_T_base = RigidTransform.from_translation(np.asarray(TASK.arm.foot))
    here_T_base = begun.start.world_T_camera.transform.inv() * world_T_base
    sides = begun.planning.workspace.workspace.half_spaces
    inside, outside = here_T_base.apply([[0.9, 0.9, 0.2], [0.9, 0.9, 0.0]])
    assert len(sides) == 6
    assert all(side.normal @ inside > side.offset for side in sides)
    assert any(side.normal @ outside < side.offset for side in sides)


def heights(options, found):
    """Return the lowest and the highest place that is allowed, in the base frame [m]."""
    corners = np.array(list(product(*options.workspace.T)))
    places = (found * options.found_T_workspace).apply(corners)
    return places[:, 2].min(), places[:, 2].max()


def test_no_more_than_that_workspace_is_watched_where_the_camera_looks_askew(robot_file):
    """Its hull along the camera's axes would reach under the table."""
    robot = load_robot(robot_file(workspace=BOX))
    joints = scene_of_task(TASK).start_joints + np.deg2rad([0.0, 0.0, 0.0, 30.0, 20.0, 30.0])
    plain = TASK.model_copy(update={"planning": TASK.planning.model_copy(update={"workspace": None})})
    begun, scene = on_robot(plain, robot, robot.loaded_arm(), joints)
    found = scene.arm.base_T_flange(joints) * scene.flange_T_camera
    assert heights(safety_of_task(begun), found) == pytest.approx((0.1 - 0.03, 1.2 + 0.03))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda task: load_task("moving-panel"), "moves: obstacles are moved by the simulator alone"),
        (
            lambda task: task,
            r"elbow is at 1000\.00 deg, out of the range in ur5e\.xml, -360 to 360 deg",
        ),
    ],
)
def test_what_cannot_be_done_on_a_robot_is_refused(robot_file, change, message):
    robot = load_robot(robot_file())
    joints = scene_of_task(TASK).start_joints.copy()
    joints[2] = np.deg2rad(1000.0)
    with pytest.raises(InputError, match=message):
        on_robot(change(TASK), robot, robot.loaded_arm(), joints)


def serving(mode=ArmMode.READY):
    return UrStandIn(StandingArm(scene_of_task(TASK).start_joints, mode))


def opened(robot_file, server, **changes):
    """Open the task on a stand-in; fail where anything is about to move."""
    path = robot_file(address=server.address, **{"options": _ports(server), **changes})
    return open_hardware(TASK, load_robot(path), lambda motion: pytest.fail(motion))


@pytest.mark.parametrize(
    ("mode", "stop", "words"),
    [
        (ArmMode.PROTECTIVE_STOP, ProtectiveStop, "the arm's controller reports: protective stop"),
        (ArmMode.NOT_IN_CONTROL, NotInControl, "no commands from this program: robot idle, safety normal"),
    ],
)
def test_an_arm_that_may_not_move_is_refused_by_name(robot_file, mode, stop, words):
    with serving(mode) as server, pytest.raises(stop, match=words):
        opened(robot_file, server, options={**_ports(server), "send_program": False})


def _ports(server):
    ports = {"script_port": server.ports.scripts[0], "dashboard_port": server.ports.dashboard}
    return ports | {"watchdog": 1.0}  # other work on this machine is no fault here


def test_images_of_another_size_are_another_camera(robot_file, tmp_path):
    from omniservo.files.image_files import write_png

    (tmp_path / "images").mkdir()
    for number in range(9):
        write_png(np.full((48, 64), 20 * number, np.uint8), tmp_path / "images" / f"{number}.png")
    with serving() as server, pytest.raises(InputError, match=r"images of 64×48 px; the calibration is of"):
        opened(robot_file, server)


def test_a_wrong_joint_name_is_refused_with_those_that_the_arm_has(robot_file):
    with serving() as server, pytest.raises(InputError, match=r"ellbow.*elbow"):
        opened(robot_file, server, joints={"elbow": "ellbow"})


def test_nobody_at_the_address_is_one_message(robot_file):
    robot = load_robot(robot_file(address="127.0.0.1:9", options={"patience": 0.2}))
    with pytest.raises(InputError, match=r"127\.0\.0\.1:9"):
        open_robot(robot, robot.loaded_arm())


def test_a_driver_without_a_watchdog_is_refused_unless_one_is_stated(robot_file, tmp_path):
    (tmp_path / "own.py").write_text(
        "class Arm:\n"
        "    watchdog = None\n"
        "    def __init__(self, address, joint_names): self.joint_names = joint_names\n"
        "    def close(self): self.closed = True\n"
        "    read = command = stop = close\n"
    )
    own = f"{tmp_path / 'own.py'}:Arm"
    robot = load_robot(robot_file())
    with pytest.raises(InputError, match="cannot promise that the arm stops when commands cease"):
        open_robot(robot, robot.loaded_arm(), own)
    robot = load_robot(robot_file(watchdog=0.2))
    assert open_robot(robot, robot.loaded_arm(), own).joint_names == robot.loaded_arm().joint_names


@pytest.mark.parametrize("driver", ["os:system", "rdte", "../own.py", "subprocess"])
def test_a_robot_file_names_drivers_and_runs_no_code(robot_file, driver):
    robot = load_robot(robot_file(driver=driver))
    with pytest.raises(InputError, match=r"driver: .* given; legal: rtde, ros2"):
        open_robot(robot, robot.loaded_arm())


def test_a_driver_file_in_a_robot_file_is_not_run(robot_file, tmp_path):
    (tmp_path / "own.py").write_text("raise SystemExit('this code was run')\n")
    robot = load_robot(robot_file(driver=f"{tmp_path / 'own.py'}:Arm"))
    with pytest.raises(InputError, match=r"--driver FILE\.py:CLASS"):
        open_robot(robot, robot.loaded_arm())


def test_a_run_needs_a_fresh_check_of_the_same_file(robot_file):
    path = robot_file()
    with pytest.raises(InputError, match="not checked yet; run: omniservo robot check"):
        require_check(path, load_robot(path))
    kept = save_check(path, load_robot(path))
    require_check(path, load_robot(path))
    robot_file(speed=0.5)
    with pytest.raises(InputError, match="changed since it was checked"):
        require_check(path, load_robot(path))
    save_check(path, load_robot(path))
    document = json.loads(kept.read_text())
    kept.write_text(json.dumps({**document, "time": document["time"] - 30.0 * 3600.0}))
    with pytest.raises(InputError, match="checked 30 h ago; at most 24 h"):
        require_check(path, load_robot(path))


def test_a_check_of_another_driver_or_camera_is_none_of_this_robot(robot_file, tmp_path):
    path, own = robot_file(), tmp_path / "stand_in.py"
    own.write_text("sign = 1.0\n")
    save_check(path, load_robot(path), f"{own}:Arm")
    require_check(path, load_robot(path), f"{own}:Arm")
    with pytest.raises(InputError, match=r"checked with driver '.*stand_in\.py:Arm'; it is 'rtde' now; run"):
        require_check(path, load_robot(path))
    save_check(path, load_robot(path, camera_source="v4l2:1"))
    with pytest.raises(InputError, match="checked with camera_source 'v4l2:1'"):
        require_check(path, load_robot(path))


def test_a_check_is_of_the_code_of_a_driver_of_ones_own(robot_file, tmp_path):
    path, own = robot_file(), tmp_path / "stand_in.py"
    own.write_text("sign = 1.0\n")
    save_check(path, load_robot(path), f"{own}:Arm")
    own.write_text("sign = -1.0\n")
    with pytest.raises(InputError, match="changed since it was checked, or a file that it or --driver names"):
        require_check(path, load_robot(path), f"{own}:Arm")


def test_a_check_is_of_the_arms_file_and_the_mounts_too(robot_file, tmp_path):
    model = tmp_path / "arm.xml"
    model.write_text((Path(omniservo.robots.__file__).parent / "shipped" / "rx60.xml").read_text())
    mount = {"translation": [0.0, 0.0, 0.1]}
    path = robot_file(arm={"model": "arm.xml", "flange_T_camera": mount})
    save_check(path, load_robot(path))
    require_check(path, load_robot(path))
    model.write_text(model.read_text().replace('axis="0 1 0"', 'axis="0 -1 0"', 1))
    with pytest.raises(InputError, match="changed since it was checked, or a file that it"):
        require_check(path, load_robot(path))
    save_check(path, load_robot(path))
    robot_file(arm={"model": "arm.xml", "flange_T_camera": {"translation": [0.0, 0.0, 0.2]}})
    with pytest.raises(InputError, match="changed since it was checked"):
        require_check(path, load_robot(path))


@pytest.mark.parametrize("source", ["folder:images?rate=30", "folder:images", "film.mp4"])
def test_images_are_looked_for_beside_the_robot_file_as_its_other_files_are(
    robot_file, tmp_path, monkeypatch, source
):
    robot = load_robot(path := robot_file(camera={"source": source, "calibration": TASK.camera.to_dict()}))
    place = tmp_path.resolve() / "images" if "folder" in source else tmp_path.resolve() / "film.mp4"
    assert robot.camera_uri == source.replace("images", str(place)).replace("film.mp4", str(place))
    assert robot.camera.source == source  # so a check counts wherever the commands are given
    monkeypatch.chdir(tmp_path)
    assert load_robot(path.name).camera_uri == robot.camera_uri
    assert load_robot(path, camera_source=source).camera_uri == source


@pytest.mark.parametrize("source", ["v4l2:0", "0", "/dev/video2", "http://a.b/c", "rtsp://a", "ros2:/image"])
def test_a_camera_that_is_no_file_is_what_the_robot_file_says(robot_file, source):
    assert load_robot(robot_file(camera={"source": source, "calibration": "fe185"})).camera_uri == source


@pytest.mark.parametrize("source", ["folder:../images?rate=30", "folder:/images", "../film.mp4"])
def test_images_outside_the_robot_files_folder_need_leave(robot_file, source):
    path = robot_file(camera={"source": source, "calibration": "fe185"})
    with pytest.raises(InputError, match=r"robot\.yaml: camera\.source: .*--allow-outside"):
        assert load_robot(path).camera_uri
    assert load_robot(path, allow_outside=True).camera_uri.endswith(source.partition("/")[2])


@pytest.mark.parametrize("share", [0.0, 1.5, float("nan")])
def test_a_share_of_the_speeds_on_the_command_line_is_refused_by_its_name(robot_file, share):
    with pytest.raises(InputError, match=rf"^--speed: {share:g} given"):
        RobotParts().load(robot_file(speed=0.2), share, allow_outside=False)


FOUND = RobotDelay(CameraDelay(0.043, 0.0015, 0.2, 90.0), 0.021, 0.001, 120, 0.083)


def test_what_was_measured_is_read_again_where_it_was_measured(robot_file):
    path = robot_file()
    robot = load_robot(path)
    assert stored_delay(path, robot) is None
    written = save_delay(path, robot, FOUND)
    jsonschema.validate(json.loads(written.read_text()), json_schema("robot-delay"))
    found = stored_delay(path, robot)
    assert (found.camera_offset, found.camera_sigma, found.actuation_lag) == (0.043, 0.0015, 0.021)
    options = found.within(SafetyOptions(image_age=0.7))
    assert (options.command_lag, options.offset_sigma, options.image_age) == (0.021, 0.0015, 0.7)


def test_how_late_a_twist_acts_is_what_was_measured_with_its_uncertainty(robot_file):
    path = robot_file()
    robot = load_robot(path)
    written = save_delay(path, robot, FOUND)
    late = stored_delay(path, robot).loop
    assert late.images == pytest.approx(0.083 - 0.043 + 3.0 * 0.0015)
    assert late.motions == pytest.approx(0.021 + 3.0 * 0.001)
    older = json.loads(written.read_text())
    del older["image_age_s"]
    written.write_text(json.dumps(older))
    assert stored_delay(path, robot).loop is None


def test_delays_that_no_run_can_bear_are_refused_where_they_are_read(robot_file):
    assert LoopDelay(0.6, 0.4).total == 1.0
    for images, motions, words in (
        (0.6, 0.5, "images and motions: 1.1"),
        (1.1, 0.0, "images: 1.1"),
        (0.0, 1.1, "motions: 1.1"),
    ):
        with pytest.raises(InputError, match=rf"{words} given; legal: .* 1\b"):
            LoopDelay(images, motions)
        with pytest.raises(InputError, match=f"run.json: late: {words}"):
            LoopDelay.from_fields({"images": images, "motions": motions}, "run.json: late")
    path = robot_file()
    written = save_delay(path, load_robot(path), FOUND)
    written.write_text(json.dumps(json.loads(written.read_text()) | {"image_age_s": 1.02}))
    with pytest.raises(InputError, match=r"robot\.delay\.json: images and motions: 1\.0"):
        stored_delay(path, load_robot(path))


@pytest.mark.parametrize(
    ("found", "words"),
    [
        (RobotDelay(CameraDelay(0.0, 0.002, 0.2, 90.0), 0.1, 0.001, 40, 0.95), r"images and motions: 1\.0"),
        (RobotDelay(CameraDelay(0.61, 0.002, 0.2, 90.0), 0.1, 0.001, 40, 0.95), r"camera_offset_s: 0\.61"),
    ],
)
def test_a_delay_that_no_run_can_bear_is_refused_where_it_is_measured(robot_file, found, words):
    path = robot_file()
    with pytest.raises(NoSolutionError, match=rf"not kept: {words}"):
        save_delay(path, load_robot(path), found)
    assert stored_delay(path, load_robot(path)) is None


def test_the_way_taken_up_begins_later_where_images_and_motions_were_measured_to_be_later(robot_file):
    robot, joints = load_robot(robot_file()), scene_of_task(TASK).start_joints
    arm, late = robot.loaded_arm(), LoopDelay(images=0.15, motions=0.05)
    stated, _ = on_robot(TASK, robot, arm, joints)
    measured, _ = on_robot(TASK, robot, arm, joints, late)
    assert (stated.sensor.latency, measured.sensor.latency) == (0.02, pytest.approx(0.2))
    before, after = (
        ReplanOptions.of_loop(task.sensor.rate, task.sensor.latency, 0.01, 0).ahead
        for task in (stated, measured)
    )
    assert after - before == pytest.approx(0.18)
    camera = {"source": "v4l2:0", "calibration": TASK.camera.to_dict(), "exposure": 0.02}
    exposed = load_robot(robot_file(camera=camera)).camera
    assert sensor_of(exposed, LoopDelay(0.0, 0.0)).latency == pytest.approx(0.01)


def test_a_recording_keeps_how_late_a_twist_was_taken_to_act_and_one_without_it_has_what_is_stated(
    robot_file, tmp_path
):
    robot, joints = load_robot(robot_file()), scene_of_task(TASK).start_joints
    kept = TASK.sources.kept(TASK)
    for late in (None, LoopDelay(0.15, 0.05)):
        begun, _ = on_robot(TASK, robot, robot.loaded_arm(), joints, late)
        inputs = RunInputs.now("certified", 0, kept, joints, begun.sources.kept_robot())
        fields = json.loads(inputs.to_json())
        if late is None:
            del fields["robot"]["late"]  # as older versions wrote it
        again = RunInputs.from_fields(fields, kept.files, "run.json", inputs.robot.files.files)
        assert LoopDelay.from_fields(again.robot.late, "late") == late
        folder = tmp_path / str(late is None)
        folder.mkdir()
        blank = np.zeros((TASK.camera.height, TASK.camera.width), np.uint8)
        goal = TaughtGoal(TASK.camera, blank, np.zeros((0, 2)), None)
        replayed, _ = begun_as_recorded(again, goal, folder, allow_outside=False)
        assert replayed.sensor == begun.sensor
    for wrong, words in ((7, "late: 7 given"), ({"images": -1.0, "motions": 0.0}, "late: images: -1")):
        fields["robot"]["late"] = wrong
        with pytest.raises(InputError, match=words):
            RunInputs.from_fields(fields, kept.files, "run.json", inputs.robot.files.files)


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"address": "10.0.0.7"}, "address"),
        ({"driver": "ros2"}, "driver"),
        ({"camera": {"source": "v4l2:3", "calibration": TASK.camera.to_dict()}}, "camera_source"),
    ],
)
def test_what_was_measured_of_something_else_is_refused(robot_file, changes, field):
    path = robot_file()
    save_delay(path, load_robot(path), FOUND)
    path = robot_file(**changes)
    with pytest.raises(InputError, match=f"measured with {field} .*; measure it again: omniservo r"):
        stored_delay(path, load_robot(path))


def test_what_was_measured_with_another_driver_is_refused(robot_file):
    path = robot_file()
    save_delay(path, load_robot(path), FOUND)
    with pytest.raises(InputError, match=r"measured with driver 'rtde'; it is 'own\.py:Arm' now"):
        stored_delay(path, load_robot(path), "own.py:Arm")
    save_delay(path, load_robot(path), FOUND, "own.py:Arm")
    assert stored_delay(path, load_robot(path), "own.py:Arm").camera_offset == 0.043


@pytest.mark.parametrize("field", ["camera_offset_s", "camera_offset_sigma_s", "actuation_lag_s"])
@pytest.mark.parametrize("value", [None, "0.1", -9.0, 9e9])
def test_a_record_that_is_none_is_refused_by_its_field(robot_file, field, value):
    path = robot_file()
    kept = save_delay(path, load_robot(path), FOUND)
    kept.write_text(json.dumps({**json.loads(kept.read_text()), field: value}))
    with pytest.raises(InputError, match=field):
        stored_delay(path, load_robot(path))


@pytest.fixture
def filmed(tmp_path):
    """The robot file's camera has images."""
    from omniservo.files.image_files import write_png

    (tmp_path / "images").mkdir()
    for number in range(9):
        picture = np.full((TASK.camera.height, TASK.camera.width), 20 * number, np.uint8)
        write_png(picture, tmp_path / "images" / f"{number}.png")


@pytest.mark.slow
def test_a_check_says_what_the_driver_notices(robot_file, filmed, capsys):
    with serving() as server:
        server.speed_fraction = 0.5
        path = robot_file(address=server.address, options=_ports(server))
        with pytest.raises(SystemExit):
            main(["robot", "check", str(path), "--yes"])
    assert "notice           the pendant's speed slider stands at 50%" in capsys.readouterr().out


@pytest.mark.slow
def test_a_check_goes_by_what_was_measured_and_says_what_was_of_another_camera(
    robot_file, filmed, monkeypatch, capsys
):
    given, checked = [], robot_check.check_robot

    def noted(*arguments):
        given.append((arguments[3]._offset, arguments[5]))
        return checked(*arguments)

    monkeypatch.setattr(robot_check, "check_robot", noted)
    with serving() as server:
        path = robot_file(address=server.address, options=_ports(server))
        for source in ("v4l2:0", load_robot(path).camera.source):
            save_delay(path, load_robot(path, camera_source=source), FOUND)
            with pytest.raises(SystemExit):
                main(["robot", "check", str(path), "--yes"])
    assert given == [(0.0, None), (0.043, stored_delay(path, load_robot(path)).loop)]
    assert capsys.readouterr().out.count("measured with camera_source 'v4l2:0'") == 1


@pytest.mark.slow
def test_an_arm_that_is_found_unfit_is_not_moved_by_its_check_of_before(
    robot_file, filmed, monkeypatch, capsys
):
    monkeypatch.setattr(robot_check, "SECONDS", 0.2)
    with serving() as server:
        path = robot_file(address=server.address, options=_ports(server))
        save_check(path, load_robot(path))
        with pytest.raises(SystemExit) as end:
            main(["robot", "check", str(path), "--yes"])
    assert end.value.code == 1
    assert "to be mended" in capsys.readouterr().out
    with pytest.raises(InputError, match="not checked yet"):
        require_check(path, load_robot(path))


@pytest.mark.slow
def test_a_robot_whose_delay_cannot_be_measured_is_not_moved_by_that_of_before(robot_file, filmed):
    with serving() as server:
        path = robot_file(address=server.address, options=_ports(server))
        beside = path.with_suffix(".delay.json")
        beside.write_text("{}")
        with pytest.raises(SystemExit) as end:
            main(["robot", "delay", str(path), "--yes"])
    assert end.value.code != 0
    assert not beside.exists()


@pytest.mark.slow
def test_without_a_task_the_files_workspace_counts_too(robot_file, filmed):
    with serving() as server:
        path = robot_file(address=server.address, options=_ports(server), workspace=BOX)
        cell = open_bare(load_robot(path), lambda motion: pytest.fail(motion), SafetyOptions())
        with closing(cell):
            scene = cell.scene
            found = scene.arm.base_T_flange(scene.start_joints) * scene.flange_T_camera
            assert heights(cell._client.options, found) == pytest.approx((0.1, 1.2))


@pytest.mark.slow
def test_an_arm_that_is_moved_while_it_is_connected_to_is_refused(robot_file, filmed, monkeypatch):
    arm = StandingArm(scene_of_task(TASK).start_joints)
    open_camera = open_hardware_module.open_robot_camera

    def moved_meanwhile(*arguments):
        arm.joints = arm.joints + 0.2 * np.eye(6)[5]
        return open_camera(*arguments)

    monkeypatch.setattr(open_hardware_module, "open_robot_camera", moved_meanwhile)
    with UrStandIn(arm) as server:
        path = robot_file(address=server.address, options=_ports(server), workspace=BOX)
        with pytest.raises(InputError, match=r"wrist_3 was moved by 11\.46 deg"):
            open_bare(load_robot(path), lambda motion: pytest.fail(motion), SafetyOptions()).close()


@pytest.mark.slow
def test_a_run_uses_what_was_measured(robot_file, filmed):
    with serving() as server:
        path = robot_file(address=server.address, options=_ports(server))
        delay = StoredDelay(0.043, 0.0015, 0.021, LoopDelay(0.2, 0.03))
        _, cell = open_hardware(TASK, load_robot(path), lambda motion: pytest.fail(motion), delay=delay)
        with closing(cell):
            options = cell._client.options
            assert (options.command_lag, options.offset_sigma) == (0.021, 0.0015)
            assert options.image_age == pytest.approx(0.2 + 3.0 / 30.0)  # 0.25 where it is stated
            assert options.path_room == pytest.approx(0.006 + 0.005)
            assert (cell.camera._offset, cell.camera._sigma) == (0.043, 0.0015)
