"""A whole job on rendered pictures, all of them sent through the interface, against the true camera.

Three processes: the simulated arm and its camera behind RTDE and MJPEG, the drive, and this one, which sees,
plans and tracks. First `omniservo robot delay` measures how late the images are: when they were exposed is
not told. What is measured is the distance of the true camera at each image's exposure to the place on
the plan's way where the reference then was, beside the same job in simulated time, and how far what the run
takes for the exposures is off them (`benchmarks.stamp_errors` says what that does).
``python -m benchmarks.real_loop --pictured TASK`` prints it; ``--serve`` is the first process.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.recording import RecordedRun, RunRecording
from omniservo.recording.recorded_messages import StepMessage
from omniservo.results import RunResult
from omniservo.runs import run_task, teach_goal
from omniservo.runs.open_hardware import open_hardware
from omniservo.runs.robot_records import stored_delay
from omniservo.simulation import SimulatedCell
from omniservo.simulation.sim_server import serve
from omniservo.tasks import Task, load_robot, load_task

LOOK = 2e-3
"""The true joints are noted so often [s]."""


def serve_until(file: Path, task: Task) -> None:
    """Serve a task until the file ``end`` is there; then leave times and true joints, and all exposures."""
    noted, exposures = [], [0.0]
    with serve(task, "rtde", free_ports=True) as there:
        (file / "robot.tmp").write_text(there.robot_file)
        (file / "robot.tmp").rename(file / "robot.yaml")
        while not (file / "end").exists():
            state = there.robot.read()
            noted.append([state.time, *state.joint_positions])
            image = there.robot.image()
            if image is not None and image.time > exposures[-1]:
                exposures.append(image.time)
            time.sleep(LOOK)
    np.save(file / "exposures.npy", np.array(exposures))
    np.save(file / "truth.tmp.npy", np.array(noted))
    (file / "truth.tmp.npy").rename(file / "truth.npy")


def off_the_way(result: RunResult, places: FloatArray) -> FloatArray:
    """Return how far the camera's places (n, 3) [m], initial frame, were from the reference [mm]."""
    if result.plan is None or result.plan.path is None:
        raise AssertionError("no path")
    path = result.plan.path
    wanted = np.array([path(float(w)).translation for w in result.log.column("w")])
    distances: FloatArray = 1e3 * np.linalg.norm(places - wanted, axis=1)
    return distances


@contextmanager
def served(place: Path, name: str) -> Iterator[subprocess.Popen[bytes]]:
    """Have a task served by the first process, which ends with the block."""
    server = subprocess.Popen([sys.executable, "-m", "benchmarks.pictured_run", "--serve", str(place), name])
    try:
        while not (place / "robot.yaml").exists():
            assert server.poll() is None
            time.sleep(0.05)
        yield server
    finally:
        server.kill()
        server.wait()


def on_the_wall_clock(name: str) -> tuple[FloatArray, FloatArray, RunResult]:
    """Return the distances [mm] of a job over processes, how far its stamps were off [ms], and its result."""
    task = load_task(name)
    with closing(SimulatedCell(task, 1)) as taught:
        goal = teach_goal(task, taught)
    with tempfile.TemporaryDirectory() as folder, served(Path(folder), name) as server:
        place = Path(folder)
        file = place / "robot.yaml"
        omniservo = [sys.executable, "-m", "omniservo.cli.main"]
        subprocess.run([*omniservo, "robot", "delay", str(file), "--yes", "--quiet"], check=True)
        robot = load_robot(file)
        delay = stored_delay(file, robot)
        begun, cell = open_hardware(task, robot, lambda motion: None, delay=delay)
        with closing(cell), RunRecording(place / "r.mcap") as recording:
            result = run_task(begun, lambda task, seed: cell, goal=goal, filmed=False, recording=recording)
        (place / "end").touch()
        server.wait()
        truth, exposures = np.load(place / "truth.npy"), np.load(place / "exposures.npy")
        steps = [e.message for e in RecordedRun(place / "r.mcap") if hasattr(e, "message")]
        times = [m.image_time for m in steps if isinstance(m, StepMessage)]
    joints = np.column_stack([np.interp(times, truth[:, 0], column) for column in truth[:, 1:].T])
    initial = cell.scene.world_T_camera(cell.scene.start_joints).inv()
    places = np.array([(initial * cell.scene.world_T_camera(q)).translation for q in joints])
    nearest = np.abs(np.subtract.outer(times, exposures)).argmin(axis=1)
    return off_the_way(result, places), 1e3 * (np.array(times) - exposures[nearest]), result


def pictured_row(name: str) -> str:
    """Return a row of the table."""
    reference = run_task(load_task(name), SimulatedCell, filmed=False)
    simulated = off_the_way(reference, reference.log.column("true_position"))
    found, off, result = on_the_wall_clock(name)
    figures = " | ".join(f"{np.sqrt((x**2).mean()):.2f} / {x.max():.2f}" for x in (simulated, found))
    end = result.log.stop_reason or "goal"
    stamps = f"{off.mean():+.1f} ± {off.std():.1f}"
    return f"| {name} | {len(found)} | {figures} | {stamps} | {end} | {os.getloadavg()[0]:.0f} |"


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--serve", nargs=2, metavar=("FOLDER", "TASK"))
    asked = parser.parse_args()
    serve_until(Path(asked.serve[0]), load_task(asked.serve[1]))
