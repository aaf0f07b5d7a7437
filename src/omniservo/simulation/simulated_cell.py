"""The robot cell of a task in the simulator."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from scipy.spatial.transform import RigidTransform

from omniservo.geometry.arrays import FloatArray
from omniservo.safety import SupervisedRobot
from omniservo.scenes import Ball, SceneBox, scene_of_task
from omniservo.simulation.simulated_robot import SimulatedRobot
from omniservo.simulation.simulated_truth import SimulatedTruth
from omniservo.simulation.true_scene import light_of, true_scene
from omniservo.tasks import Task


class SimulatedCell:
    """What a task describes, simulated: whole jobs of `omniservo.runs` are done in it.

    Args:
        task: says what stands where.
        seed: of the sensor's noise.

    Raises:
        InputError: the arm cannot bring the camera to its start pose.
    """

    def __init__(self, task: Task, seed: int = 0) -> None:
        self.scene = scene_of_task(task)
        """as the task tells of it; the arm stands in its start joints"""
        truth = true_scene(task, self.scene)
        light = task.simulation.goal_light
        self._goal_light = truth.lights[0] if light is None else light_of(light)
        self.robot = SimulatedRobot(truth, seed=seed)
        """arm and camera in one"""
        self.truth = SimulatedTruth(self.robot)
        """what the simulator knows"""

    @property
    def driver(self) -> SimulatedRobot:
        """The arm's."""
        return self.robot

    @property
    def camera(self) -> SimulatedRobot:
        """The camera on its flange."""
        return self.robot

    @property
    def clock(self) -> None:
        """None: time passes in `wait` alone."""
        return

    @property
    def drive(self) -> SupervisedRobot | None:
        """None: this process commands the arm."""
        return None

    def approve(self, motion: str) -> None:
        """Let it: no one is hurt."""

    def wait(self, duration: float) -> None:
        """Let time [s] pass, which passes here alone."""
        self.robot.advance(duration)

    def bring_arm_to(self, joints: FloatArray) -> None:
        """Put the arm to rest in these joints (n,) [rad] at once, at time 0, to teach a goal in its light.

        Raises:
            InputError: wrong shape, not finite, or outside the arm's range.
        """
        self.robot.place(joints)
        self.robot.light_up(self._goal_light)

    def move_obstacles(self, numbers: Sequence[int], by: FloatArray) -> None:
        """Put the scene's obstacles of these numbers elsewhere, at once, by (3,) [m] in the world."""
        obstacles = list(self.robot.world.scene.obstacles)
        for i in numbers:
            obstacles[i] = _moved(obstacles[i], by)
        self.robot.rearrange(obstacles)

    def close(self) -> None:
        """Let go of what images are made with."""
        self.robot.close()


def _moved(body: SceneBox | Ball, by: FloatArray) -> SceneBox | Ball:
    if isinstance(body, Ball):
        return replace(body, center=body.center + by)
    return replace(body, world_T_box=RigidTransform.from_translation(by) * body.world_T_box)
