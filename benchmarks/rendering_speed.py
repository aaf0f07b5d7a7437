"""Frames per second of the simulated camera: dots and tags in the paper's fisheye, a view full of texture.

Run: ``python -m benchmarks.rendering_speed``. Timed is `UnifiedRenderer.photograph`: rays, edges, blur, noise
and rounding, each frame with the arm elsewhere between the task's start and goal. Two threads.
"""

from __future__ import annotations

from time import perf_counter

import numpy as np

from omniservo.scenes.scene_of_task import goal_joints, scene_of_task
from omniservo.simulation import UnifiedRenderer, World
from omniservo.tasks import load_task

TASKS = ("paper-example-1", "tag-board", "textured-object")


def frames_per_second(name: str, frames: int = 40) -> float:
    """Return 1 / (median time of a frame) [1/s]; one frame is rendered before the clock starts."""
    task = load_task(name)
    scene = scene_of_task(task)
    goal = goal_joints(task, scene)
    renderer = UnifiedRenderer(World(scene))
    noise = np.random.default_rng(0)
    renderer.photograph(scene.start_joints, noise)
    taken = []
    for share in np.linspace(0.0, 1.0, frames):
        joints = (1.0 - share) * scene.start_joints + share * goal
        before = perf_counter()
        renderer.photograph(joints, noise)
        taken.append(perf_counter() - before)
    return 1.0 / float(np.median(taken))


if __name__ == "__main__":
    for name in TASKS:
        camera = load_task(name).camera
        print(f"{name} {camera.width}x{camera.height}: {frames_per_second(name):.1f} frames/s (median)")
