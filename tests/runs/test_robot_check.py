"""What is found of a robot before it is moved: streams, where it stands, and whether silence stops it."""

import re
import time

import numpy as np
import pytest
from tests.hardware.wall_clock_arm import WallClockArm

from omniservo.hardware.rtde import RtdeArm
from omniservo.hardware.rtde.server import UrStandIn
from omniservo.robots import ArmMode, CameraImage, load_arm
from omniservo.runs import robot_check
from omniservo.runs.robot_check import check_robot, watchdog_proof

ARM = load_arm("ur5e")
START = np.deg2rad([0.0, -90.0, 90.0, -90.0, -90.0, 0.0])


class Frames:
    """A new image at every tenth of a second, some time ago."""

    def __init__(self, age=0.0, period=0.1):
        self.age, self.period = age, period

    def image(self):
        number = int((time.monotonic() - self.age) / self.period)
        return CameraImage(number * self.period, np.zeros((4, 4), np.uint8))

    def close(self):
        pass


class NoFrames(Frames):
    def image(self):
        return None


def in_protective_stop():
    arm = WallClockArm(START)
    arm.mode = ArmMode.PROTECTIVE_STOP
    return arm


def refused(motion):
    pytest.fail(f"about to {motion}")


def test_an_arm_that_stops_by_itself_is_proven_to():
    asked, arm = [], WallClockArm(START, kept=0.1)
    stood, wrong = watchdog_proof(ARM, arm, asked.append, promised=30.0)
    assert stood >= 0.1
    assert wrong == []
    assert "fall silent" in asked[0]
    turned = np.rad2deg(arm.joints - START)
    assert 0.3 < abs(turned[5]) < 30.0
    assert not turned[:5].any()


def test_an_arm_that_goes_on_for_ever_is_found_out_and_stopped(monkeypatch):
    monkeypatch.setattr(robot_check, "PATIENCE", 0.5)
    arm = WallClockArm(START)
    stood, wrong = watchdog_proof(ARM, arm, lambda motion: None, promised=0.1)
    assert stood >= 0.5
    assert "after the last command; the watchdog promises 0.1 s" in wrong[0]
    assert not arm.speeds.any()


def test_an_arm_that_does_not_move_is_no_proof():
    arm = WallClockArm(START, kept=0.0)
    stood, wrong = watchdog_proof(ARM, arm, lambda motion: None, promised=0.1)
    assert stood is None
    assert re.search(r"was sent by 0\.5 deg and turned by -?0\.0\d deg", wrong[0])


def test_the_stand_in_of_universal_robots_stops_when_commands_cease():
    with UrStandIn(WallClockArm(START)) as server:
        client = RtdeArm(
            server.address, ARM.joint_names, script_port=server.ports.scripts[0],
            dashboard_port=server.ports.dashboard,
        )  # fmt: skip
        try:
            stood, _ = watchdog_proof(ARM, client, lambda motion: None, client.watchdog)
        finally:
            client.close()
    assert stood < robot_check.PATIENCE


@pytest.mark.parametrize(
    ("arm", "frames", "finding"),
    [
        (in_protective_stop(), Frames(), "the arm is in protective stop"),
        (WallClockArm(START), NoFrames(), "no images come"),
        (WallClockArm(START), Frames(age=0.6), "1% of the images are 0."),
        (
            WallClockArm(START + np.deg2rad([0.0, 0.0, 75.0, 0.0, 0.0, 0.0])),
            Frames(),
            "parts of the arm are",
        ),
        (
            WallClockArm(START + np.deg2rad([0.0, 0.0, 1000.0, 0.0, 0.0, 0.0])),
            Frames(),
            "a joint is out of the arm file's range",
        ),
    ],
    ids=["protective stop", "no images", "old images", "another zero", "out of range"],
)
def test_what_is_wrong_is_found_and_nothing_moves(monkeypatch, arm, frames, finding):
    monkeypatch.setattr(robot_check, "SECONDS", 1.2)
    found = check_robot(ARM, arm, frames, refused, None)
    assert any(finding in each for each in found.findings), found.findings
    assert found.stop_seconds is None
    assert not arm.speeds.any()
    assert arm.commands == 0


def test_rates_and_ages_are_those_of_the_streams(monkeypatch):
    monkeypatch.setattr(robot_check, "SECONDS", 1.5)
    found = check_robot(ARM, WallClockArm(START), Frames(age=0.3), refused, None)
    assert found.images.rate == pytest.approx(10.0, rel=0.05)
    assert 0.3 <= found.images.age_median < 10.0
    assert found.self_clearance > 0.0
