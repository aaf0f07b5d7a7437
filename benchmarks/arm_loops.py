"""Whole arms at a stated risk of 1%, executed in the closed loop: how often is anything violated?

Run: ``python -m benchmarks.arm_loops [--count 1000] [--arm NAME] [--looks 2]``. A task: a target of 20
points, none to come nearer than 5 cm, a goal view and one to three balls about the way there
(`tests.whole_arm.arm_scenes`), such that `plan_with_arm` finds a plan where everything is known exactly.
Then nothing is: the two pictures have 0.5 px of noise; focal lengths and principal point are each off by 2%
(1σ); the camera's mount by 2 mm and 0.2° (rms); motion and structure come from the pictures, their scale from
the arm's joint readings and that mount. Half of the risk is the tracking's (the shipped tube), a quarter the
camera's demands', a quarter the links'.

Where there is no plan the arm looks again (`omniservo.looks`), up to ``--looks`` times: it moves a little,
sees the points with noise from there, and plans from there. Its moves are judged, too.

With ``--rendered``, which never looks again, the points are dots, found in rendered pictures from the first
two on, which dot is which told by the truth in these two; the noise is added to where they are found. Tasks
in which fewer than `LEAST_FOUND` are found in both are left out.

The plan is followed on projected pixels with 0.5 px of noise at 30 frames a second, 20 ms late, by simulated
drives with acceleration limits. Judged is the truth: MuJoCo's distances of all bodies every 10 ms (10 mm are
asked to the balls, 2 mm of the arm's own parts), the camera's centre to the balls (20 mm), the true points
in the true image, joint ranges, and whether a run that nobody stopped ends at the goal.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from benchmarks.arm_looks import Looked, Seen, look_on, standing_of
from benchmarks.arm_runs import (
    FAR,
    LEAST_DISTANCE,
    NOISE_PX,
    TARGET,
    VISIBLE_PX,
    ArmRun,
    Gaps,
    Truth,
    dots_of,
    execute,
    found_in_picture,
)
from scipy.spatial.transform import RigidTransform
from scipy.stats import beta
from tests.whole_arm.arm_scenes import random_task

from omniservo.cameras import UnifiedCamera
from omniservo.errors import InputError
from omniservo.estimation import TwoViewEstimate, estimate_two_view
from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.looks import ViewingState
from omniservo.planning import PlanningProblem, widened_evenly
from omniservo.risk import RiskPlan, plan_arm_with_risk
from omniservo.robots import Arm, JointPath, TrackingTube, follow_path, load_arm, shipped_arms, shipped_tube
from omniservo.whole_arm import ArmSetting, plan_with_arm

RISK, TRACKING_PART = 0.01, 0.5
INTRINSICS = 0.02
MOUNT_M, MOUNT_RAD = 2e-3, np.radians(0.2)
"""rms of the length of either error"""

SEED = 2026
LEAST_FOUND = 10

AT_GOAL_PX = 5.0
"""rms of the true points to the goal image; a run that ends farther off, and that nothing stopped,
diverged"""


@dataclass(frozen=True, eq=False)
class Known:
    """What the robot takes for true."""

    camera: UnifiedCamera
    flange_T_camera: RigidTransform
    rows: IntArray
    """of the true points that are in both pictures"""
    pictures: tuple[FloatArray, FloatArray]
    estimate: TwoViewEstimate
    camera_covariance: FloatArray
    mount_covariance: FloatArray


@dataclass(frozen=True)
class Outcome:
    """What became of one task."""

    status: str
    """"executed", "no estimate", "no plan", "not found" in a rendered picture"""
    failures: tuple[str, ...] = ()
    stop: str = ""
    kept: float = np.nan
    """clearance planned with beyond what is asked: most that a link strays, and what was added [m]"""
    used: float = np.nan
    """how much less the executed run had left than the plan, as planned [m]"""
    left: float = np.nan
    """least that any pair of bodies had left, executed [m]"""
    looks: int = 0
    """how often was looked again"""


def projected(
    truth: Truth, problem: PlanningProblem, random: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Return the two pictures' pixels, with noise."""
    ends = [truth.points, problem.initial_T_goal.inv().apply(truth.points)]
    first, second = (
        truth.camera.project(c)[0] + NOISE_PX * random.standard_normal((len(c), 2)) for c in ends
    )
    return first, second


