"""Images that are late by other than was measured: does a run notice, and what does it do until then?

Run: ``python -m benchmarks.wrong_delay [--off MS …] [--latency MS] [--law LAW] [TASK …]``. Each task is run
by `run_task` in the simulator, seed 0, its images stamped wrongly by so much, as if that much of the camera's
offset had been measured wrongly (by ± 1 ms, as stated). Tracking error: distance of the true camera, at the
exposures of the images while it was on its way, to where the path has it then; beforehand, where the run was
stopped. "Seen" is what the watch had estimated at the end; "check" is processor time for one image, median
and most.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from time import process_time

import numpy as np
from benchmarks.tables import print_table
from scipy.spatial.transform import RigidTransform

from omniservo.cameras.models import CentralModel
from omniservo.errors import OmniservoError
from omniservo.geometry.arrays import FloatArray
from omniservo.results import RunResult
from omniservo.robots import Arm, CameraImage
from omniservo.runs import run_task
from omniservo.runs.safety_of_task import safety_of_task
from omniservo.safety import SafetyOptions, Supervisor, closed_loop, delay_watch
from omniservo.safety.motion_history import MotionHistory
from omniservo.safety.seen_points import SeenPoints
from omniservo.simulation import SimulatedCell, SimulatedRobot
from omniservo.simulation.simulated_cell import true_scene
from omniservo.simulation.simulated_robot import TICK
from omniservo.simulation.simulated_truth import SimulatedTruth
from omniservo.tasks import Task, load_task, shipped_tasks

SIGMA = 1e-3
"""of the offset, as stated [s]"""

HEAD = "| task | off [ms] | end | after [s] | tracking rms / max [mm] | seen [ms] | check [ms] |"

WATCHES: list[delay_watch.DelayWatch] = []


class NotedWatch(delay_watch.DelayWatch):
    """A watch that is looked at afterwards."""

    def __init__(
        self, camera: CentralModel, arm: Arm, flange_T_camera: RigidTransform, options: SafetyOptions
    ) -> None:
        super().__init__(camera, arm, flange_T_camera, options)
        self.seconds: list[float] = []
        WATCHES.append(self)

    def check(self, found: SeenPoints, history: MotionHistory) -> None:
        """Take an image in; note the processor's time."""
        before = process_time()
        try:
            super().check(found, history)
        finally:
            self.seconds.append(process_time() - before)


class WrongStamps(SimulatedRobot):
    """A robot whose images are stamped wrongly."""

    off = 0.0

    def image(self) -> CameraImage | None:
        """Return the newest frame, at the wrong time."""
        image = super().image()
        return None if image is None else replace(image, time=image.time + self.off)

    def world_T_camera(self, time: float) -> RigidTransform:
        """Return the pose at the frame of this stamp."""
        return super().world_T_camera(round((time - self.off) / TICK) * TICK)


class WrongCell(SimulatedCell):
    """The simulator's cell with wrong stamps, and a supervisor that was told that they are right."""

    def __init__(self, task: Task, seed: int, off: float) -> None:
        super().__init__(task, seed)
        self.robot = WrongStamps(true_scene(task, self.scene), seed=seed)
        self.robot.off = off
        self.truth = SimulatedTruth(self.robot)
        self._task, self._supervisor = task, None

    @property
    def drive(self) -> Supervisor | None:  # type: ignore[override]
        """What commands the arm."""
        if self._supervisor is None:
            self._supervisor = Supervisor(
                self.robot, self.scene.arm, self.scene.flange_T_camera, camera=self.robot,
                wait=self.robot.advance, options=replace(safety_of_task(self._task), offset_sigma=SIGMA),
            )  # fmt: skip
        return self._supervisor


def tracking(result: RunResult) -> FloatArray:
    """Return how far the true camera was from the path on its way [mm]."""
    w, places = result.log.column("w"), result.log.column("true_position")
    on = (w > 0.0) & (w < 1.0)
    if result.way is None or not on.any():
        return np.full(1, np.nan)
    return np.asarray(1e3 * np.linalg.norm(places[on] - result.way.poses(w[on]).translation, axis=1))


def changed(task: Task, latency: float | None, law: str | None) -> Task:
    """Return a task with images that are so old [s], and with another time law."""
    if latency is not None:
        task = task.model_copy(update={"sensor": task.sensor.model_copy(update={"latency": latency})})
    if law is not None:
        servo = task.servo.model_copy(update={"time_law": law, "duration": None})
        task = task.model_copy(update={"servo": servo})
    return task


def row_of(task: Task, off: float) -> str:
    """Run a task; return its row."""
    WATCHES.clear()
    name = task.name
    try:
        result = run_task(task, lambda task, seed: WrongCell(task, seed, off), filmed=False)
    except OmniservoError as refused:
        return f"{name} | {1e3 * off:+.0f} | {type(refused).__name__}: {str(refused)[:80]} | | | | "
    found, seen = tracking(result), WATCHES[-1]
    end = result.log.stop_reason or str(result.metrics["status"])
    return (
        f"{name} | {1e3 * off:+.0f} | {end} | {result.log.rows[-1].time:.2f} | "
        f"{np.sqrt(np.mean(found**2)):.2f} / {found.max():.2f} | "
        f"{1e3 * seen.offset:+.1f} ± {1e3 * seen.sigma:.1f} | "
        f"{1e3 * np.median(seen.seconds):.1f} / {1e3 * max(seen.seconds):.1f}"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tasks", nargs="*", default=shipped_tasks())
    parser.add_argument("--off", type=float, nargs="+", default=[0.0, 30.0, -30.0, 67.0, -67.0], help="[ms]")
    parser.add_argument("--latency", type=float, help="of the images [ms]; the task's where nothing is said")
    parser.add_argument("--law", choices=["rest-to-rest", "time-optimal", "exponential"], help="time law")
    given = parser.parse_args()
    closed_loop.DelayWatch = NotedWatch  # type: ignore[misc]
    latency = None if given.latency is None else 1e-3 * given.latency
    tasks = (changed(load_task(name), latency, given.law) for name in given.tasks)
    rows = (row_of(task, 1e-3 * off) for task in tasks for off in given.off)
    print_table(HEAD, rows)


if __name__ == "__main__":
    main()
