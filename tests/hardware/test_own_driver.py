"""The driver of the examples keeps what docs/how-to-write-a-driver.md says of one."""

import importlib.util
import socket
import threading
from pathlib import Path

import numpy as np
import pytest
from tests.hardware.wall_clock_arm import wait_for

from omniservo.cameras import preset
from omniservo.errors import ConnectionLost, InputError, InvalidData, RobotLost
from omniservo.hardware import ArmConnection
from omniservo.robots import load_arm
from omniservo.runs.open_hardware import open_robot
from omniservo.tasks import RobotFile

FOLDER = Path(__file__).resolve().parents[2] / "examples"


def script(name):
    spec = importlib.util.spec_from_file_location(name, FOLDER / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def examples(monkeypatch):
    monkeypatch.syspath_prepend(str(FOLDER))
    return script("own_controller"), script("own_driver")


def lost_words(arm):
    def heard():
        try:
            arm.read()
        except ConnectionLost as error:
            return str(error)
        return None

    return wait_for(heard)


def test_it_is_a_connection_whose_joints_go_by_name(examples):
    controller, driver = examples
    arm = driver.SocketArm(controller.start(), controller.NAMES[::-1])
    assert isinstance(arm, ArmConnection)
    speeds = np.arange(6) / 100.0
    wait_for(lambda: np.array_equal(arm.read().joint_velocities, speeds), lambda: arm.command(speeds))
    with pytest.raises(ValueError, match="not JSON compliant"):
        arm.command([np.nan] * 6)
    with pytest.raises(ValueError, match="shorter"):
        arm.command([0.0] * 5)
    arm.stop()
    wait_for(lambda: not arm.read().joint_velocities.any())
    arm.close()
    arm.close()
    assert lost_words(arm)


def test_it_is_opened_by_a_robot_file_as_the_page_says(examples):
    controller, _ = examples
    names, arm = controller.NAMES[::-1], load_arm("ur5e")
    robot = RobotFile.model_validate(
        {
            "driver": "my own",
            "address": controller.start(),
            "joints": dict(zip(arm.joint_names, names, strict=True)),
            "arm": {"model": "ur5e", "flange_T_camera": {}},
            "camera": {"source": "v4l2:0", "calibration": preset("fe185")},
        }
    )
    connection = open_robot(robot, arm, f"{FOLDER / 'own_driver.py'}:SocketArm")
    assert connection.joint_names == names
    assert connection.watchdog == controller.WATCHDOG
    connection.close()


OWN = """
import numpy as np
from omniservo.robots import RobotState


class Arm:
    watchdog = 0.1

    def __init__(self, address, joint_names):
        self.state = RobotState(1.0, np.zeros(6), np.zeros(6))

    def read(self):
        return self.state

    def command(self, joint_velocities):
        pass

    def stop(self):
        pass

    def close(self):
        pass


class Own(Arm):
    {body}
"""


@pytest.mark.parametrize(
    ("body", "error", "words"),
    [
        (
            "def __init__(self): pass",
            InputError,
            "Own: too many positional .* legal: what takes addr",
        ),
        (
            "def __new__(cls, *given): return 7",
            InputError,
            "Own: gives a int; legal: what has read, c",
        ),
        ("watchdog = '0.1'", InputError, "driver: .*Own: watchdog: '0.1' given"),
        ("watchdog = 0.0", InputError, "driver: .*Own: watchdog: 0"),
        ("watchdog = None", InputError, "driver: .*Own cannot promise that the arm stops"),
        ("joint_names = ('a', 'b')", InputError, r"joint_names: \('a', 'b'\) given; legal: those"),
        ("def __init__(self, *_): {}['port']", ConnectionLost, "Own: cannot be opened: KeyError: 'port'"),
        ("def read(self): return None", InvalidData, "the robot reports None for its joints"),
        ("def read(self): {}['q']", RobotLost, "the robot's read failed: KeyError: 'q'"),
        ("def command(self, speeds): {}['q']", RobotLost, "the robot's command failed: KeyError: 'q'"),
    ],
)
def test_what_an_own_driver_does_wrong_is_one_message(tmp_path, body, error, words):
    (tmp_path / "own.py").write_text(OWN.replace("{body}", body))
    arm = load_arm("ur5e")
    robot = RobotFile.model_validate(
        {
            "driver": "my own",
            "arm": {"model": "ur5e", "flange_T_camera": {}},
            "camera": {"source": "v4l2:0", "calibration": preset("fe185")},
        }
    )
    with pytest.raises(error, match=words):
        connection = open_robot(robot, arm, f"{tmp_path / 'own.py'}:Own")
        connection.read()
        connection.command(np.zeros(6))


def test_an_unknown_joint_is_named_at_opening(examples):
    controller, driver = examples
    with pytest.raises(ConnectionLost, match="'thumb'"):
        driver.SocketArm(controller.start(), ("thumb",))


@pytest.mark.parametrize(
    ("line", "words"),
    [
        (b"", "closed the connection"),
        (b"not JSON\n", "JSONDecodeError"),
        (b'{"time": NaN, "q": {"a": 0}, "qd": {"a": 0}}\n', "NotFinite"),
    ],
)
def test_a_controller_that_ends_or_errs_is_lost_with_the_reason(examples, line, words):
    _, driver = examples
    with socket.create_server(("127.0.0.1", 0)) as server:
        first = b'{"time": 1.0, "q": {"a": 0.5}, "qd": {"a": 0.0}}\n'
        said = threading.Event()

        def serve():
            with server.accept()[0] as connection:
                connection.sendall(first)
                said.wait(30.0)
                connection.sendall(line)

        thread = threading.Thread(target=serve)
        thread.start()
        arm = driver.SocketArm("{}:{}".format(*server.getsockname()), ("a",))
        assert arm.read().joint_positions.tolist() == [0.5]
        said.set()
        assert words in lost_words(arm)
        thread.join()
        arm.close()
