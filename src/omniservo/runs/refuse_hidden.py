"""No way is begun on which the arm hides its own target."""

from __future__ import annotations

from omniservo.errors import AnswerIsNo
from omniservo.planning import Plan
from omniservo.robots import own_sight
from omniservo.runs.own_branch import base_T_initial
from omniservo.simulation.planned_motion import PlannedMotion
from omniservo.simulation.scene import Scene
from omniservo.tasks import Task


def refuse_hidden(task: Task, scene: Scene, plan: Plan, motion: PlannedMotion) -> None:
    """Refuse a plan on which a link stands between camera and a point, where a task asks for sight.

    Raises:
        AnswerIsNo: ``planning.occlusion`` is asked for, and a link hides a point; the message says which, at
            which w, by how much.
    """
    if not task.planning.occlusion:
        return
    points = base_T_initial(task, scene).apply(plan.problem.points)
    found = own_sight(scene.arm, motion.joints, scene.flange_T_camera, points)
    if found.status == "hidden":
        raise AnswerIsNo(f"the arm hides its own target: {found.reason}")
