"""The four canonical tasks of Gans, Corke and Hutchinson for every servo method.

Run: ``python -m benchmarks.canonical_tasks``. *Performance tests of partitioned approaches to visual servo
control* (ICRA 2002) asks each controller for a rotation about the optical axis, a translation along it, a
rotation about the camera's y axis, and a rotation of the feature plane, and measures success, time, what is
left of the error and how far the camera deviates. Tasks and measures are theirs; amounts and target are ours:
16 points within 3 mm of a plane, 0.1 m apart, 0.8 m before the goal of a perspective camera, 0.1 px of noise.

Two of the tasks move no camera centre, so two images show no structure: the target is known to every method,
and its pose comes from each image (`estimate_known_target`). 30 images a second, 20 s at most, gain 1/s.
Reached: within 20 mm and 2°.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator

import numpy as np
from benchmarks.scene_runs import METHODS, Run, run_method_on, scene_of, study_of
from benchmarks.tables import print_table
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.cameras import preset

CAMERA = preset("perspective")
DISTANCE, NOISE = 0.8, 0.1
_PLACES = np.array([-1.5, -0.5, 0.5, 1.5])
TARGET = np.array(
    [
        [0.1 * x, 0.1 * y, DISTANCE + 0.003 * (-1) ** (i + k)]
        for i, x in enumerate(_PLACES)
        for k, y in enumerate(_PLACES)
    ]
)
"""in the goal's camera frame [m]"""
SECTIONS = {
    "servo": {"gain": 1.0},
    "limits": {"seconds": 20.0, "translation": 0.02, "rotation": float(np.deg2rad(2.0))},
}
TASKS = {
    "rotation about the optical axis [°]": (30.0, 90.0, 150.0, 180.0),
    "translation along it [m]": (0.4, 1.0, 2.0, -0.25),
    "rotation about the camera's y axis [°]": (5.0, 10.0, 15.0),
    "rotation of the feature plane [°]": (20.0, 45.0, 70.0),
}
"""task → amounts, from the goal to the start; a positive translation goes back"""


def start(task: int, amount: float) -> RigidTransform:
    """Return goal_T_initial of a task's amount."""
    turned = [Rotation.from_rotvec(np.deg2rad(amount) * np.array(axis)) for axis in ([0, 0, 1], [0, 1, 0])]
    if task == 0:
        return RigidTransform.from_rotation(turned[0])
    if task == 1:
        return RigidTransform.from_translation([0.0, 0.0, -amount])
    if task == 2:
        return RigidTransform.from_rotation(turned[1])
    middle = RigidTransform.from_translation([0.0, 0.0, DISTANCE])
    return middle * RigidTransform.from_rotation(turned[1]) * middle.inv()


def runs(method: str, task: int) -> Iterator[Run]:
    """Yield the run of each amount."""
    for k, amount in enumerate(list(TASKS.values())[task]):
        initial_T_goal = start(task, amount).inv()
        scene = scene_of(CAMERA, initial_T_goal.apply(TARGET), initial_T_goal, NOISE)
        study = study_of("canonical-tasks", CAMERA, method, **SECTIONS)
        yield run_method_on(study, scene, 10 * task + k, known=True)


def _said(found: Run) -> str:
    if not found.success:
        stop = found.reason.partition(":")[0] if found.status == "stopped" else found.status
        return f"{stop.replace('_', ' ')}, up to {found.farthest:.2f} m off"
    lost = ", points lost" if found.lost else ""
    return f"{found.seconds:.1f} s, {found.length:.2f} m, {1e3 * found.translation:.1f} mm{lost}"


def main() -> None:
    """Print a table for each task."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--method", action="append", help="default: all")
    methods = parser.parse_args().method or METHODS
    for task, (name, amounts) in enumerate(TASKS.items()):
        print(f"\n{name.partition(' [')[0].capitalize()}: time, way, what is left of the error\n")
        unit = name.rpartition("[")[2].rstrip("]")
        print_table(
            f"| method | {' | '.join(f'{amount:g} {unit}' for amount in amounts)} |",
            (f"`{method}` | {' | '.join(map(_said, runs(method, task)))}" for method in methods),
        )


if __name__ == "__main__":
    main()
