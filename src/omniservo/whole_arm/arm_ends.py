"""No path exists where the arm cannot stand at an end pose."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray
from omniservo.planning.planning_problem import PlanningProblem
from omniservo.robots import ArmBodies, spelled_gap
from omniservo.whole_arm.arm_setting import ArmSetting


def violation_at_start(problem: PlanningProblem, setting: ArmSetting, bodies: ArmBodies) -> str:
    """Return a sentence that says why the arm cannot stand at the initial pose; else "".

    In the setting's configuration, if there is one, else in any; see `violation_at_goal`.
    """
    stand = _Stand(problem, setting, bodies)
    if setting.start is not None:
        return _sentence("start", stand.violation(setting.start)[1], "")
    return _violation_at("start", RigidTransform.identity(), stand)


def violation_at_goal(problem: PlanningProblem, setting: ArmSetting, bodies: ArmBodies) -> str:
    """Return a sentence that says why the arm can stand at the goal in no configuration; else "".

    Every configuration that `Arm.inverse` knows is tried; where it has no closed form the sentence says so.
    """
    return _violation_at("goal", problem.initial_T_goal, _Stand(problem, setting, bodies))


def free_postures(problem: PlanningProblem, setting: ArmSetting, bodies: ArmBodies) -> FloatArray:
    """Return the configurations (k, n) [rad] that reach the goal and in which the arm can stand."""
    stand = _Stand(problem, setting, bodies)
    try:
        postures = setting.arm.inverse(setting.base_T_flange(problem.initial_T_goal))
    except InputError:  # out of reach
        return np.empty((0, setting.arm.dof))
    return postures[[not stand.violation(q)[1] for q in postures]]


def _violation_at(pose: str, initial_T_camera: RigidTransform, stand: _Stand) -> str:
    setting = stand.setting
    try:
        postures = setting.arm.inverse(setting.base_T_flange(initial_T_camera))
    except InputError as error:
        return f"the {pose} pose cannot be reached: {error}"
    reasons = []
    for q in _apart(postures):
        reasons.append(stand.violation(q))
        if not reasons[-1][1]:
            return ""
    known = "" if setting.arm.has_closed_form else " that a seeded search found"
    return _sentence(pose, min(reasons)[1], f" in any of {len(reasons)} joint configurations{known}")


def _sentence(pose: str, reason: str, where: str) -> str:
    return f"the {pose} pose is not free{where}: {reason}" if reason else ""


def _apart(postures: FloatArray) -> FloatArray:
    """Return one of all joints that differ by full turns: bodies and singularity are the same there."""
    _, first = np.unique(np.round(np.exp(1j * postures), 6), axis=0, return_index=True)
    return postures[np.sort(first)]


class _Stand:
    """What the arm has to keep where it stands still."""

    def __init__(self, problem: PlanningProblem, setting: ArmSetting, bodies: ArmBodies) -> None:
        self.setting, self._bodies = setting, bodies
        self._in_sight = setting.points_in_sight(problem)

    def violation(self, q: FloatArray) -> tuple[float, str]:
        """Return by how much a configuration fails, and the words for it; "" where it will do."""
        setting = self.setting
        room = setting.arm.limit_margins(q) - setting.limit_reserve
        if room.min() < 0.0:
            j = int(np.argmin(room))
            low, high = setting.arm.joint_range.T
            return -float(room[j]), (
                f"{setting.arm.joint_names[j]} at {math.degrees(q[j]):.2f} deg; its range "
                f"{math.degrees(low[j]):.2f} … {math.degrees(high[j]):.2f} deg, "
                f"{math.degrees(setting.limit_reserve):g} deg kept at both ends"
            )
        jacobian = setting.arm.scaled_camera_jacobian(q, setting.flange_T_camera)
        least = float(np.linalg.svd(jacobian, compute_uv=False)[-1])
        if least < setting.singular_value:
            return setting.singular_value - least, (
                f"the arm is singular: smallest singular value {least:.4f}; at least "
                f"{setting.singular_value:g} is needed"
            )
        return self._too_close(q) or self._hidden(q) or (0.0, "")

    def _too_close(self, q: FloatArray) -> tuple[float, str] | None:
        """Return how much the worst pair lacks of its clearance, and words; None: none lacks any."""
        setting, bodies, worst = self.setting, self._bodies, None
        bodies.place(q)
        asked = bodies.asked(setting.clearance_around, setting.self_clearance)
        for near in bodies.near(float(asked.max(initial=0.0))):
            short = float(asked[near.pair]) - near.gap
            if short > (0.0 if worst is None else worst[0]):
                link, other = bodies.names(near.pair)
                left = spelled_gap(link, other, near.gap)
                worst = short, f"{left}; {1e3 * asked[near.pair]:g} mm are required"
        return worst

    def _hidden(self, q: FloatArray) -> tuple[float, str] | None:
        """Return how deep a body stands in a line of sight, and words; None: no point is hidden."""
        if self._in_sight is None:
            return None
        found = self.setting.own_sight_in(q, self._in_sight)
        return None if found.status == "free" else (found.kept - found.gap, found.what)
