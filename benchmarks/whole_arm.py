"""The whole arm: certificates of random joint paths against dense collision detection, and random tasks.

Run: ``python -m benchmarks.whole_arm [--paths 10000] [--tasks 300]``. Both are judged by MuJoCo's collision
detection, by its own rules of who may meet whom, in steps of at most 0.1 mm of any point of the arm: another
algorithm than the distances and slabs that proofs are made of. Times are wall-clock of one call each, median.
Certified plans are then executed in the closed loop, with exact pixels, by drives with acceleration limits:
"at fault" counts runs in which a joint leaves its range or anything touches at any millisecond, or that do
not end at the goal within `AT_GOAL_PX`.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from time import perf_counter
from typing import Any

import mujoco
import numpy as np
import numpy.typing as npt
from benchmarks.arm_runs import Truth, execute
from benchmarks.tables import print_table
from scipy.spatial.transform import RigidTransform
from tests.robots.joint_paths import straight_joint_path
from tests.whole_arm.arm_scenes import random_task

from omniservo.planning import PlanningProblem, plan_path
from omniservo.robots import (
    CAMERA_HOUSING,
    SELF_CLEARANCE,
    Arm,
    ArmBodies,
    JointPath,
    Solid,
    arm_clearance,
    follow_path,
    load_arm,
    shipped_arms,
)
from omniservo.whole_arm import ArmPlan, ArmSetting, plan_with_arm
from omniservo.whole_arm.solids_of import solids_of

CLEARANCE = 0.01
"""[m] asked of the arm and what stands around"""

STEP = 1e-4
"""[m] that any point of the arm moves between two places where collisions are looked for"""

TOLERANCE = 1e-5
"""[m] of MuJoCo's collision detection"""

PATIENT = 1000
"""starts for tasks that few do not solve"""

AT_GOAL_PX = 0.5
"""rms of the points to the goal image"""


class Detector:
    """MuJoCo's collision detection on a model of its own."""

    def __init__(self, arm: Arm, mounted: list[Solid], surroundings: list[Solid]) -> None:
        spec = arm.spec()
        holder = spec.body(arm.flange_link).add_body(name="camera")
        for solid in mounted:
            solid.moved(arm.link_T_flange).add_to(spec, holder).mass = 1e-3
        for solid in surroundings:
            solid.add_to(spec, spec.worldbody.add_body(name=solid.name))
        self._model: Any = spec.compile()
        self._model.geom_margin[:] = CLEARANCE
        self._data = mujoco.MjData(self._model)
        names = [solid.name for solid in surroundings]
        around = [str(self._model.body(int(b)).name) in names for b in self._model.geom_bodyid]
        self._around = np.array(around)

    def short(self, q: npt.NDArray[np.float64]) -> float:
        """Return by how much the closest pair misses its clearance [m]; negative or 0: none does."""
        self._data.qpos[:] = q
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mj_collision(self._model, self._data)
        contacts = self._data.contact
        if not self._data.ncon:
            return 0.0
        asked = np.where(self._around[contacts.geom].any(axis=1), CLEARANCE, SELF_CLEARANCE)
        return float(max(0.0, (asked - contacts.dist).max()))

    def worst(self, arm: Arm, path: JointPath) -> float:
        """Return by how much the path misses a clearance, at steps of `STEP` [m]."""
        fine = np.linspace(0.0, path.w[-1], 201)
        turned = np.abs(np.diff(path(fine), axis=0)).sum(axis=0)
        count = int(np.ceil((turned.sum() * (arm.reach + 0.2)) / STEP))
        return max(self.short(q) for q in path(np.linspace(0.0, path.w[-1], min(count, 20_000))))


def certificate_row(name: str, paths: int) -> str:
    """Return an arm's row: how many of its certificates dense detection contradicts."""
    arm, random = load_arm(name), np.random.default_rng(0)
    proven, contradicted, undecided, times = 0, 0, 0, []
    for number in range(paths):
        if number % 100 == 0:
            around = _surroundings(random)
            mounted = [
                solid.moved(RigidTransform.from_translation([0, 0, 0.0905])) for solid in CAMERA_HOUSING
            ]
            bodies = ArmBodies(arm, mounted=mounted, surroundings=around)
            detector = Detector(arm, mounted, around)
        begin = 0.8 * random.uniform(*arm.joint_range.T)
        path = straight_joint_path(begin, begin + random.uniform(-0.3, 0.3, arm.dof))
        before = perf_counter()
        found = arm_clearance(bodies, path, clearance=CLEARANCE)
        times.append(perf_counter() - before)
        undecided += found.status == "undecided"
        if found.status == "clear":
            proven += 1
            contradicted += detector.worst(arm, path) > TOLERANCE
    return f"{name} | {paths} | {proven} | {undecided} | {contradicted} | {1e3 * np.median(times):.1f}"


