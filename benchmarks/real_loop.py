"""The loop over real processes on the wall clock: tracking error and late ticks.

Run: ``python -m benchmarks.real_loop [--runs N] [--life S] [--pictured TASK]``. Three processes:
this one looks at projected points (0.03 px of noise) and tracks a path of 4 s; the drive process commands;
the arm is simulated in the third (`benchmarks.mapped_arm`). The error is the distance of the true camera, at
the exposures of all frames until it was stopped, to the plan at the same time, beside the same loop in
simulated time behind the same delays and losses of images. The least delay of the images' line is taken as
known, as `robot delay` finds it; offset, drift and jitter are not. `benchmarks.pictured_run` is a job on
rendered pictures. The machine's load is printed with every row: on a busy machine all of it is worse.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
from benchmarks.mapped_arm import (
    MOUNT,
    NEWEST,
    RATE,
    RUN,
    MappedArm,
    frame,
    mapped,
    scene,
    targets,
)
from benchmarks.pictured_run import pictured_row
from scipy.spatial.transform import Rotation

from omniservo.cameras import preset
from omniservo.drive import COMMAND_LIFE, ArmOpener, DriveClient
from omniservo.geometry.arrays import BoolArray, ByteArray, FloatArray
from omniservo.hardware import ClockMap, FaultyLine, LinkFaults
from omniservo.planning import CameraPath, Plan, PlanningProblem
from omniservo.robots import Arm, CameraImage
from omniservo.safety import SafetyOptions, Step, Supervisor, VisibilityFilter, servo
from omniservo.servoing import RestToRestLaw, TimeLaw
from omniservo.simulation import SimulatedRobot
from omniservo.simulation.world import TICK
from omniservo.tracking import PathTracker, TrackerOptions

NOISE = 0.03
"""[px]"""
PACE = RestToRestLaw(4.0)
OPTIONS = SafetyOptions(image_age=0.4, joint_age=0.25, reaction=0.25)
"""limits of a machine that does much besides; deadlines stay as they are"""
LINES = {
    "0 ms": LinkFaults(),
    "33 ms": LinkFaults(0.033),
    "100 ms": LinkFaults(0.1),
    "150 ms": LinkFaults(0.15),
    "100 ms, clock + 1 s, 100 ppm": LinkFaults(0.1, clock_offset=1.0, drift_ppm=100.0),
    "60 ± 30 ms, 5% lost, clock - 1 s": LinkFaults(0.06, 0.03, 0.05, -1.0, -100.0, seed=1),
}


class Points:
    """Images are joints; where they show the points is what is found in them."""

    def __init__(self, seed: int = 0) -> None:
        self._world = scene()
        self._random = np.random.default_rng(seed)
        self.joints = self._world.start_joints
        self.points = self._world.world_T_camera(self.joints).inv().apply(targets())

    def update(self, image: ByteArray, predicted_pixels: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return the points' pixels and which there are."""
        camera = self._world.world_T_camera(self.joints)
        pixels, valid = self._world.camera.project(camera.inv().apply(targets()))
        return pixels + NOISE * self._random.standard_normal(pixels.shape), valid & np.isfinite(
            predicted_pixels[:, 0]
        )


class MappedCamera:
    """The frames of the mapped arm behind a line with faults, on this machine's clock."""

    def __init__(self, shared: FloatArray, faults: LinkFaults, points: Points) -> None:
        self._shared, self._points = shared, points
        self._line: FaultyLine[tuple[float, FloatArray]] = FaultyLine(faults)
        self._clocks, self._least = ClockMap(), max(faults.latency - faults.jitter, 0.0)
        self._number = int(shared[NEWEST])
        self._image: CameraImage | None = None

    def image(self) -> CameraImage | None:
        """Return the newest frame that arrived."""
        now = time.monotonic()
        newest = self.newest()
        for number in range(self._number, newest):
            self._line.put(frame(self._shared, number), frame(self._shared, number)[0])
        self._number = newest
        for exposed, joints in self._line.due(now):
            stamp = self._clocks.monotonic(self._line.stamp(exposed), now) - self._least
            self._image, self._points.joints = CameraImage(stamp, np.zeros((2, 2), dtype=np.uint8)), joints
        return self._image

    def newest(self) -> int:
        """Return how many frames have come."""
        return int(self._shared[NEWEST])

    def close(self) -> None:
        """Nothing is open."""


