"""No path exists where the arm cannot stand at an end pose."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray
from omniservo.planning.planning_problem import PlanningProblem
from omniservo.robots import Arm, ArmBodies, spelled_gap
from omniservo.robots.aspect import SINGULARITIES, aspects_of
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
    With one, those count that the setting's, which is regular, leads to without a singularity (`aspects_of`).
    """
    return _violation_at("goal", problem.initial_T_goal, _Stand(problem, setting, bodies), setting.start)


def free_postures(problem: PlanningProblem, setting: ArmSetting, bodies: ArmBodies) -> FloatArray:
    """Return the configurations (k, n) [rad] at the goal that are free and not beyond a singularity.

    That is, those of the aspect of the setting's, if there is one.
    """
    stand, start = _Stand(problem, setting, bodies), setting.start
    try:
        postures = setting.arm.inverse(setting.base_T_flange(problem.initial_T_goal))
    except InputError:  # out of reach
        return np.empty((0, setting.arm.dof))
    if start is not None:
        here, *there = aspects_of(setting.arm, np.vstack([start, postures]))
        postures = postures[(np.array(there) == here).all(axis=1)]
    return postures[[not stand.violation(q)[1] for q in postures]]


def _violation_at(
    pose: str, initial_T_camera: RigidTransform, stand: _Stand, start: FloatArray | None = None
) -> str:
    """Return why the arm cannot stand at a pose, coming from ``start`` if there is one; "" where it can."""
    setting = stand.setting
    try:
        postures = setting.arm.inverse(setting.base_T_flange(initial_T_camera))
    except InputError as error:
        return f"the {pose} pose cannot be reached: {error}"
    apart = _apart(setting.arm, postures)
    across = _across(setting.arm, start, apart)
    reasons = []
    for k in np.argsort([len(passed) for passed in across], kind="stable").tolist():
        reasons.append(stand.violation(apart[k]))
        if not reasons[-1][1]:
            return _beyond(pose, across[k], reasons[: across.count(())])
    known = "" if setting.arm.has_closed_form else " that a seeded search found"
    return _sentence(pose, min(reasons)[1], f" in any of {len(reasons)} joint configurations{known}")


def _across(arm: Arm, start: FloatArray | None, postures: FloatArray) -> list[tuple[str, ...]]:
    """Name the singularities on every way from ``start`` to each of the configurations (k, n)."""
    if start is None or not arm.has_closed_form:
        return [()] * len(postures)
    here, *there = aspects_of(arm, np.vstack([start, postures]))
    return [
        tuple(name for name, a, b in zip(SINGULARITIES, here, signs, strict=True) if a != b)
        for signs in there
    ]


def _beyond(pose: str, passed: tuple[str, ...], before: list[tuple[float, str]]) -> str:
    """Say which singularities are passed to the nearest free configuration; "": none.

    ``before``: what stops the arm in those configurations that it comes to without passing one.
    """
    if not passed:
        return ""
    short = min(before)[1] if before else "it is out of reach, or a joint's range ends"
    return (
        f"the {pose} pose is free only beyond a singularity ({', '.join(passed)}), "
        f"through which no plan leads; without one {short}"
    )


def _sentence(pose: str, reason: str, where: str) -> str:
    return f"the {pose} pose is not free{where}: {reason}" if reason else ""


def _apart(arm: Arm, postures: FloatArray) -> FloatArray:
    """Return of all joints that differ by full turns those farthest from their limits: the rest is alike."""
    ordered = postures[np.argsort(-arm.limit_margins(postures).min(axis=1), kind="stable")]
    _, first = np.unique(np.round(np.exp(1j * ordered), 6), axis=0, return_index=True)
    return ordered[np.sort(first)]


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
