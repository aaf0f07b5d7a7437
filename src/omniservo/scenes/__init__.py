"""The scene of a task: arm, camera mount, target, obstacles and surroundings as plain values."""

from omniservo.scenes.lens_error import LensError
from omniservo.scenes.light import Light
from omniservo.scenes.panel import Panel
from omniservo.scenes.scene import Ball, Dots, Scene, SceneBox
from omniservo.scenes.scene_of_task import scene_of_task
from omniservo.scenes.sensor import Sensor

__all__ = [
    "Ball",
    "Dots",
    "LensError",
    "Light",
    "Panel",
    "Scene",
    "SceneBox",
    "Sensor",
    "scene_of_task",
]
