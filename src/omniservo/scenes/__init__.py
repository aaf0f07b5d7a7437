"""The scene of a task: arm, camera mount, target, obstacles and surroundings as plain values."""

from omniservo.scenes.scene import Ball, Dots, Panel, Scene, SceneBox, Sensor
from omniservo.scenes.scene_of_task import scene_of_task

__all__ = ["Ball", "Dots", "Panel", "Scene", "SceneBox", "Sensor", "scene_of_task"]
