"""The world, the ray-cast camera, the simulated robot and the log of its run."""

from omniservo.renamed import renamed
from omniservo.simulation.outside_view import OutsideView, Viewpoint
from omniservo.simulation.scene import Ball, Dots, Panel, Scene, SceneBox, Sensor
from omniservo.simulation.simulated_robot import SimulatedRobot
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
]

__getattr__ = renamed(__name__, {"Box": "SceneBox"})
