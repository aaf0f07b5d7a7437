"""The tables of docs/benchmark.md: what each method does on a study's scenes that have a solution.

Run: ``omniservo study paper-benchmark --out DIR``, then ``python -m benchmarks.public_benchmark DIR
[PICTURE.png] [--seconds 20]`` (needs `ompl`, of requirements-bench.lock). Every scene is drawn again, and
planned for with the true points and goal: where that gives a certified path that keeps the clearance, the
image's limits and the sight of every point, and that the arm can follow, if there is one, the scene is
proven feasible. Of all others those count as feasible, too, in which a method reached the goal and lost
no point, and those of which a search that knows nothing of that planner (`benchmarks.feasible_path`) finds a
path in so many seconds. An arm's scene may be proven to have none: its goal lies beyond a singularity.
Neither estimate nor margins have a part in it. What is past 90° is so from the axis, at an end.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from benchmarks.feasible_path import has_path
from benchmarks.tables import print_table

from omniservo.planning import plan_path
from omniservo.reporting.study_figures import study_drawings
from omniservo.studies import MethodSummary, Rate, Study, StudyRow, StudyTally, read_header, read_parts
from omniservo.studies.study_arms import NO_ARM
from omniservo.studies.study_scene import draw_scene, problem_of_truth
from omniservo.studies.study_summary import percent
from omniservo.whole_arm import plan_with_arm

PROVEN, GONE = "proven by the planner", "not proven, and gone by a method"
FOUND, UNKNOWN = "else found by RRT-Connect", "of which no path is known"
NONE = "proven to have none"
PATHS = PROVEN, GONE, FOUND, NONE, UNKNOWN


@dataclass(frozen=True)
class Truth:
    """What is true of a scene, whatever a method does in it."""

    path: str
    """how it is known that there is one: one of `PATHS`"""
    past: bool
    """a point is more than 90° from the axis at an end"""

    @property
    def feasible(self) -> bool:
        """Whether a path is known."""
        return self.path not in (NONE, UNKNOWN)


Choice = Callable[[StudyRow, Truth], bool]
GROUPS: dict[str, Choice] = {
    "all": lambda row, truth: True,
    "feasible": lambda row, truth: truth.feasible,
    "with obstacles": lambda row, truth: truth.feasible and row.obstacles > 0,
    "without": lambda row, truth: truth.feasible and row.obstacles == 0,
    "free camera": lambda row, truth: truth.feasible and row.arm == NO_ARM,
    "with an arm": lambda row, truth: truth.feasible and row.arm != NO_ARM,
    "past 90°": lambda row, truth: truth.feasible and truth.past,
}


def truth_of(study: Study, number: int, camera: str, seconds: float, gone: bool) -> Truth:
    """Return what is true of a scene that exists; ``gone``: a method reached the goal and lost no point."""
    scene = draw_scene(study, number, study.cameras[camera])
    problem, path = problem_of_truth(scene), UNKNOWN
    if scene.arm is None:
        status = plan_path(problem, seed=number).status
    else:
        status = plan_with_arm(problem, scene.arm.true_setting(), seed=number).plan.status
    if status == "certified":
        path = PROVEN
    elif gone:
        path = GONE
    elif status == "infeasible":
        path = NONE
    elif has_path(scene, seconds):
        path = FOUND
    ends = scene.points, scene.initial_T_goal.inv().apply(scene.points)
    return Truth(path, any(bool((end[:, 2] < 0.0).any()) for end in ends))


def _said(rows: list[StudyRow]) -> str:
    rate = Rate(sum(row.success for row in rows), len(rows))
    if not rows:
        return "–"
    low, high = (100 * end for end in rate.interval)
    return f"{100 * rate.share:.1f}% ({low:.0f}–{high:.0f}) of {rate.of}"


def main() -> None:
    """Print the tables; draw the page's picture of where each method reaches the goal from."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("picture", type=Path, nargs="?")
    parser.add_argument("--seconds", type=float, default=20.0, help="of the search for each unproven scene")
    given = parser.parse_args()
    header = read_header(given.folder)
    study = header.study
    rows = [row for part in read_parts(given.folder) for row in part.rows if row.counts]
    tally = StudyTally(rows)
    if given.picture is not None:
        *_, drawing = study_drawings(tally)
        drawing.figure.savefig(given.picture, dpi=90)
    first = [row for row in rows if row.method == study.methods[0]]
    gone = {row.scene for row in rows if row.success and not row.feature_lost}
    truths = {
        row.scene: truth_of(study, row.scene, row.camera, given.seconds, row.scene in gone) for row in first
    }
    print(
        f"{study.name} {study.hash}, version {header.version}, seed {study.seed}, "
        f"{study.scenes} scenes for each camera"
    )
    _print_scenes(first, truths)
    by_method = {m: [row for row in rows if row.method == m] for m in study.methods}
    _print_groups(by_method, truths)
    _print_cameras(by_method, truths, list(study.cameras))
    _print_arms(tally.summaries())
    for method, own in by_method.items():
        if method.startswith("certified"):
            _print_failures(method, own, truths)


def _print_scenes(rows: list[StudyRow], truths: dict[int, Truth]) -> None:
    """Say how many scenes there are, and of how many a path is known."""
    print(
        f"{len(truths)} scenes are there, {sum(truth.past for truth in truths.values())} with points past 90°"
    )
    for name, own in (("free camera", [row for row in rows if row.arm == NO_ARM]),
                      ("with an arm", [row for row in rows if row.arm != NO_ARM])):  # fmt: skip
        paths = Counter(truths[row.scene].path for row in own)
        print(f"- {name}: {len(own)}: " + ", ".join(f"{paths[path]} {path}" for path in PATHS))
    print()


def _print_groups(by_method: dict[str, list[StudyRow]], truths: dict[int, Truth]) -> None:
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


def _print_cameras(
    by_method: dict[str, list[StudyRow]], truths: dict[int, Truth], cameras: list[str]
) -> None:
    print("\nSuccess on feasible scenes, by camera:\n")
    print_table(
        "| method | " + " | ".join(cameras) + " |",
        (
            f"`{method}` | "
            + " | ".join(
                _said([row for row in own if row.camera == camera and truths[row.scene].feasible])
                for camera in cameras
            )
            for method, own in by_method.items()
        ),
    )


def _print_arms(found: list[MethodSummary]) -> None:
    """Print what the report says of arms: of all scenes, feasible or not."""
    print("\nWith an arm and without, all scenes:\n")
    print_table(
        "| method | arm | success | collision | joint limit |",
        (
            f"`{each.method}` | {arm} | {percent(rates.success)} of {rates.success.of} | "
            f"{percent(rates.collision)} of {rates.collision.of} | {percent(rates.joint_limit)}"
            for each in found
            for arm, rates in each.arms.items()
        ),
    )


def _print_failures(method: str, rows: list[StudyRow], truths: dict[int, Truth]) -> None:
    print(f"\nRows in which `{method}` fails on feasible scenes:\n")
    failed = [row for row in rows if truths[row.scene].feasible and not row.success]
    kinds = Counter(
        (row.camera, row.arm, "collision" if row.collision else row.status, truths[row.scene].path)
        for row in failed
    )
    for (camera, arm, how, path), count in kinds.most_common():
        print(f"- {camera}, arm {arm}: {how} {count} times; a path is {path}")
    print("- rows:" if failed else "- none", *(row.row for row in failed))


if __name__ == "__main__":
    main()
