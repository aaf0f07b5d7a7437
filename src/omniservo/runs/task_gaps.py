"""The gaps of a task's arm to what is known around it, watched while it moves."""

from __future__ import annotations

from omniservo.robots import RobotState
from omniservo.runs.arm_setting_of import arm_setting_of
from omniservo.safety.gap_watch import GapWatch
from omniservo.safety.safety_options import SafetyOptions
from omniservo.scenes.scene import Scene
from omniservo.tasks import Task
from omniservo.tracking import Replanner

GAP_SHARE = 0.5
"""So much of ``arm_clearance`` must be left where the arm would come to rest."""


class TaskGaps:
    """Watches the arm among the obstacles that a replanner knows of; nothing where there is no clearance.

    Args:
        task: with ``planning.arm_clearance``.
        scene: its arm.
        options: reaction time.
        replanner: knows where obstacles are; None: nothing was planned, and nothing is watched.
    """

    def __init__(self, task: Task, scene: Scene, options: SafetyOptions, replanner: Replanner | None) -> None:
        self._replanner, clearance = replanner, task.planning.arm_clearance
        if replanner is None or clearance is None:
            self._replanner = None
            return
        self._setting = arm_setting_of(task, scene, with_tube=False)
        self._kept, self._reaction = GAP_SHARE * clearance, options.reaction
        self._take(replanner)

    def check(self, state: RobotState) -> None:
        """Look at the arm.

        Raises:
            TooNear: see `GapWatch.check`.
        """
        replanner = self._replanner
        if replanner is None:
            return
        if replanner.obstacles is not self._known:
            self._take(replanner)
        self._watch.check(state)

    def _take(self, replanner: Replanner) -> None:
        self._known = replanner.obstacles
        self._watch = GapWatch(self._setting.bodies(self._known), self._kept, self._reaction)
