"""What stands around: arm, camera, target, obstacles as plain values, and how a task says so."""

from omniservo.scenes.scene import Ball, Dots, Panel, Scene, SceneBox, Sensor
from omniservo.scenes.scene_of_task import scene_of_task

__all__ = ["Ball", "Dots", "Panel", "Scene", "SceneBox", "Sensor", "scene_of_task"]
