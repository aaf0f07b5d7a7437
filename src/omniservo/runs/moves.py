"""What a task lets happen on the way: obstacles are put elsewhere, and the planner is told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.replanning.frame_change import seen_from
from omniservo.simulation import SimulatedRobot
from omniservo.simulation.scene import Ball, SceneBox
from omniservo.tasks import Task
from omniservo.tracking import Replanner


class Moves:
    """Carries out a task's moves.

    Args:
        task: with its moves.
        robot: in whose world bodies are moved.
        replanner: is told what it knows of them; None: nobody is.
    """

    def __init__(self, task: Task, robot: SimulatedRobot, replanner: Replanner | None) -> None:
        self._left = sorted(task.moves, key=lambda move: move.time)
        self._turn = task.start.world_T_camera.transform.rotation
        self._robot, self._replanner = robot, replanner

    def at(self, time: float) -> None:
        """Carry out what is due at ``time`` [s] since the servo's start."""
        while self._left and self._left[0].time <= time:
            move = self._left.pop(0)
            by = self._turn.apply(np.array(move.by))
            bodies = list(self._robot.world.scene.obstacles)
            for i in move.bodies:
                bodies[i] = _moved(bodies[i], by)
            self._robot.rearrange(bodies)
            if self._replanner is not None:
                step = RigidTransform.from_translation(move.by)
                known = self._replanner.obstacles
                self._replanner.set_obstacles(
                    seen_from(o, step, 0.0) if i in move.known else o for i, o in enumerate(known)
                )


def _moved(body: SceneBox | Ball, by: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> SceneBox | Ball:
    if isinstance(body, Ball):
        return replace(body, center=body.center + by)
    return replace(body, world_T_box=RigidTransform.from_translation(by) * body.world_T_box)
