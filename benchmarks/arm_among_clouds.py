"""What a point cloud costs a whole arm: time, clearance, and plans that are no longer found.

Run: ``python -m benchmarks.arm_among_clouds [--tasks 40]``. Random tasks for a whole arm
(`tests.whole_arm.arm_scenes`), a table under it; what stands around is stated as bodies, or as one cloud of
points on their surfaces, half of them on the table, 0.5 mm of noise, 2 mm of radius. "Boxes": those of a
cloud that was not seen before, its tree included; "arm": an arm among them (`ArmSetting.bodies`). "Lost": by
how much the least gap of arm and camera to boxes is smaller than to the bodies, at nine places of every plan
found, where that is below 0.1 m. "Kept": a look of a `Replanner`, stated another cloud of the same things,
with all that it takes; "again": one of the balls elsewhere, so that another way is planned. Times are the
processor's, warm, median and 90%.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from time import process_time
from typing import Any

import numpy as np
from benchmarks.replan import AHEAD, LEAST_SECONDS, PERIOD, SHARE, moved
from benchmarks.tables import print_table
from scipy.spatial.transform import RigidTransform, Rotation
from tests.whole_arm.arm_scenes import random_task

from omniservo.errors import Blocked
from omniservo.planning import Box, Cloud, PlanningProblem, plan_path
from omniservo.planning.obstacles.obstacle import Obstacle
from omniservo.robots import link_gaps, load_arm, shipped_arms
from omniservo.servoing import PathLimits, RestToRestLaw
from omniservo.tracking import FollowingArm, PathTracker, Replanner, ReplanOptions
from omniservo.whole_arm import ArmPlan, ArmSetting, plan_with_arm

COUNTS = (1_000, 10_000, 100_000)
NOISE, RADIUS, NEAR = 5e-4, 2e-3, 0.1
TABLE = np.array([[0.1, -0.6, -0.05], [0.9, 0.6, -0.05]])
"""[m] two corners of its face in the base frame"""


def surface(random: np.random.Generator, balls: tuple[Any, ...], table: Box, count: int) -> Cloud:
    """Return a cloud of so many points on balls and table."""
    face = random.uniform(-1.0, 1.0, (count // 2, 3)) * table.half_extents
    turn = RigidTransform.from_components(table.center, Rotation.from_quat(np.array(table.quaternion)))
    out = random.normal(size=(count - len(face), 3))
    which = random.integers(len(balls), size=len(out))
    centers, radii = np.array([ball.center for ball in balls]), np.array([ball.radius for ball in balls])
    round_ones = centers[which] + radii[which, None] * out / np.linalg.norm(out, axis=1)[:, None]
    points = np.vstack([turn.apply(face), round_ones])
    return Cloud(points + NOISE * random.normal(size=points.shape), RADIUS)


def table_of(setting: ArmSetting) -> Box:
    """Return the table in the initial camera frame."""
    middle = TABLE.mean(axis=0) - [0.0, 0.0, 1e-4]
    own = setting.base_T_initial.inv() * RigidTransform.from_translation(middle)
    half = 0.5 * np.ptp(TABLE, axis=0) + [0.0, 0.0, 1e-4]
    return Box(own.translation, half, own.rotation.as_quat())


def tasks(name: str, count: int) -> Iterator[tuple[PlanningProblem, ArmSetting, Box]]:
    """Yield so many tasks that the camera alone can do, their obstacles still without the table."""
    arm, seed, done = load_arm(name), 0, 0
    while done < count:
        problem, setting = random_task(arm, np.random.default_rng([2026, seed]))
        seed += 1
        if plan_path(problem).status == "certified":
            done += 1
            yield problem, setting, table_of(setting)


def timed(call: Any) -> tuple[Any, float]:
    """Return what a call returns, and its time [ms]."""
    begin = process_time()
    found = call()
    return found, 1e3 * (process_time() - begin)


def lost(setting: ArmSetting, found: ArmPlan, bodies: tuple[Obstacle, ...], cloud: Cloud) -> list[float]:
    """Return by how much gaps to the boxes are smaller than those to the bodies [mm]."""
    assert found.branch is not None
    joints = found.branch(np.linspace(0.0, 1.0, 9))
    true, boxes = (
        np.min(list(link_gaps(setting.bodies(around), joints).values()), axis=0)
        for around in (bodies, (cloud,))
    )
    return (1e3 * (true - boxes)[true < NEAR]).tolist()


def looks(
    random: np.random.Generator, setting: ArmSetting, found: ArmPlan, balls: Any, table: Box, count: int
) -> tuple[float | None, float | None]:
    """Return the time [ms] of a look at another cloud of the same things, and of one with a ball elsewhere.

    None: the first did not keep the way, the second needed no other or found none.
    """
    assert found.branch is not None

    def limits(path: Any, joints: Any) -> PathLimits:
        return PathLimits(joints, SHARE * setting.arm.joint_speed, SHARE * setting.arm.joint_acceleration)

    law = RestToRestLaw.for_limits(limits(None, found.branch), least_duration=LEAST_SECONDS)
    tracker = PathTracker(found.plan, found.plan.problem.camera, time_law=law)
    carried = FollowingArm(setting, found.branch, limits)
    replanner = Replanner(tracker, found.plan, arm=carried, options=ReplanOptions(ahead=AHEAD))
    time = random.uniform(0.1, 0.5) * law.duration

    def look(cloud: Cloud, time: float, outcome: str) -> float | None:
        _, taken = timed(lambda: _looked(replanner, cloud, time))
        return taken if replanner.events[-1].outcome == outcome else None

    kept = look(surface(random, balls, table, count), time, "kept")
    there = moved(random, replace(found.plan, problem=replace(found.plan.problem, obstacles=balls)), 0.5)
    return kept, look(surface(random, there, table, count), time + PERIOD, "replanned")


def _looked(replanner: Replanner, cloud: Cloud, time: float) -> None:
    replanner.set_obstacles([cloud])
    with suppress(Blocked):
        replanner.look(time)


def row(name: str, count: int | None, given: list[tuple[PlanningProblem, ArmSetting, Box]]) -> str:
    """Return the line of an arm and a number of points, None: bodies."""
    times: dict[str, list[float]] = {key: [] for key in ("boxes", "arm", "plan", "lost", "kept", "again")}
    certified = 0
    for number, (problem, setting, table) in enumerate(given):
        random, balls = np.random.default_rng([9, number]), problem.obstacles
        around: tuple[Obstacle, ...] = (table, *balls)
        if count is not None:
            cloud = surface(random, balls, table, count)
            around = (cloud,)
            times["boxes"].append(timed(lambda cloud=cloud: cloud.boxes)[1])
        times["arm"].append(timed(lambda s=setting, a=around: s.bodies(a))[1])
        asked = replace(problem, obstacles=around)
        found, taken = timed(lambda p=asked, s=setting: plan_with_arm(p, s))
        if not found.certified:
            continue
        certified += 1
        times["plan"].append(taken)
        if count is not None:
            times["lost"] += lost(setting, found, (table, *balls), cloud)
            kept, again = looks(random, setting, found, balls, table, count)
            times["kept"] += [] if kept is None else [kept]
            times["again"] += [] if again is None else [again]
    cells = " | ".join(_spelled(times[key]) for key in times)
    return f"{name} | {'bodies' if count is None else count} | {certified} | {cells}"


def _spelled(values: list[float]) -> str:
    if not values:
        return "–"
    middle, high = np.percentile(values, [50, 90])
    return f"{middle:.1f} / {high:.1f}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--tasks", type=int, default=40, help="of each arm")
    count = parser.parse_args().tasks
    head = "| arm | around | plans | boxes [ms] | arm [ms] | plan [ms] | lost [mm] | kept [ms] | again [ms] |"
    print_table(head, _rows(count))


def _rows(count: int) -> Iterator[str]:
    for name in shipped_arms():
        given = list(tasks(name, count))
        row(name, COUNTS[0], given[:2])  # what is compiled at first
        for points in (None, *COUNTS):
            yield row(name, points, given)


if __name__ == "__main__":
    main()
