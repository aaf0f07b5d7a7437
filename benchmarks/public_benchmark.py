"""The tables of docs/benchmark.md: what each method does on a study's scenes that are proven feasible.

Run: ``omniservo study paper-benchmark --out DIR``, then ``python -m benchmarks.public_benchmark DIR
[PICTURE.png]``. Every scene is drawn again and planned for with the true points and goal: where that gives a
certified path that keeps the clearance, the image's limits and the sight of every point, the scene is proven
feasible. Neither estimate nor margins have a part in it. What is past 90° is so from the axis, at an end.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from benchmarks.tables import print_table

from omniservo.planning import PlanningProblem, plan_path
from omniservo.reporting.study_figures import study_drawings
from omniservo.studies import Rate, Study, StudyRow, StudyTally, read_header, read_parts
from omniservo.studies.study_scene import draw_scene

LEAST_DISTANCE = 0.03
"""[m] to the points, as a study's plans keep it"""


@dataclass(frozen=True)
class Truth:
    """What is true of a scene, whatever a method does in it."""

    feasible: bool
    """a path is proven"""
    past: bool
    """a point is more than 90° from the axis at an end"""


Choice = Callable[[StudyRow, Truth], bool]
GROUPS: dict[str, Choice] = {
    "all": lambda row, truth: True,
    "proven feasible": lambda row, truth: truth.feasible,
    "with obstacles": lambda row, truth: row.obstacles > 0,
    "without": lambda row, truth: row.obstacles == 0,
    "past 90°": lambda row, truth: truth.past and truth.feasible,
}


def truth_of(study: Study, number: int, camera: str) -> Truth:
    """Return what is true of a scene that exists."""
    scene = draw_scene(study, number, study.cameras[camera])
    problem = PlanningProblem(
        scene.camera,  # type: ignore[arg-type]  # of any model
        scene.points, scene.initial_T_goal, scene.obstacles, clearance=scene.clearance,
        least_distance=LEAST_DISTANCE, occlusion=bool(scene.obstacles),
    )  # fmt: skip
    ends = scene.points, scene.initial_T_goal.inv().apply(scene.points)
    feasible = plan_path(problem, seed=number).status == "certified"
    return Truth(feasible, any(bool((end[:, 2] < 0.0).any()) for end in ends))


def _said(rows: list[StudyRow]) -> str:
    rate = Rate(sum(row.success for row in rows), len(rows))
    if not rows:
        return "–"
    low, high = (100 * end for end in rate.interval)
    return f"{100 * rate.share:.1f}% ({low:.0f}–{high:.0f}) of {rate.of}"


def main(folder: str, picture: str | None = None) -> None:
    """Print the tables; draw the page's picture of where each method reaches the goal from."""
    header = read_header(Path(folder))
    study = header.study
    rows = [row for part in read_parts(Path(folder)) for row in part.rows if row.counts]
    if picture is not None:
        *_, drawing = study_drawings(StudyTally(rows))
        drawing.figure.savefig(picture, dpi=90)
    truths = {
        row.scene: truth_of(study, row.scene, row.camera) for row in rows if row.method == study.methods[0]
    }
    proven, past = (sum(getattr(truth, name) for truth in truths.values()) for name in ("feasible", "past"))
    print(
        f"{study.name} {study.hash}, version {header.version}, seed {study.seed}, "
        f"{study.scenes} scenes for each camera"
    )
    print(f"{len(truths)} scenes are there, {proven} proven feasible, {past} with points past 90°\n")
    by_method = {m: [row for row in rows if row.method == m] for m in study.methods}
    print_table(
        "| method, success (95%) | " + " | ".join(GROUPS) + " |",
        (
            f"`{method}` | "
            + " | ".join(
                _said([row for row in own if keep(row, truths[row.scene])]) for keep in GROUPS.values()
            )
            for method, own in by_method.items()
        ),
    )
    print("\nSuccess on scenes proven feasible, by camera:\n")
    print_table(
        "| method | " + " | ".join(study.cameras) + " |",
        (
            f"`{method}` | "
            + " | ".join(
                _said([row for row in own if row.camera == camera and truths[row.scene].feasible])
                for camera in study.cameras
            )
            for method, own in by_method.items()
        ),
    )
    print("\nRows in which `certified` fails on scenes proven feasible:\n")
    failed = [row for row in by_method.get("certified", []) if truths[row.scene].feasible and not row.success]
    kinds = Counter((row.camera, "collision" if row.collision else row.status) for row in failed)
    for (camera, how), count in kinds.most_common():
        print(f"- {camera}: {how} {count} times")
    print("- rows:" if failed else "- none", *(row.row for row in failed))


if __name__ == "__main__":
    main(*sys.argv[1:])
