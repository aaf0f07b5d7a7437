"""A simulated arm on the wall clock for the drive process: it notes what it is sent, and fails."""

import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import preset
from omniservo.errors import ClockFault, ConnectionLost
from omniservo.robots import Arm, ArmMode, CameraImage
from omniservo.scenes import Dots, Scene, Sensor
from omniservo.simulation import RealTimeRobot

START = np.deg2rad([-0.7, 43.2, -64.6, 0.8, 111.4, 0.3])
MOUNT = RigidTransform.from_components([0, 0, 0.0905], Rotation.from_euler("z", 90, degrees=True))


def scene():
    return Scene(
        arm=Arm.rx60(),
        world_T_base=RigidTransform.from_translation([0, 0, -0.341]),
        flange_T_camera=MOUNT,
        camera=preset("fe185"),
        start_joints=START,
        sensor=Sensor(rate=30, latency=0.02, noise=0.0, blur=0.4),
        dots=Dots(np.array([[0.62, 0.0, 0.5]]), np.array([[-1.0, 0, 0]]), 0.008),
        boards=(),
        floor=None,
    )


class FaultyArm:
    """What stands in the file ``fault`` goes wrong from then on; ``log`` gets every command and its time."""

    watchdog = 0.1

    def __init__(self, folder):
        self.folder = Path(folder)
        self.robot = RealTimeRobot(replace(scene(), start_joints=self.start()), rendered=False)
        self.clock_was_set = False
        self.log = (self.folder / "log").open("a", buffering=1)
        self.frozen = None
        self.note("open", ())

    def start(self):
        return START

    def note(self, what, numbers):
        self.log.write(f"{time.monotonic():.6f} {what} {' '.join(f'{x:.9g}' for x in numbers)}\n")

    @property
    def fault(self):
        try:
            return (self.folder / "fault").read_text()
        except FileNotFoundError:
            return ""

    def refuse(self):
        """Refuse everything once its clock was set, as a line whose listening has ended."""
        self.clock_was_set |= self.fault == "clock_set"
        if self.clock_was_set:
            raise ClockFault("the sender's clock went ahead by 1.000 s")

    def read(self):
        self.refuse()
        fault, state = self.fault, self.robot.read()
        if fault != "frozen":
            self.frozen = state
        modes = {"protective_stop": ArmMode.PROTECTIVE_STOP, "emergency_stop": ArmMode.EMERGENCY_STOP}
        modes["not_in_control"] = ArmMode.NOT_IN_CONTROL
        self.robot.set_mode(modes.get(fault, ArmMode.READY))
        if fault == "lost":
            raise ConnectionLost("the cable is out")
        if fault == "frozen":
            return self.frozen
        if fault == "nan":
            return replace(state, joint_positions=np.full(6, np.nan))
        if fault == "reordered":
            return replace(state, joint_positions=state.joint_positions[::-1])
        if fault == "short":
            return replace(state, joint_positions=np.zeros(5), joint_velocities=np.zeros(5))
        if fault == "timeless":
            return replace(state, time=None)
        if fault == "other_mode":
            return replace(state, mode="running")
        if fault == "clock_back":
            return replace(state, time=state.time - 1.0)
        if fault == "clock_ahead":
            return replace(state, time=state.time + 1.0)
        return replace(state, mode=modes.get(fault, ArmMode.READY))

    def command(self, velocities):
        self.refuse()
        self.note("command", velocities)
        other = [0.2, 0, 0, 0, 0, 0] if self.fault == "second_commander" else np.zeros(6)
        self.robot.command(np.asarray(velocities) + other)

    def stop(self):
        self.note("stop", ())
        self.robot.stop()
        self.refuse()

    def close(self):
        """Note how fast it is once its drives have done what they were sent last, if they ever do."""
        end = time.monotonic() + 0.5
        while np.abs(self.robot.read().joint_velocities).max() > 1e-3 and time.monotonic() < end:
            time.sleep(2e-3)
        self.note("close", self.robot.read().joint_velocities)
        self.robot.close()
        self.log.close()


class Staying(FaultyArm):
    """Opened again, it stands where it was closed."""

    def start(self):
        place = self.folder / "joints.npy"
        return np.load(place) if place.exists() else START

    def close(self):
        np.save(self.folder / "joints.npy", self.robot.read().joint_positions)
        super().close()


class Unwatched(FaultyArm):
    watchdog = None


class Renamed(FaultyArm):
    joint_names = ("j2", "j1", "j3", "j4", "j5", "j6")


class Nowhere:
    def __init__(self, address):
        raise ConnectionLost(f"{address}: nobody answers")


class Clockwork:
    """A camera that has a new frame thirty times a second, until it is told to stand."""

    def __init__(self):
        self.standing, self.number = False, 0
        self.begin = time.monotonic()

    def image(self):
        if not self.standing:
            self.number = int((time.monotonic() - self.begin) * 30)
        return CameraImage(self.begin + self.number / 30, np.zeros((2, 2), dtype=np.uint8))

    def close(self):
        pass


def log_of(folder):
    """Return [(time, what, numbers)] that reached the arm."""
    lines = (Path(folder) / "log").read_text().splitlines()
    return [(float(t), what, [float(x) for x in rest]) for t, what, *rest in map(str.split, lines)]