def known_of(
    truth: Truth,
    problem: PlanningProblem,
    random: np.random.Generator,
    pictures: tuple[FloatArray, FloatArray],
) -> Known:
    """Return what pictures, calibration and hand-eye calibration say; NaN in pictures: not found."""
    camera = truth.camera
    own = np.array([camera.fx, camera.fy, camera.cx, camera.cy])
    wrong = own * (1.0 + INTRINSICS * random.standard_normal(4))
    stated = replace(camera, fx=wrong[0], fy=wrong[1], cx=wrong[2], cy=wrong[3])
    lens = np.diag([*(INTRINSICS * own) ** 2, 0.0])
    sigma = np.repeat([MOUNT_M, MOUNT_RAD], 3) / np.sqrt(3.0)
    error = sigma * random.standard_normal(6)
    mount = truth.flange_T_camera * RigidTransform.from_exp_coords(np.concatenate([error[3:], error[:3]]))
    rows = np.flatnonzero(np.isfinite(np.hstack(pictures)).all(axis=1))
    first, second = (picture[rows] for picture in pictures)
    flange = truth.base_T_initial * problem.initial_T_goal * truth.flange_T_camera.inv()
    begin = truth.arm.base_T_flange(truth.start)
    way = (flange * mount).translation - (begin * mount).translation
    length = float(np.linalg.norm(way))
    turned = (flange.rotation.as_matrix() - begin.rotation.as_matrix()).T @ way / length
    estimate = estimate_two_view(
        stated, first, second, scale=length, calibration_covariance=lens,
        scale_sigma=float(np.linalg.norm(turned)) * sigma[0] / length,
    )  # fmt: skip
    return Known(stated, mount, rows, (first, second), estimate, lens, np.diag(sigma**2))


def planned(
    truth: Truth,
    problem: PlanningProblem,
    setting: ArmSetting,
    known: Known,
    measured: TrackingTube,
    seed: int,
) -> tuple[RiskPlan, ArmSetting]:
    """Return the plan at the stated risk, and the setting that it was made in."""
    tube = measured.at(TRACKING_PART * RISK)
    stated = replace(
        setting,
        base_T_initial=truth.arm.base_T_flange(truth.start) * known.flange_T_camera,
        flange_T_camera=known.flange_T_camera,
        tube=tube,
    )
    asked = replace(problem, camera=known.camera, visibility_margin=VISIBLE_PX)
    answer = plan_arm_with_risk(
        widened_evenly(asked, tube.position, tube.image), stated, known.estimate,
        risk=RISK * (1.0 - TRACKING_PART), mount_covariance=known.mount_covariance, seed=seed,
    )  # fmt: skip
    return answer, stated


def looked_again(
    truth: Truth,
    problem: PlanningProblem,
    setting: ArmSetting,
    known: Known,
    measured: TrackingTube,
    looks: int,
    random: np.random.Generator,
    seed: int,
) -> Looked | None:
    """Return what looking again comes to; None: there is no plan after that either.

    The truth's points are those that are in both pictures.
    """
    to_camera = np.eye(6)
    to_camera[:3, :3] = known.flange_T_camera.rotation.as_matrix().T
    mount = to_camera @ known.mount_covariance @ to_camera.T
    goal = truth.base_T_initial * problem.initial_T_goal * truth.flange_T_camera.inv()
    seen = Seen(
        known.estimate, known.camera_covariance, mount, goal * known.flange_T_camera, known.pictures[1],
        ((truth.start, known.pictures[0]),),
    )  # fmt: skip
    stated = replace(
        setting,
        base_T_initial=truth.arm.base_T_flange(truth.start) * known.flange_T_camera,
        flange_T_camera=known.flange_T_camera,
    )
    asked = replace(problem, camera=known.camera, visibility_margin=VISIBLE_PX)
    here = standing_of(asked, stated, measured.at(TRACKING_PART * RISK), seen)

    def plan_from(there: ViewingState) -> RiskPlan:
        return plan_arm_with_risk(
            there.problem, there.planned_setting, there.estimate, risk=RISK * (1.0 - TRACKING_PART),
            mount_covariance=known.mount_covariance, seed=seed,
        )  # fmt: skip

    return look_on(here, seen, truth, plan_from, looks, random, seed)