class SimulatedCamera:
    """The simulator's frames behind the same delays and losses, with the joints that they show."""

    def __init__(self, robot: SimulatedRobot, points: Points, faults: LinkFaults | None = None) -> None:
        self._robot, self._points = robot, points
        told = replace(faults or LinkFaults(), clock_offset=0.0, drift_ppm=0.0)
        self._line: FaultyLine[CameraImage] = FaultyLine(told, robot.time)
        self._sent, self._image = -np.inf, None

    def image(self) -> CameraImage | None:
        """Return the newest delivered frame."""
        exposed = self._robot.image()
        if exposed is not None and exposed.time > self._sent:
            self._sent = exposed.time
            self._line.put(exposed, exposed.time)
        for image in self._line.due(self._robot.time):
            self._image = image
            self._points.joints = self._robot.exposure(image.time)[0]
        return self._image

    def close(self) -> None:
        """Nothing is open."""


def tracker_of(points: Points, stated: float, law: TimeLaw = PACE) -> PathTracker:
    """Return what follows a path that bends and turns."""
    turn = Rotation.from_rotvec([0.05, -0.12, 0.1]).as_quat()
    still = np.array([0.0, 0.0, 0.0, 1.0])
    bend = np.array([0.03, 0.03, 0.01])
    rotation = np.column_stack((turn - still, still))
    rotation = np.column_stack((np.zeros(4), rotation))
    path = CameraPath(rotation, np.column_stack((bend, np.array([0.06, -0.08, 0.1]) - bend, np.zeros(3))))
    problem = PlanningProblem(preset("fe185"), points.points, path(1.0))
    plan = Plan(problem, "undecided", path, None, 0.0, "certified", "it was made by hand")
    options = TrackerOptions(delay=stated + 0.5 / RATE)
    return PathTracker(plan, scene().camera, options=options, time_law=law)


def distances(tracker: PathTracker, frames: list[tuple[float, FloatArray]], start: float) -> FloatArray:
    """Return how far the true camera was from the plan while it moved [mm]."""
    world, leg = scene(), tracker.legs[0]
    initial = world.world_T_camera(world.start_joints).inv()
    found = [
        1e3
        * np.linalg.norm(
            (initial * world.world_T_camera(q)).translation - leg.path(leg.w(t - start)[0]).translation
        )
        for t, q in frames
        if 0.0 <= t - start <= 4.0
    ]
    return np.array(found)


def in_simulated_time(faults: LinkFaults, stated: float) -> FloatArray:
    """Return the distances of the same loop where time stands still while it computes [mm]."""
    points, robot = Points(), SimulatedRobot(scene(), rendered=False)
    camera = SimulatedCamera(robot, points, faults)
    supervisor = Supervisor(robot, Arm.rx60(), MOUNT, camera=camera, wait=robot.advance, options=OPTIONS)
    while supervisor.image() is None:
        robot.advance(TICK)
    tracker, starts = tracker_of(points, stated), list[float]()
    frames: list[tuple[float, FloatArray]] = []

    def note(step: Step) -> None:
        starts.append(step.image.time - step.time)
        frames.append((step.image.time, robot.exposure(step.image.time)[0]))

    stop = servo(
        supervisor,
        tracker,
        points,
        VisibilityFilter(scene().camera),
        time_limit=8.0,
        on_step=note,
    )
    assert stop is None, stop
    return distances(tracker, frames, starts[0])


