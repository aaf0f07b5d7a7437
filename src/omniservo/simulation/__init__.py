"""The world, the ray-cast camera, the simulated robot and the log of its run."""

from omniservo.simulation.outside_view import OutsideView, Viewpoint
from omniservo.simulation.scene import Ball, Box, Dots, Panel, Scene, Sensor
from omniservo.simulation.simulated_robot import SimulatedRobot
from omniservo.simulation.unified_renderer import UnifiedRenderer
from omniservo.simulation.world import World

__all__ = [
    "Ball",
    "Box",
    "Dots",
    "OutsideView",
    "Panel",
    "Scene",
    "Sensor",
    "SimulatedRobot",
    "UnifiedRenderer",
    "Viewpoint",
    "World",
]