def outcome(
    arm: Arm, measured: TrackingTube, seed: int, *, rendered: bool = False, looks: int = 0
) -> Outcome | None:
    """Return what becomes of a task; None where it has no plan though everything is known."""
    random = np.random.default_rng([SEED, seed])
    problem, setting = random_task(arm, random, **TARGET)
    problem = replace(problem, least_distance=LEAST_DISTANCE)
    if setting.start is None or (exact := plan_with_arm(problem, setting)).branch is None:
        return None
    if not exact.certified:
        return None
    balls = [(np.array(o.center), o.radius) for o in problem.obstacles]
    truth = Truth(arm, setting.start, setting.flange_T_camera, problem.camera, problem.points, balls)
    dots = dots_of(truth, problem.initial_T_goal) if rendered else None
    if dots is None:
        pictures = projected(truth, problem, random)
    else:
        ends = exact.branch(np.array([0.0, 1.0]))
        pictures = tuple(found_in_picture(truth, q, dots, random)[0] for q in ends)
        if np.isfinite(np.hstack(pictures)).all(axis=1).sum() < LEAST_FOUND:
            return Outcome("not found")
    try:
        known = known_of(truth, problem, random, pictures)
    except InputError:  # a noisy pixel outside the domain of the camera that was stated
        return Outcome("no estimate")
    if known.estimate.status != "ok":
        return Outcome("no estimate")
    answer = None
    with suppress(InputError):  # the start keeps too little of its ranges, or nothing is left of the image
        answer, stated = planned(truth, problem, setting, known, measured, seed)
    estimate, camera, first = known.estimate, known.camera, known.pictures[0]
    truth, again = replace(truth, points=truth.points[known.rows]), None
    if answer is None or not answer.ok:
        if looks and not rendered:
            again = looked_again(truth, problem, setting, known, measured, looks, random, seed)
        if again is None:
            return Outcome("no plan")
        here, answer, truth, first = again.standing, again.answer, again.truth, again.pixels
        estimate, camera, stated = here.estimate, here.problem.camera, here.planned_setting
    path = answer.plan.path
    assert path is not None
    frames = stated.base_T_initial, stated.flange_T_camera
    branch = follow_path(arm, path, *frames, start=truth.start, aim=answer.plan.aim).best
    inliers = np.flatnonzero(estimate.inliers)
    followed = replace(truth, points=truth.points[inliers])
    pictures = first[inliers], known.pictures[1][inliers]
    run = execute(
        followed, answer.plan, branch, random,
        camera=camera, flange_T_camera=known.flange_T_camera, pictures=pictures, dots=dots,
    )  # fmt: skip
    asked = replace(stated, clearance=setting.clearance)
    judged = _judged(followed, problem, asked, branch, answer, run)
    if again is None:
        return judged
    return replace(judged, failures=(*judged.failures, *sorted(again.failures)), looks=again.looks)


def _judged(
    truth: Truth,
    problem: PlanningProblem,
    stated: ArmSetting,
    branch: JointPath,
    answer: RiskPlan,
    run: ArmRun,
) -> Outcome:
    asked = float(stated.clearance_around), stated.self_clearance
    left = Gaps(truth, *asked).least(run.joints[::10])
    believed = replace(truth, flange_T_camera=stated.flange_T_camera)
    before = Gaps(believed, *asked).least(branch(np.linspace(0.0, 1.0, 101)))
    low, high = truth.arm.joint_range.T
    centre = min(
        (float(np.linalg.norm(run.centres - c, axis=1).min()) - r for c, r in truth.balls), default=np.inf
    )
    failures = {
        "a body's clearance": left < 0.0,
        "camera's clearance": centre < problem.clearance,
        "a point out of view": run.visible < 0.0,
        "joint range": bool(((run.joints < low) | (run.joints > high)).any()),
        "diverged": not run.stop and run.goal_error_px > AT_GOAL_PX,
    }
    assert stated.tube is not None
    kept = max(stated.tube.links.values()) + (0.0 if answer.links is None else answer.links.added)
    used = before - left if before < FAR else np.nan
    return Outcome("executed", tuple(k for k, bad in failures.items() if bad), run.stop, kept, used, left)


