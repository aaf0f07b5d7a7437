"""What a task lets happen on the way: obstacles are put elsewhere, and the planner is informed."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.geometry.arrays import FloatArray
from omniservo.replanning.frame_change import seen_from
from omniservo.tasks import Task
from omniservo.tracking import Replanner


class Moves:
    """Carries out a task's moves.

    Args:
        task: with its moves.
        move: has the scene's obstacles of these numbers put elsewhere, by (3,) [m] in the world.
        replanner: is given what it knows of them; None: there is none.
    """

    def __init__(
        self, task: Task, move: Callable[[Sequence[int], FloatArray], None], replanner: Replanner | None
    ) -> None:
        self._left = sorted(task.moves, key=lambda move: move.time)
        self._turn = task.start.world_T_camera.transform.rotation
        self._move, self._replanner = move, replanner

    def at(self, time: float) -> None:
        """Carry out what is due at ``time`` [s] since the servo's start."""
        while self._left and self._left[0].time <= time:
            move = self._left.pop(0)
            self._move(move.bodies, self._turn.apply(np.array(move.by)))
            if self._replanner is not None:
                step = RigidTransform.from_translation(move.by)
                known = self._replanner.obstacles
                self._replanner.set_obstacles(
                    seen_from(o, step, 0.0) if i in move.known else o for i, o in enumerate(known)
                )
