"""Every shipped task with a cheap camera: does it converge, or stop by name?

Run: ``python -m benchmarks.cheap_cameras [--exposure MS] [--readout MS] [--jpeg QUALITY] [TASK …]``. Each
task is run by `run_task` in the simulator, seed 0, without film, with the sensor of the printed line:
exposure and rolling shutter, JPEG, shot noise and dark noise, a little defocus and vignetting, and a latency
that leaves time for reading. "Moves" is the largest motion of any followed point during the exposure and
during the readout, by the true pixels of the log.
"""

from __future__ import annotations

import argparse

import numpy as np
from benchmarks.tables import print_table

from omniservo.errors import OmniservoError
from omniservo.results import RunLog
from omniservo.runs import run_task
from omniservo.simulation import SimulatedCell
from omniservo.tasks import Task, load_task, shipped_tasks
from omniservo.tasks.sensor import SensorSection

CHEAP = SensorSection(
    latency=0.04, noise=1.5, gain=0.05, blur=0.5, defocus=0.7, vignetting=0.3,
    exposure=0.010, readout=0.020, jpeg=80,
)  # fmt: skip
"""A rolling shutter of 20 ms, 10 ms of exposure, 5 100 electrons at white."""

HEAD = (
    "| task | end | position [mm] | rotation [deg] | at the goal [px] | moves in exposure [px] | "
    "in readout [px] | lasts [s] |"
)


def with_sensor(task: Task, sensor: SensorSection) -> Task:
    """Return the task with another sensor, of the same rate."""
    return task.model_copy(update={"sensor": sensor.model_copy(update={"rate": task.sensor.rate})})


def fastest(log: RunLog) -> float:
    """Return the largest speed of a followed point in the image, between two frames [px/s]."""
    pixels = log.column("true_pixels")
    pixels = pixels.reshape(len(pixels), -1, 2)
    moved = np.linalg.norm(np.diff(pixels, axis=0), axis=2)
    return float(np.nanmax(moved / np.diff(log.column("time"))[:, None]))


def row_of(name: str, sensor: SensorSection) -> str:
    """Run a task; return its row."""
    task = with_sensor(load_task(name), sensor)
    try:
        result = run_task(task, SimulatedCell, filmed=False)
    except OmniservoError as refused:
        return f"{name} | {type(refused).__name__}: {refused} | | | | | | "
    metrics = result.metrics
    position = 1e3 * float(metrics["final_translation_error_m"])
    turn = np.rad2deg(float(metrics["final_rotation_error_rad"]))
    speed = fastest(result.log)
    end = f"{result.log.stop_reason}: {metrics['reason']}" if result.log.stop_reason else metrics["status"]
    return (
        f"{name} | {end} | {position:.2f} | {turn:.3f} | {float(metrics['final_error_px']):.2f} | "
        f"{speed * sensor.exposure:.1f} | {speed * sensor.readout:.1f} | {metrics['servo_seconds']:.1f}"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("tasks", nargs="*", default=shipped_tasks())
    parser.add_argument("--exposure", type=float, default=1e3 * CHEAP.exposure, help="[ms]")
    parser.add_argument("--readout", type=float, default=1e3 * CHEAP.readout, help="[ms]")
    parser.add_argument("--jpeg", type=int, default=CHEAP.jpeg)
    given = parser.parse_args()
    update = {"exposure": 1e-3 * given.exposure, "readout": 1e-3 * given.readout, "jpeg": given.jpeg}
    sensor = SensorSection.model_validate(CHEAP.model_dump() | update)
    print(", ".join(f"{name} {value:g}" for name, value in sensor.model_dump().items() if value is not None))
    print()
    print_table(HEAD, (row_of(name, sensor) for name in given.tasks))


if __name__ == "__main__":
    main()