@contextmanager
def mapped_file() -> Iterator[tuple[FloatArray, str]]:
    """Give what an arm's process shares with others, and the file's name."""
    with tempfile.TemporaryDirectory() as folder:
        file = str(Path(folder) / "arm")
        np.zeros(64 + 8 * 4096).tofile(file)
        shared = mapped(file)
        shared[RUN] = 1.0
        yield shared, file


@contextmanager
def served() -> Iterator[tuple[FloatArray, str]]:
    """Have an arm in a process of its own; give what is shared with it, and the file's name."""
    with mapped_file() as (shared, file):
        process = subprocess.Popen([sys.executable, "-m", "benchmarks.mapped_arm", file])
        try:
            until(lambda: shared[NEWEST] > 3, 60.0)
            yield shared, file
        finally:
            shared[RUN] = 0.0
            process.wait(30.0)


def until(holds: Callable[[], bool], seconds: float) -> bool:
    """Wait until something holds, or for so long [s]; return whether it does."""
    end = time.monotonic() + seconds
    while not holds():
        if time.monotonic() > end:
            return False
        time.sleep(2e-3)
    return True


def over_processes(faults: LinkFaults, stated: float, life: float) -> tuple[FloatArray, float, str]:
    """Return distances [mm], the share of ticks late by > 5 ms, and how it ended."""
    points = Points()
    with served() as (shared, file):
        camera = MappedCamera(shared, faults, points)
        opener = ArmOpener(MappedArm, {"file": file})
        client = DriveClient(
            opener, Arm.rx60(), MOUNT, camera=camera, options=OPTIONS, command_life=life
        )  # fmt: skip
        with closing(client):
            client.enable()
            until(lambda: client.image() is None, 2.0)  # offset and drift become known
            tracker, starts, first = tracker_of(points, stated), [], int(shared[NEWEST])
            begin, late = time.monotonic(), client.status.late_ticks
            stop = servo(
                client, tracker, points, VisibilityFilter(scene().camera), time_limit=8.0,
                on_step=lambda step: starts.append(step.image.time - step.time),
            )  # fmt: skip
            ended = time.monotonic() - 0.5  # in which it settles
            ticks = (time.monotonic() - begin) / 5e-3
            late = client.status.late_ticks - late
        frames = [frame(shared, k) for k in range(first, int(shared[NEWEST]))]
        frames = [each for each in frames if each[0] < ended]  # of one that was stopped, until then
    found = distances(tracker, frames, starts[0]) if starts else np.full(1, np.nan)
    return found, late / ticks, "goal" if stop is None else f"{stop.reason}: {stop}"


def main() -> None:
    """Print the table, or that of rendered pictures."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--runs", type=int, default=1)
    parser.add_argument("--life", type=float, default=COMMAND_LIFE, help="of a command [s]")
    parser.add_argument("--pictured", metavar="TASK", help="rendered pictures instead, all sent as MJPEG")
    asked = parser.parse_args()
    if asked.pictured:
        heads = "images | simulated rms / max [mm] | rms / max [mm] | stamps off [ms] | end | load"
        print(f"| pictures by MJPEG | {heads} |\n|---|---|---|---|---|---|---|")
        for _ in range(asked.runs):
            print(pictured_row(asked.pictured), flush=True)
        return
    print("| line | told | simulated rms / max [mm] | processes rms / max [mm] | late ticks | end | load |")
    print("|---|---|---|---|---|---|---|")
    for name, faults in LINES.items():
        for stated in {faults.latency, 0.033}:
            reference = in_simulated_time(faults, stated)
            for _ in range(asked.runs):
                found, late, end = over_processes(faults, stated, asked.life)
                figures = " | ".join(
                    f"{np.sqrt((x**2).mean()):.2f} / {x.max():.2f}" for x in (reference, found)
                )
                print(
                    f"| {name} | {1e3 * stated:.0f} ms | {figures} | {100 * late:.2f}% | {end} | "
                    f"{os.getloadavg()[0]:.0f} |", flush=True,
                )  # fmt: skip


if __name__ == "__main__":
    main()
