"""The table *paper / here*: ``make bench`` prints it from measurements made now, on this machine.

Warm: kernels compiled and called before. Times are medians; the machine's other load adds to them.
"""

from __future__ import annotations

import os
import platform
from collections.abc import Iterator

import numpy as np
from benchmarks.control_speed import control_step_microseconds
from benchmarks.perception_accuracy import dot_centres, matching
from benchmarks.planning_speed import kernel_microseconds, public_microseconds
from benchmarks.rendering_speed import frames_per_second
from benchmarks.replanning_speed import kernel_microseconds as replanning_microseconds
from benchmarks.whole_job import StageTimes, stage_times, whole_run

from omniservo.results.run_result import RunResult

Row = tuple[str, str, str, str]
"""quantity, paper, target, here"""

TASKS = ("paper-example-1", "paper-example-2")


def rows() -> Iterator[Row]:
    """Measure and give one row after the other."""
    runs = [whole_run(name) for name in TASKS]
    times = [stage_times(run) for run in runs]
    yield from _run_rows(runs)
    yield from _perception_rows()
    yield from _time_rows(times)


def _run_rows(runs: list[RunResult]) -> Iterator[Row]:
    for run, paper, asked in zip(runs, ("66.127", "82.249"), ("≥ 55", "≥ 70"), strict=True):
        m = run.metrics
        here = f"certified {_mm(m['clearance_planned_m'])}, executed {_mm(m['clearance_executed_m'])}"
        yield f"{run.task.name}: smallest distance to the paper's points [mm]", paper, asked, here
        yield f"{run.task.name}: contacts of any link", "–", "none", str(len(m["contacts"]) or "none")  # type: ignore[arg-type]
        here = f"certified {m['visibility_planned_px']:.1f}, executed {m['visibility_executed_px']:.1f}"
        yield f"{run.task.name}: dots to the image's limits [px]", "“kept”", "> 0", here
        here = (
            f"{_mm(m['final_translation_error_m'], 3)} mm, "
            f"{np.rad2deg(float(str(m['final_rotation_error_rad']))):.4f}°, {m['final_error_px']:.3f} px"
        )
        yield f"{run.task.name}: at the goal", "“converges”", "≤ 0.3 mm, 0.05°, 0.1 px", here


def _perception_rows() -> Iterator[Row]:
    dots, match = dot_centres(), matching()
    here = f"{dots['error_median_px']:.3f} / {dots['error_p99_px']:.3f}"
    yield f"dot centres, {dots['poses']} poses: median / p99 [px]", "–", "≤ 0.05 / 0.2", here
    yield (
        "dots lost (≥ 12 px) / false",
        "–",
        "0 / 0",
        f"{dots['lost_of_12_px_or_more']} / {dots['false_dots']}",
    )
    here = f"{match['wrong']} / {match['refused']}"
    yield f"matching, {match['layouts']} layouts: wrong / refused", "–", "0 / ≤ 25", here


def _time_rows(times: list[StageTimes]) -> Iterator[Row]:
    points = " / ".join(f"{1e3 * t.from_points:.2f}" for t in times)
    images = " / ".join(f"{1e3 * t.from_images:.1f}" for t in times)
    yield "motion + structure + planning, from points [ms]", "5869 / 5713", "≤ 5", points
    yield "the same from two images [ms]", "–", "≤ 60", images
    kernel = " / ".join(f"{kernel_microseconds(name):.1f}" for name in TASKS)
    public = " / ".join(f"{1e-3 * public_microseconds(name):.2f}" for name in TASKS)
    yield "planning, kernel: arrays in, coefficients and verdict out [µs]", "–", "≤ 50", kernel
    yield "planning, public call with margins [ms]", "2796 / 1814", "≤ 1", public
    again = f"{replanning_microseconds():.1f}"
    yield "replanning, kernel, median of 200 problems [µs]", "–", "≤ 60", again
    yield "control step, pixels in, twist out [µs]", "–", "≤ 100", f"{control_step_microseconds():.0f}"
    yield "rendering 659×432 [frames/s]", "–", "≥ 15", f"{frames_per_second(TASKS[0]):.1f}"


def _mm(value: object, digits: int = 1) -> str:
    return f"{1e3 * float(str(value)):.{digits}f}"


def main() -> None:
    """Print the table as Markdown, row by row as it is measured."""
    print(f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}\n")
    print("| quantity | paper | target | here |\n|---|---|---|---|")
    for row in rows():
        print("| " + " | ".join(row) + " |", flush=True)


if __name__ == "__main__":
    main()
