"""The scene as it truly is: that which everybody is given, and what only the simulator knows."""

from __future__ import annotations

from dataclasses import replace

from omniservo.scenes import LensError, Light, Scene
from omniservo.tasks import Task
from omniservo.tasks.simulation import LightSection


def true_scene(task: Task, told: Scene) -> Scene:
    """Return the scene with the true lens and lights of `Task.simulation`.

    Args:
        task: states them.
        told: what `scene_of_task` makes of it.
    """
    truth = task.simulation
    error = truth.lens_error
    return replace(
        told,
        true_camera=truth.true_camera,
        lens_error=None
        if error is None
        else LensError(error.sigma, error.length * told.camera.width, error.seed),
        lights=(light_of(truth.light), *(light_of(change, change.time) for change in truth.light_changes)),
    )


def light_of(section: LightSection, since: float = 0.0) -> Light:
    """Return the light that a task states, from ``since`` [s] on."""
    return Light(since, section.brightness, section.ambient, section.direction)
