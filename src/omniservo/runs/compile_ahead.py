"""A first run compiles on two cores: while it looks at its images, another process compiles the planner.

Both keep what they compile in the same folder (`geometry.kernel_cache`), where the other finds it.
"""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.cameras import preset
from omniservo.errors import NoSolutionError
from omniservo.geometry.kernel_cache import kernel_folders
from omniservo.planning import PlanningProblem, Sphere, plan_path
from omniservo.servoing import RestToRestLaw
from omniservo.tracking import PathTracker

ENOUGH = 100
"""Where so many kernels are compiled, it is no first run."""


@contextmanager
def compiling_ahead() -> Iterator[subprocess.Popen[bytes] | None]:
    """Let another process compile ahead, if there is much to compile and a core for it; it ends with this."""
    kernels = {file.name for folder in kernel_folders() for file in folder.glob("*.kernel")}
    if len(kernels) >= ENOUGH or usable_cores() < 2:
        yield None
        return
    nowhere = subprocess.DEVNULL
    with subprocess.Popen(
        [sys.executable, "-P", "-m", "omniservo.runs.compile_ahead"],
        stdin=nowhere,
        stdout=nowhere,
        stderr=nowhere,
    ) as child:
        try:
            yield child
        finally:
            child.kill()


def compile_ahead() -> None:
    """Plan a path past a ball and follow it for a moment, which compiles planner and tracker."""
    camera = preset("fe185")
    points = np.array([[x, y, 0.5 - abs(x)] for x in (-0.1, 0.0, 0.1) for y in (-0.09, 0.0, 0.08)])
    goal = RigidTransform.from_components([0.1, -0.05, 0.12], RigidTransform.identity().rotation)
    ball = Sphere(np.array([0.05, -0.025, 0.06]), 0.01)
    plan = plan_path(PlanningProblem(camera, points, goal, obstacles=(ball,), clearance=0.05))
    if plan.path is None:
        raise NoSolutionError(plan.reason)
    goal_pixels = camera.project(goal.inv().apply(points))[0]
    tracker = PathTracker(plan, camera, goal_pixels=goal_pixels, time_law=RestToRestLaw(4.0))
    for step, pose in enumerate(plan.path(np.linspace(0.0, 0.05, 20))):
        pixels, seen = camera.project(pose.inv().apply(points))
        tracker.step(0.04 * step, pixels, seen)


def usable_cores() -> int:
    """Return how many cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


if __name__ == "__main__":
    compile_ahead()
