"""One picture from a robot that stands still."""

from __future__ import annotations

from omniservo.robots import CameraImage
from omniservo.simulation.simulated_robot import SimulatedRobot

_TICK = 1e-3


def take_picture(robot: SimulatedRobot) -> CameraImage:
    """Let time pass until the next frame is delivered, and return it."""
    before = robot.image()
    while True:
        robot.advance(_TICK)
        image = robot.image()
        if image is not None and (before is None or image.time > before.time):
            return image
