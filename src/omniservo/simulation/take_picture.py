"""One image from a robot that stands still."""

from __future__ import annotations

import math

from omniservo.robots import CameraImage, next_image
from omniservo.simulation.simulated_robot import SimulatedRobot


def take_picture(robot: SimulatedRobot) -> CameraImage:
    """Let the robot's time pass until its next frame is delivered, and return it."""
    return next_image(robot, robot.advance, patience=math.inf)
