"""From a problem and an arm to a camera path that the whole arm can follow."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from omniservo.geometry.arrays import FloatArray, finite_number
from omniservo.planning.degrees import Degrees
from omniservo.planning.end_poses import violation_at_end
from omniservo.planning.judged_plan import infeasible_plan
from omniservo.planning.planning_problem import PlanningProblem
from omniservo.planning.time_budget import TimeBudget
from omniservo.robots import ArmBodies
from omniservo.whole_arm.arm_ends import violation_at_goal, violation_at_start
from omniservo.whole_arm.arm_plan import ArmPlan
from omniservo.whole_arm.arm_planner import ATTEMPTS, NEAR, ArmPlanner
from omniservo.whole_arm.arm_setting import ArmSetting

DEGREE = 6
"""of rotation and translation, where the arm can follow no path of the problem's lower degrees"""

REGULAR = 0.1
"""A path that comes nearer to a singularity on its way is moved to keep this singular value: an arm that is
led by images deviates from its path, and a stretched elbow is straight a millimetre farther out."""

AGAIN = 3
"""Searches with these degrees, each with its detours in other directions."""

_OF_ENDS = 0.95
"""It need not keep more than so much of what the arm has where the path begins and ends."""


def plan_with_arm(
    problem: PlanningProblem,
    setting: ArmSetting,
    *,
    seed: int = 0,
    attempts: int = ATTEMPTS,
    time_budget: float | None = None,
) -> ArmPlan:
    """Return a certified camera path that the arm can follow on one branch, clear of everything.

    Paths that `plan_path` would find are followed by the arm; one that it cannot follow is moved until it
    can: its joint limits, its smallest singular value and the gaps of its bodies take part in the descent
    through J⁻¹, beside the camera's own constraints. If that fails, or where a problem asks for sight and a
    link hides a point on the way (`own_sight`), another start is taken. After `ATTEMPTS` of them it is paths
    near curves in joint space, from where the arm stands to configurations at the goal (`joint_curves`). If
    it is the arm that refuses all of them, all of that is done again with degrees of `DEGREE`, which the
    problem of the plan then states. What is found is moved away from singularities (`REGULAR`) if it can be.

    Args:
        problem: what the camera has to keep; its obstacles count for the whole arm, too.
        setting: the arm, where it stands, and what it has to keep.
        seed: turns the directions in which detours are tried.
        attempts: camera paths from different starts at most, in each search, up to the thousand that
            `plan_path` tries; what is beyond `ATTEMPTS` comes after the curves, which are not counted.
        time_budget: [s] after which no other start is taken; None: all of them are.

    Raises:
        InputError: an obstacle that cannot be judged for the whole arm; or what `plan_path` refuses.
    """
    budget = TimeBudget(time_budget)
    finite_number("seed", seed, minimum=0)
    finite_number("attempts", attempts, minimum=1)
    bodies = setting.bodies(problem.obstacles)
    reason = violation_at_end(problem) or violation_at_start(problem, setting, bodies)
    if not reason and setting.arm.has_closed_form:  # elsewhere that takes longer than most plans
        reason = violation_at_goal(problem, setting, bodies)
    if not reason:
        searches = _Searches(problem, setting, bodies, int(seed), budget)
        found = searches.planned(attempts)
        if found.certified:
            return searches.away_from_singularities(found)
        if setting.arm.has_closed_form:
            return found
        reason = violation_at_goal(problem, setting, bodies)
        if not reason:
            return found
    plan = infeasible_plan(problem, budget.begin, "certified", reason)
    return ArmPlan(plan, None, None, None, time.perf_counter() - budget.begin, 0)


@dataclass(frozen=True, eq=False)
class _Searches:
    """All searches for one problem and one arm, where both end poses are free."""

    problem: PlanningProblem
    setting: ArmSetting
    bodies: ArmBodies
    seed: int
    budget: TimeBudget

    def planned(self, attempts: int) -> ArmPlan:
        """Return a plan with the problem's degrees, or else with `DEGREE` if it is the arm that refuses."""
        found = bent = self._planner(self.problem, self.setting).plan(attempts=attempts)
        given, tried = self.problem.degrees, found.attempts
        degrees = Degrees(max(DEGREE, given.rotation), max(DEGREE, given.translation))
        for turned in range(int(degrees == given), AGAIN):
            if bent.certified or bent.branch is None or self.budget.is_used_up:
                break
            problem = replace(self.problem, degrees=degrees)
            bent = self._planner(problem, self.setting, turned).plan(attempts=attempts)
            tried += bent.attempts
        return replace(bent if bent.certified else found, attempts=tried, seconds=bent.seconds)

    def away_from_singularities(self, found: ArmPlan) -> ArmPlan:
        """Return a certified plan moved until its way keeps `REGULAR`; as it is where it does or cannot."""
        branch, path = found.branch, found.plan.path
        if branch is None or path is None or self.budget.is_used_up:
            return found
        kept = min(REGULAR, _OF_ENDS * float(branch.singular_values[[0, -1]].min()))
        if branch.singular_values.min() >= kept:
            return found
        setting = replace(self.setting, singular_value=kept)
        planner = self._planner(found.plan.problem, setting, aims=[found.plan.aim])
        moved = planner.moved_from(path, branch(np.linspace(0.0, 1.0, NEAR)))
        return found if moved is None else replace(moved, attempts=found.attempts)

    def _planner(
        self,
        problem: PlanningProblem,
        setting: ArmSetting,
        turned: int = 0,
        aims: Sequence[FloatArray | None] | None = None,
    ) -> ArmPlanner:
        return ArmPlanner(problem, setting, self.bodies, self.seed + turned, self.budget, aims=aims)
