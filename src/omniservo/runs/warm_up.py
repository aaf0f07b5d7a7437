"""Small jobs of every kind, done so that what they need is compiled."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from omniservo.calibration.boards import Checkerboard, find_board
from omniservo.geometry.late import fill_all
from omniservo.planning import PlanningProblem, plan_path
from omniservo.runs.job_progress import Progress
from omniservo.runs.robot_cell import OpenCell
from omniservo.runs.run_task import run_task
from omniservo.tasks import load_task

_RATE, _TIME = 10.0, 1.2
"""[Hz, s] of the tasks' runs: long enough for everything to happen once, also what happens on the way"""

_TASKS: tuple[tuple[str, str, float], ...] = (
    ("whole-arm-1", "certified", 330.0),
    ("tag-board", "certified", 25.0),
    ("textured-object", "certified", 60.0),
    ("panda-table", "certified", 40.0),
    ("moving-panel", "certified", 30.0),
    ("paper-example-1", "ibvs", 15.0),
)
"""Dots, tags and texture; arms with a closed inverse and without; a stated risk; another way on the way.
With what each takes of one core, compiling what those before it did not [s]: the first was measured."""


def warm_up(open_cell: OpenCell, progress: Progress = lambda job, done: None) -> None:
    """Do jobs that call all that is compiled for a run, a plan and a calibration.

    Args:
        open_cell: where runs are done.
        progress: called with each job and the share of them all that is behind.
    """
    jobs: list[tuple[str, float, Callable[[], object]]] = [
        *(
            (f"the task {name} ({how})", time, partial(_short_run, name, open_cell, how))
            for name, how, time in _TASKS
        ),
        ("more plans", 20.0, _plans),
        ("a calibration board", 10.0, _board),
        ("what none of these called", 20.0, fill_all),
    ]
    behind, whole = 0.0, sum(time for _, time, _ in jobs)
    for name, time, job in jobs:
        progress(name, behind / whole)
        job()
        behind += time


def _short_run(name: str, open_cell: OpenCell, method: str) -> None:
    task = load_task(name)
    sensor = task.sensor.model_copy(update={"rate": _RATE})
    servo = task.servo.model_copy(update={"time_limit": _TIME})
    short = task.model_copy(update={"sensor": sensor, "servo": servo})
    run_task(short, open_cell, method=method, filmed=False)


def _plans() -> None:
    """Plan for one obstacle of every kind, in every way."""
    mesh = [[x, y, z] for x in (0.3, 0.32) for y in (0.0, 0.1) for z in (0.1, 0.2)]
    problem = PlanningProblem.from_dict(
        {
            "format": "omniservo.problem/1",
            "camera": {"model": "unified", "fx": 300, "fy": 300, "cx": 320, "cy": 240, "skew": 0, "xi": 1.2,
                       "distortion": [0, 0, 0, 0], "width": 640, "height": 480, "max_angle": 1.5,
                       "dead_zone": {"center": [320, 240], "radius": 1.0}},
            "points": [[x, y, 0.6 + 0.2 * x * y] for x in (-0.1, 0, 0.1) for y in (-0.1, 0.02, 0.1)],
            "goal": {"translation": [0.2, 0, 0.1], "quaternion": [0, 0, 0, 1]},
            "obstacles": [
                {"type": "sphere", "center": [0.1, 0.005, 0.05], "radius": 0.02},
                {"type": "capsule", "from": [0.3, 0, 0], "to": [0.3, 0.1, 0], "radius": 0.01},
                {"type": "box", "center": [-0.3, 0, 0], "half_extents": [0.02, 0.02, 0.02],
                 "quaternion": [0, 0, 0, 1]},
                {"type": "half_space", "normal": [0, 0, 1], "offset": -0.3},
                {"type": "mesh", "vertices": mesh},
                {"type": "cloud", "points": mesh, "radius": 0.01},
            ],
            "clearance": 0.03,
            "visibility_margin": 1.0,
            "occlusion": True,
            "workspace": {"min": [-1, -1, -1], "max": [1, 1, 1]},
        }
    )  # fmt: skip
    plan_path(problem)
    plan_path(problem, quality="margin", time_budget=2.0)


def _board() -> None:
    """Look for a chequered board in an image of one."""
    square = 40
    squares = np.indices((7, 9)).sum(axis=0) % 2
    picture = np.pad(np.kron(squares, np.full((square, square), 200)) + 20, square, constant_values=220)
    find_board(picture.astype(np.uint8), Checkerboard(columns=8, rows=6, square=0.03))
