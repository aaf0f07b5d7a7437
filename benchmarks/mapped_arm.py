"""An arm and a camera in a process of their own, reached through a file that is mapped into memory.

``python -m benchmarks.mapped_arm FILE``: the arm of `scene`, on the wall clock. It brakes by itself when no
command came for `WATCHDOG`.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import preset
from omniservo.geometry.arrays import FloatArray
from omniservo.robots import Arm, ArmMode, RobotState
from omniservo.scenes import Dots, Scene, Sensor
from omniservo.simulation import SimulatedRobot

START = np.deg2rad([-0.7, 43.2, -64.6, 0.8, 111.4, 0.3])
MOUNT = RigidTransform.from_components([0, 0, 0.0905], Rotation.from_euler("z", 90, degrees=True))
RATE = 30.0
WATCHDOG = 0.1
"""[s]"""
MOVES = 0.01
"""A joint that turns faster moves [rad/s]."""

_FRAMES = 4096
# places in the mapped file
RUN, FAULT, COUNT, COMMAND = 0, 1, 2, 3
STOPPED, AFTER, SINCE, BRAKING, DRIVE, RESTED = 10, 11, 12, 13, 14, 15
SEQUENCE, STATE = 20, 21
NEWEST, MOVED = 40, 41
_EXPOSED = 64

JOINTS_FROZEN, ALL_FROZEN = "joints frozen", "joints and images frozen"
NAN, REORDERED = "joints NaN", "joints reordered"
MODES = {"protective stop": ArmMode.PROTECTIVE_STOP, "not in control": ArmMode.NOT_IN_CONTROL}
STEPS = {"clock 1 s back": -1.0, "clock 1 s ahead": 1.0}
"""[s]"""
IMAGES_FROZEN, IMAGES_STALE = "images frozen", "images stale, then fresh"
NAMES_REORDERED, RENAMED, SECOND = "names reordered", "a joint renamed", "second commander"
FAULTS = (
    JOINTS_FROZEN, IMAGES_FROZEN, ALL_FROZEN, IMAGES_STALE, NAN, REORDERED, *STEPS, *MODES,
    NAMES_REORDERED, RENAMED, SECOND,
)  # fmt: skip
"""what FAULT names, counted from 1"""


def fault(shared: FloatArray) -> str:
    """Return which fault there is; empty: none."""
    number = int(shared[FAULT])
    return FAULTS[number - 1] if number else ""


def targets() -> FloatArray:
    """Return nine points of a wall (9, 3) in the world [m]."""
    y, z = np.meshgrid([-0.2, -0.1, 0.0], [0.4, 0.5, 0.6])
    return np.stack([np.full(9, 0.62), y.ravel(), z.ravel()], axis=-1)


def scene(latency: float = 0.0) -> Scene:
    """Return the world."""
    points = targets()
    return Scene(
        arm=Arm.rx60(),
        world_T_base=RigidTransform.from_translation([0, 0, -0.341]),
        flange_T_camera=MOUNT,
        camera=preset("fe185"),
        start_joints=START,
        sensor=Sensor(rate=RATE, latency=latency, noise=0.0, blur=0.4),
        dots=Dots(points, np.tile([-1.0, 0, 0], (len(points), 1)), 0.008),
        boards=(),
        floor=None,
    )


def mapped(file: str | Path) -> FloatArray:
    """Return the numbers that all processes share."""
    return np.asarray(np.memmap(file, dtype=np.float64, mode="r+", shape=(_EXPOSED + 8 * _FRAMES,)))


def serve(file: str) -> None:
    """Move the arm on the wall clock until RUN is 0."""
    world = scene()
    shared, robot, begin = mapped(file), SimulatedRobot(world, rendered=False), time.monotonic()
    count = frames = 0
    last_command, shown = begin, -1.0
    while shared[RUN]:
        now = time.monotonic()
        if shared[COUNT] != count:
            count, last_command = shared[COUNT], now
            robot.command(shared[COMMAND : COMMAND + 6].copy())
        elif now - last_command > WATCHDOG:
            robot.stop()
        robot.advance(max(now - begin - robot.time, 0.0))
        state = robot.read()
        shared[SEQUENCE] += 1
        shared[STATE : STATE + 13] = begin + state.time, *state.joint_positions, *state.joint_velocities
        shared[SEQUENCE] += 1
        if np.abs(state.joint_velocities).max() > MOVES:
            shared[MOVED] = begin + state.time
        if shared[SINCE]:
            brakes = float(np.max(np.abs(state.joint_velocities) / world.arm.joint_acceleration))
            shared[BRAKING] = max(shared[BRAKING], brakes)
        exposure = robot.newest_exposure()
        if exposure is not None and exposure.time != shown:
            shown = exposure.time
            row = _EXPOSED + 8 * (frames % _FRAMES)
            shared[row : row + 7] = begin + shown, *exposure.joints
            frames += 1
            shared[NEWEST] = frames
        time.sleep(1e-3)


def frame(shared: FloatArray, number: int) -> tuple[float, FloatArray]:
    """Return when a frame was exposed [s], and the joints (6,) then [rad]."""
    row = _EXPOSED + 8 * (number % _FRAMES)
    return float(shared[row]), np.array(shared[row + 1 : row + 7])


class MappedArm:
    """The `ArmDriver` of it, with the faults that FAULT names."""

    watchdog = WATCHDOG

    def __init__(self, file: str) -> None:
        self._shared = mapped(file)
        self._kept: RobotState | None = None

    def read(self) -> RobotState:
        """Return the newest state."""
        now = fault(self._shared)
        if now in (JOINTS_FROZEN, ALL_FROZEN) and self._kept is not None:
            return self._kept
        while True:
            before = self._shared[SEQUENCE]
            row = np.array(self._shared[STATE : STATE + 13])
            if before % 2 == 0 and self._shared[SEQUENCE] == before:
                break
        positions, velocities = row[1:7], row[7:]
        if now == REORDERED:
            positions, velocities = positions[::-1], velocities[::-1]
        positions = np.full(6, np.nan) if now == NAN else positions
        mode = MODES.get(now, ArmMode.READY)
        self._kept = RobotState(row[0] + STEPS.get(now, 0.0), positions, velocities, mode)
        return self._kept

    def command(self, joint_velocities: npt.ArrayLike) -> None:
        """Pass a command on; one that moves the arm after it was told to stop, or rested, is counted."""
        wanted = np.asarray(joint_velocities)
        self.count(wanted)
        self._shared[COMMAND : COMMAND + 6] = wanted
        self._shared[COUNT] += 1

    def count(self, wanted: FloatArray) -> None:
        """Count a command of motion that comes too late."""
        over = self._shared[STOPPED] or self._shared[RESTED]
        self._shared[AFTER] += bool(over and wanted.any())

    def stop(self) -> None:
        """Brake."""
        self._shared[STOPPED] = 1.0
        self._shared[COMMAND : COMMAND + 6] = 0.0
        self._shared[COUNT] += 1

    def close(self) -> None:
        """Nothing is open."""


if __name__ == "__main__":
    serve(sys.argv[1])
