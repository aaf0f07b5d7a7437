"""Which constraint is tight, and where: as a place in the world, with what stands there."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray
from omniservo.planning import ConstraintMargin, Plan, worst_moment
from omniservo.planning.obstacles.obstacle import Obstacle
from omniservo.reporting.spelling import spell
from omniservo.viewer.situation import Situation
from omniservo.whole_arm import ArmPlan

_STEP = 1e-5
"""[m] of a distance's slope"""


@dataclass(frozen=True, eq=False)
class WorstPlace:
    """The moment with the least left, or of the worst violation."""

    words: str
    w: float
    line: FloatArray
    """(2, 3) in the world [m]: from the camera, or the link, to what it is about; twice the same place where
    it is about the camera alone"""
    violated: bool
    obstacle: int | None = None
    """the obstacle that it is about"""


def worst_place(situation: Situation, plan: Plan, found: ArmPlan | None) -> WorstPlace | None:
    """Return it; what stops the arm counts where the camera's own constraints hold. None: nothing known."""
    if found is not None and found.plan.status == "not_found":
        place = _of_arm(situation, found)
        if place is not None:
            return place
    worst = worst_moment(plan)
    if worst is not None:
        return _of_camera(situation, plan, worst)
    return _of_end(situation, plan if found is None else found.plan)


def _of_camera(situation: Situation, plan: Plan, worst: ConstraintMargin) -> WorstPlace:
    problem, w = plan.problem, worst.w
    if plan.path is not None:
        centre = plan.path.positions(w)
    else:
        centre = problem.goal_translation if w == 1.0 else np.zeros(3)
    number, point = _number(worst.name, "obstacle"), _number(worst.name, "point")
    other = centre
    if point is not None and not worst.name.startswith("clearance"):
        other = np.array(problem.points[point])
    elif number is not None:
        other = nearest_of(problem.obstacles[number], centre)
    violated = worst.margin < 0.0
    amount = spell(abs(worst.margin), worst.unit)
    left = f"{amount} short" if violated else f"{amount} left"
    words = f"{worst.name}: {'no pixel' if worst.is_unseen else left} at w = {w:.2f}"
    line = situation.world_T_initial.apply(np.stack([centre, other]))
    return WorstPlace(words, w, line, violated, number)


def _of_end(situation: Situation, plan: Plan) -> WorstPlace | None:
    """Return the end pose at which the arm cannot stand, as the plan's reason has it."""
    if plan.status != "infeasible":
        return None
    at_goal = plan.reason.startswith("the goal")
    pose = situation.world_T_goal if at_goal else situation.world_T_initial
    return WorstPlace(plan.reason, float(at_goal), np.tile(pose.translation, (2, 1)), True)


def _of_arm(situation: Situation, found: ArmPlan) -> WorstPlace | None:
    branch, arm, clearance = found.branch, situation.arm, found.clearance
    if branch is None or arm is None:
        return None
    if branch.failures:
        failure = branch.failures[0]
        w, words, obstacle = min(failure.worst_w, float(branch.w[-1])), str(failure), None
    elif clearance is not None and clearance.status != "clear" and clearance.closest is not None:
        closest = clearance.closest
        w, words, obstacle = closest.w, clearance.reason, _number(closest.other, "obstacle")
    else:
        return None
    try:
        place = arm.scene.world_T_camera(branch(w)).translation
    except InputError:
        return None
    other = place
    if obstacle is not None:
        known = situation.problem.obstacles[obstacle]
        initial = situation.world_T_initial
        other = initial.apply(nearest_of(known, initial.inv().apply(place)))
    return WorstPlace(words, w, np.stack([place, other]), True, obstacle)


def nearest_of(obstacle: Obstacle, place: FloatArray) -> FloatArray:
    """Return the point (3,) of an obstacle's surface nearest to a place (3,): along the distance's slope."""
    steps = np.vstack([place, place + _STEP * np.eye(3), place - _STEP * np.eye(3)])
    here, *around = obstacle.distance(np.ascontiguousarray(steps)).tolist()
    slope = (np.array(around[:3]) - np.array(around[3:])) / (2.0 * _STEP)
    length = float(np.linalg.norm(slope))
    return place if length == 0.0 else np.asarray(place - here * slope / length)


def _number(name: str, what: str) -> int | None:
    found = re.search(rf"{what} (\d+)", name)
    return None if found is None else int(found[1])
