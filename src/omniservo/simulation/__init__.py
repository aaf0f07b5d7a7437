"""The world, the ray-cast camera, the simulated robot and the log of its run."""

from omniservo.renamed import renamed
from omniservo.simulation.outside_view import OutsideView, Viewpoint
from omniservo.simulation.scene import Ball, Dots, Panel, Scene, SceneBox, Sensor
from omniservo.simulation.scene_of_task import scene_of_task
from omniservo.simulation.simulated_robot import SimulatedRobot
from omniservo.simulation.take_picture import take_picture
from omniservo.simulation.unified_renderer import UnifiedRenderer
from omniservo.simulation.world import World

__all__ = [
    "Ball",
    "Dots",
    "OutsideView",
    "Panel",
    "Scene",
    "SceneBox",
    "Sensor",
    "SimulatedRobot",
    "UnifiedRenderer",
    "Viewpoint",
    "World",
    "scene_of_task",
    "take_picture",
]

__getattr__ = renamed(__name__, {"Box": "SceneBox"})
