"""Joint-aware planning beside sampling in joint space: what does each solve that the other does not?

Run: ``python -m benchmarks.joint_rrt [--tasks 300] [--hard 30] [--seconds 60]`` (needs `ompl`, of
requirements-bench.lock). The peer is OMPL's RRT-Connect over the arm's joints, from where the arm stands to
the postures nearest to it (`GOALS`) that reach the goal view. A posture is legal where the joints keep their
reserve, all bodies their clearances, and the camera at it every constraint of the problem: the same ones that
ours keeps. Ours also stays away from singular postures, through which no camera can be led by what it sees;
the peer is asked with and without that. Motions are looked at every 0.01 rad, and a path that it finds is
looked at again every 0.002 rad. Tasks are those of `benchmarks.whole_arm`. Ours goes first; the peer is asked
for tasks that ours does not solve though both end poses are free (at most ``--hard`` of them an arm, the
first ones), and for as many that ours solves, to tell how long either takes. Where an end pose is not free
there is no path for anybody.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from itertools import pairwise
from time import perf_counter
from typing import Any

import numpy as np
from benchmarks.tables import print_table
from benchmarks.whole_arm import camera_tasks
from ompl import base, geometric, util

from omniservo.geometry.arrays import FloatArray
from omniservo.planning import PlanningProblem
from omniservo.planning.certificate.margins import pose_margins
from omniservo.planning.problem_arrays import constraint_table_of
from omniservo.robots import load_arm, shipped_arms
from omniservo.robots.arm import SINGULAR_VALUE
from omniservo.whole_arm import ArmSetting, plan_with_arm

STEP = 0.01
"""[rad] between places of a motion that the peer looks at"""

FINE = 0.002
"""[rad] likewise once a path is found"""

GOALS = 8
"""With full turns a UR5e reaches a view in hundreds of postures, most of them on branches apart."""

ROUNDING = 1e-9


class Postures:
    """Which postures keep everything that is asked for."""

    def __init__(self, problem: PlanningProblem, setting: ArmSetting, regular: bool) -> None:
        self._regular = regular
        self._setting, self._bodies = setting, setting.bodies(problem.obstacles)
        self._constraints, self._optics, _, self._table = constraint_table_of(problem)
        self._asked = self._bodies.asked(setting.clearance_around, setting.self_clearance)
        self._to_initial = setting.base_T_initial.inv()
        self.asked_for = 0

    def legal(self, q: FloatArray) -> bool:
        """Tell whether a posture will do."""
        self.asked_for += 1
        setting = self._setting
        if setting.arm.limit_margins(q).min() < setting.limit_reserve - ROUNDING:
            return False
        if self._regular:
            jacobian = setting.arm.scaled_camera_jacobian(q, setting.flange_T_camera)
            if np.linalg.svd(jacobian, compute_uv=False)[-1] < SINGULAR_VALUE:
                return False
        pose = self._to_initial * setting.arm.base_T_flange(q) * setting.flange_T_camera
        turn, place = pose.rotation.as_quat(), np.array(pose.translation)
        margins = pose_margins(self._constraints, self._optics, self._table, turn, place, 0.5)[:, 0]
        if margins.min(initial=0.0) < -1e-6:
            return False
        self._bodies.place(q)
        near = self._bodies.near(float(self._asked.max(initial=0.0)))
        return all(found.gap >= self._asked[found.pair] - ROUNDING for found in near)


@dataclass
class Sampled:
    """What the peer made of a task."""

    solved: bool
    seconds: float
    asked_for: int


def sampled(problem: PlanningProblem, setting: ArmSetting, seconds: float, *, regular: bool) -> Sampled:
    """Return what RRT-Connect finds within so many seconds, singular postures left out if ``regular``."""
    postures, arm = Postures(problem, setting, regular), setting.arm
    goals = arm.inverse(setting.base_T_flange(problem.initial_T_goal))
    space = base.RealVectorStateSpace(arm.dof)
    bounds = base.RealVectorBounds(arm.dof)
    low, high = arm.joint_range.T
    for j in range(arm.dof):
        bounds.setLow(j, float(low[j]))
        bounds.setHigh(j, float(high[j]))
    space.setBounds(bounds)
    space.setLongestValidSegmentFraction(STEP / float(np.linalg.norm(high - low)))
    setup = geometric.SimpleSetup(space)
    setup.setStateValidityChecker(lambda state: postures.legal(_joints(state, arm.dof)))
    setup.setStartState(_state(space, setting.start))
    ends = base.GoalStates(setup.getSpaceInformation())
    for goal in sorted(filter(postures.legal, goals), key=lambda q: np.abs(q - setting.start).max())[:GOALS]:
        ends.addState(_state(space, goal))
    setup.setGoal(ends)
    setup.setPlanner(geometric.RRTConnect(setup.getSpaceInformation()))
    before = perf_counter()
    setup.solve(seconds)
    taken, found = perf_counter() - before, setup.haveExactSolutionPath()
    if found:
        path = setup.getSolutionPath()
        corners = [_joints(path.getState(i), arm.dof) for i in range(path.getStateCount())]
        found = all(_keeps(postures, a, b) for a, b in pairwise(corners))
    return Sampled(found, taken, postures.asked_for)


def _keeps(postures: Postures, begin: FloatArray, end: FloatArray) -> bool:
    count = int(np.ceil(np.linalg.norm(end - begin) / FINE)) + 1
    return all(postures.legal(q) for q in np.linspace(begin, end, count + 1))


def _joints(state: Any, n: int) -> FloatArray:
    return np.array([state[j] for j in range(n)])


def _state(space: base.RealVectorStateSpace, q: FloatArray | None) -> Any:
    assert q is not None
    state = space.allocState()
    for j, angle in enumerate(q):
        state[j] = float(angle)
    return state


def row(name: str, tasks: int, hard: int, seconds: float) -> str:
    """Return an arm's row."""
    arm, solved, infeasible, missed = load_arm(name), 0, 0, 0
    both: list[tuple[float, Sampled]] = []
    regular: list[bool] = []
    singular: list[bool] = []
    for problem, setting in camera_tasks(arm, tasks):
        ours = plan_with_arm(problem, setting)
        solved += ours.certified
        infeasible += ours.plan.status == "infeasible"
        missed += ours.plan.status == "not_found"
        if ours.certified and len(both) < hard:
            both.append((ours.seconds, sampled(problem, setting, seconds, regular=True)))
        elif ours.plan.status == "not_found" and len(regular) < hard:
            regular.append(sampled(problem, setting, seconds, regular=True).solved)
            singular.append(regular[-1] or sampled(problem, setting, seconds, regular=False).solved)
    shares = [solved / max(solved + missed * sum(s) / max(len(s), 1), 1) for s in (regular, singular)]
    ours_ms = 1e3 * np.median([taken for taken, _ in both] or [np.nan])
    theirs_ms = 1e3 * np.median([peer.seconds for _, peer in both] or [np.nan])
    return (
        f"{name} | {tasks} | {solved} | {infeasible} | {missed} | {sum(regular)} of {len(regular)} | "
        f"{shares[0]:.0%} | {sum(singular)} of {len(singular)} | {shares[1]:.0%} | "
        f"{sum(peer.solved for _, peer in both)} of {len(both)} | {ours_ms:.0f} | {theirs_ms:.0f}"
    )


def main() -> None:
    """Print a row for every arm."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--tasks", type=int, default=300, help="tasks an arm")
    parser.add_argument("--hard", type=int, default=30, help="tasks of each sort that the peer is asked for")
    parser.add_argument("--seconds", type=float, default=60.0, help="that the peer may take for one")
    parser.add_argument("--arms", nargs="*", default=list(shipped_arms()))
    asked = parser.parse_args()
    util.setLogLevel(util.LogLevel.LOG_NONE)
    print_table(
        "| arm | tasks | ours solves | an end is not free | ours does not | of those RRT-Connect does | "
        "ours / either | through singular postures | ours / either | of ours it does | ours, ms | its, ms |",
        (row(name, asked.tasks, asked.hard, asked.seconds) for name in asked.arms),
    )


if __name__ == "__main__":
    main()