def _surroundings(random: np.random.Generator) -> list[Solid]:
    table = Solid.box("table", RigidTransform.from_translation([0.5, 0.0, -0.1]), [0.4, 0.6, 0.05])
    balls = [
        Solid.sphere(
            f"ball {i}", random.uniform([-0.6, -0.6, 0.1], [0.6, 0.6, 1.0]), random.uniform(0.02, 0.08)
        )
        for i in range(4)
    ]
    return [table, *balls]


def camera_tasks(arm: Arm, count: int) -> Iterator[tuple[PlanningProblem, ArmSetting]]:
    """Yield so many random tasks that a camera alone can do."""
    done = seed = 0
    while done < count:
        problem, setting = random_task(arm, np.random.default_rng([2026, seed]))
        seed += 1
        if plan_path(problem).status == "certified":
            done += 1
            yield problem, setting


def task_row(name: str, tasks: int) -> str:
    """Return an arm's row: what became of its tasks, and whether the arm kept what was promised."""
    arm, count = load_arm(name), {"certified": 0, "infeasible": 0, "not_found": 0}
    wrong, faults, patient, times, checks = 0, 0, 0, [], []
    for problem, setting in camera_tasks(arm, tasks):
        found = plan_with_arm(problem, setting)
        count[found.plan.status] += 1
        if found.plan.status == "not_found":
            patient += plan_with_arm(problem, setting, attempts=PATIENT).certified
        if found.branch is None or not found.certified:
            continue
        times.append(found.seconds)
        checks.append(_checking_time(problem, setting, found.plan.path))
        q = found.branch(np.linspace(0.0, 1.0, 2001))
        low, high = arm.joint_range.T
        mounted = [solid.moved(setting.flange_T_camera) for solid in setting.mounted]
        around = list(solids_of(problem.obstacles, setting.base_T_initial))
        short = Detector(arm, mounted, around).worst(arm, found.branch)
        wrong += bool((q < low).any() or (q > high).any() or short > TOLERANCE)
        faults += _at_fault(problem, setting, found)
    shares = f"{count['certified']} | {count['infeasible']} | {count['not_found']} | {patient}"
    middle, most, check = np.median(times), np.quantile(times, 0.9), np.median(checks)
    return (
        f"{name} | {tasks} | {shares} | {wrong} | {1e3 * middle:.0f} / {1e3 * most:.0f} | {1e3 * check:.0f}"
        f" | {count['certified']} | {faults}"
    )


def _at_fault(problem: PlanningProblem, setting: ArmSetting, found: ArmPlan) -> bool:
    """Execute a plan; tell whether anything went wrong."""
    assert found.branch is not None
    assert setting.start is not None
    balls = [(np.array(o.center), o.radius) for o in problem.obstacles]
    truth = Truth(setting.arm, setting.start, setting.flange_T_camera, problem.camera, problem.points, balls)
    run = execute(truth, found.plan, found.branch, np.random.default_rng(0), noise_px=0.0)
    low, high = setting.arm.joint_range.T
    outside = bool(((run.joints < low) | (run.joints > high)).any())
    return outside or bool(run.contacts) or bool(run.stop) or not run.goal_error_px < AT_GOAL_PX


def _checking_time(problem: PlanningProblem, setting: ArmSetting, path: Any) -> float:
    """Return the seconds that joint path and clearance of one branch take."""
    bodies = setting.bodies(problem.obstacles)
    before = perf_counter()
    followed = follow_path(
        setting.arm, path, setting.base_T_initial, setting.flange_T_camera, start=setting.start
    )
    arm_clearance(bodies, followed.best, clearance=setting.clearance_around)
    return perf_counter() - before


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--paths", type=int, default=10_000, help="joint paths, all arms together")
    parser.add_argument("--tasks", type=int, default=300, help="tasks an arm")
    asked = parser.parse_args()
    names = shipped_arms()

    def certificates() -> Iterator[str]:
        for name in names:
            yield certificate_row(name, asked.paths // len(names))

    def tasks() -> Iterator[str]:
        for name in names:
            yield task_row(name, asked.tasks)

    if asked.paths:
        print_table(
            "| arm | paths | proven clear | undecided | of the proven: contradicted | ms |", certificates()
        )
        print()
    if asked.tasks:
        print_table(
            "| arm | tasks | certified | infeasible | not found | of those with 1 000 starts | broken | "
            "ms, median / 90% | to check | executed | at fault |",
            tasks(),
        )


if __name__ == "__main__":
    main()