def outcomes(
    arms: list[str], count: int, first: int, *, rendered: bool, looks: int
) -> Iterator[tuple[str, Outcome]]:
    """Yield what becomes of tasks, arm by arm in turn, until so many were executed."""
    loaded = {name: (load_arm(name), shipped_tube(name)) for name in arms}
    seed, executed = first, 0
    while executed < count:
        seed += 1
        for name, (arm, measured) in loaded.items():
            found = outcome(arm, measured, seed, rendered=rendered, looks=looks)
            if found is not None:
                executed += found.status == "executed"
                yield name, found


def report(found: list[tuple[str, Outcome]]) -> Iterator[str]:
    """Say it in a table's rows, arm by arm and all together."""
    for name in [*dict.fromkeys(name for name, _ in found), "all"]:
        of_arm = [o for other, o in found if name in (other, "all")]
        ran = [o for o in of_arm if o.status == "executed"]
        bad = [o for o in ran if o.failures]
        n, k = len(ran), len(bad)
        if not n:
            continue
        low = float(beta.ppf(0.025, k, n - k + 1)) if k else 0.0
        high = float(beta.ppf(0.975, k + 1, n - k)) if k < n else 1.0
        counts: Any = Counter(o.status for o in of_arm)
        stops = Counter(o.stop for o in ran if o.stop)
        kept, used = (1e3 * np.array([getattr(o, x) for o in ran]) for x in ("kept", "used"))
        yield (
            f"{name} | {len(of_arm)} | {counts['no estimate']} | {counts['no plan']} | {n} |"
            f" {sum(o.looks > 0 for o in ran)} | {100 * n / len(of_arm):.0f}% |"
            f" {sum(stops.values())} | {k} ({100 * k / n:.1f}%, {100 * low:.1f} … {100 * high:.1f}%) |"
            f" {np.median(kept):.0f} |"
            f" {np.nanmedian(used):.1f} / {np.nanquantile(used, 0.99):.1f}"
        )
        if name == "all":
            failures = Counter(f for o in bad for f in o.failures)
            yield f"  failures {dict(failures)}; stopped by name {dict(stops)}"


def main() -> None:
    """Run tasks and print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--count", type=int, default=1000, help="executed runs, all arms together")
    parser.add_argument("--arm", choices=shipped_arms(), action="append")
    parser.add_argument("--first", type=int, default=0, help="seed to begin after")
    parser.add_argument("--every", type=int, default=0, help="print the table after so many tasks, too")
    parser.add_argument(
        "--looks", type=int, default=2, help="how often is looked again where there is no plan"
    )
    parser.add_argument("--rendered", action="store_true", help="dots in rendered pictures")
    asked = parser.parse_args()
    found: list[tuple[str, Outcome]] = []
    head = (
        "| arm | tasks | no estimate | no plan at 1% | executed | of them after looks | executed, share |"
        " stopped by name | failed (95% interval) |"
        " margin kept, median [mm] | used, median / 99% [mm] |"
    )
    for number, one in enumerate(
        outcomes(
            asked.arm or list(shipped_arms()),
            asked.count,
            asked.first,
            rendered=asked.rendered,
            looks=asked.looks,
        ),
        1,
    ):
        found.append(one)
        if asked.every and number % asked.every == 0:
            print(*report(found), sep="\n", flush=True)
    print(head, "|---" * (head.count("|") - 1) + "|", sep="\n")
    for row in report(found):
        print(f"| {row} |" if not row.startswith("  ") else row)


if __name__ == "__main__":
    main()
