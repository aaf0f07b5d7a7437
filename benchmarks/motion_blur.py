"""What motion blur each kind of feature bears: points still found, and how far off they are.

Run: ``python -m benchmarks.motion_blur [TASK …]``. At a task's start the camera moves sideways, turns about
its x axis, or goes ahead, so that nine tenths of the image move by the stated pixels during an exposure; the
tracker looks for the matched points at their true places. Error: median distance to where the tracker has
them in the sharp image.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
from benchmarks.tables import print_table

from omniservo.geometry.arrays import FloatArray
from omniservo.runs import teach_goal
from omniservo.runs.feature_kind_of import feature_kind_of
from omniservo.scenes.scene_of_task import scene_of_task
from omniservo.simulation import SimulatedCell, UnifiedRenderer, World
from omniservo.tasks import load_task

TASKS = (
    "paper-example-1", "perspective-wall", "catadioptric-ring", "tag-board", "panda-table", "textured-object"
)  # fmt: skip
BLURS = (1, 2, 3, 4, 5, 6, 8, 10)
EXPOSURE = 0.02
TWISTS = {"sideways": [1, 0, 0, 0, 0, 0], "turning": [0, 0, 0, 1, 0, 0], "ahead": [0, 0, 1, 0, 0, 0]}


def moved(q: FloatArray, speeds: FloatArray, time: float) -> FloatArray:
    """Return the joints (n,) [rad] after a time [s]."""
    return q + time * speeds


def rows_of(name: str) -> Iterator[str]:
    """Yield a task's rows, one a motion."""
    task = load_task(name)
    scene, kind, random = scene_of_task(task), feature_kind_of(task), np.random.default_rng(0)
    goal = teach_goal(task, SimulatedCell(task, 1)).image
    sensor = replace(scene.sensor, rate=30, latency=0.05, exposure=EXPOSURE, readout=0.0)
    renderer, q = UnifiedRenderer(World(replace(scene, sensor=sensor))), scene.start_joints
    sharp = renderer.photograph(q, random)
    matched = kind.match(task.camera, sharp, goal)
    tracker = kind.tracker(task.camera, sharp, goal, matched)
    places, there = tracker.update(sharp, matched.initial)
    for motion, twist in TWISTS.items():
        speeds = scene.arm.joint_velocities(q, np.array(twist, dtype=np.float64), scene.flange_T_camera)
        unit = 0.002 / renderer._motion(q - 0.001 * speeds, q + 0.001 * speeds)
        cells = []
        for blur in BLURS:
            image = renderer.photograph(partial(moved, q, blur * unit / EXPOSURE * speeds), random)
            pixels, valid = tracker.update(image, matched.initial)
            off = np.linalg.norm(pixels - places, axis=1)[valid & there]
            error = f" ({np.median(off):.2f})" if len(off) else ""
            cells.append(f"{100.0 * valid.sum() / there.sum():.0f}%{error}")
        yield " | ".join([name, kind.name, motion, *cells])


if __name__ == "__main__":
    head = " | ".join(["task", "features", "motion", *(f"{blur} px" for blur in BLURS)])
    print_table(f"| {head} |", (row for name in sys.argv[1:] or TASKS for row in rows_of(name)))
