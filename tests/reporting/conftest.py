"""Made-up runs: a real task and a real plan, the log synthesised from the plan by exact projection."""

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.estimation import TwoViewEstimate
from omniservo.perception import MatchedPoints
from omniservo.planning import plan_path
from omniservo.results.run_log import LogRow, RunLog
from omniservo.results.run_result import Film, RunResult, Seen, Truth
from omniservo.runs.pace import pace
from omniservo.runs.plan_task import problem_of
from omniservo.runs.whole_arm_of import whole_arm_of
from omniservo.scenes.scene_of_task import scene_of_task
from omniservo.tasks import TaughtGoal, load_task
from omniservo.tracking import Leg
from omniservo.tracking.followed_way import FollowedWay

CORNERS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)


def picture(camera, pixels, seed=0):
    """A grey picture with a dark disc of radius 6 px at every pixel."""
    rng = np.random.default_rng(seed)
    image = rng.integers(186, 195, (camera.height, camera.width), dtype=np.uint8)
    for pixel in pixels:
        cv2.circle(image, np.rint(pixel).astype(int).tolist(), 6, 25, cv2.FILLED)
    return image


def outside_picture(share):
    """A coloured picture, different for every share of the way in [0, 1]."""
    image = np.full((270, 360, 3), (214, 220, 226), dtype=np.uint8)
    image[120:200, 40 + int(200 * share) : 90 + int(200 * share)] = (240, 140, 30)
    return image


def estimate_of(task):
    """What a perfect estimate of the task's motion and structure looks like."""
    points = np.array([dot.center for dot in task.target.dots])
    n = len(points)
    return TwoViewEstimate(
        status="ok",
        message="",
        initial_T_goal=task.teach.initial_T_goal.transform,
        points=points,
        is_metric=True,
        covariance=np.diag([1e-6, 4e-6, 2e-6, 1e-6, 1e-6, 1e-6]),
        points_covariance=np.tile(1e-6 * np.eye(3), (n, 1, 1)),
        inliers=np.ones(n, dtype=bool),
        rms_px=0.03,
        noise_px=0.02,
        residuals_px=np.zeros((n, 4)),
        seconds=0.002,
    )


def plan_of(task, estimate):
    return plan_path(problem_of(task, estimate.initial_T_goal, estimate.points))


def straight(goal, w):
    """The straight way that the classical servo may take."""
    return RigidTransform.from_components(
        w * goal.translation, Rotation.from_rotvec(w * goal.rotation.as_rotvec())
    )


def log_of(task, estimate, plan, steps):
    """Rows along the path (or the straight way), half a millimetre off in the middle."""
    goal, camera, rows = estimate.initial_T_goal, task.camera, []
    goal_pixels, _ = camera.project(goal.inv().apply(estimate.points))
    rng = np.random.default_rng(3)
    for k in range(steps):
        s = k / max(steps - 1, 1)
        w = s * s * (3.0 - 2.0 * s)
        pose = straight(goal, w) if plan is None else plan.path(w)
        wobble = 5e-4 * np.sin(np.pi * s) * np.array([0.0, 1.0, 0.5])
        truth = RigidTransform.from_components(pose.translation + wobble, pose.rotation)
        pixels, valid = camera.project(truth.inv().apply(estimate.points))
        reference, _ = camera.project(pose.inv().apply(estimate.points))
        detected = pixels + rng.normal(0.0, 0.02, pixels.shape)
        rows.append(
            LogRow(
                time=4.0 * s,
                w=w if plan is not None else np.nan,
                leg=0,
                read_time=4.0 * s,
                joints=np.linspace(0.0, s, 6),
                planned_joints=np.linspace(0.0, s, 6),
                joint_velocities=0.3 * np.sin(np.pi * s) * np.arange(1, 7),
                twist=np.sin(np.pi * s) * np.array([0.01, -0.05, 0.08, 0.01, 0.02, 0.0]),
                filter_change=np.zeros(6),
                held_back=False,
                pixels=detected,
                valid=valid,
                reference_pixels=reference,
                error_px=float(np.sqrt(np.mean(np.sum((detected - reference) ** 2, axis=1)))),
                goal_error_px=float(np.sqrt(np.mean(np.sum((detected - goal_pixels) ** 2, axis=1)))),
                estimated_position=truth.translation,
                measured_position=truth.translation,
                measured_rotation=truth.rotation.as_rotvec(),
                true_position=truth.translation,
                true_rotation=truth.rotation.as_rotvec(),
                true_pixels=pixels,
                arm_clearance=0.02,
                control_seconds=6e-5,
            )
        )
    return RunLog(rows)


def build(name="paper-example-1", method="certified", steps=40):
    task = load_task(name)
    estimate = estimate_of(task)
    plan = None if method == "ibvs" else plan_of(task, estimate)
    initial_dots, _ = task.camera.project(estimate.points)
    goal_dots, _ = task.camera.project(estimate.initial_T_goal.inv().apply(estimate.points))
    log = log_of(task, estimate, plan, steps)
    scene = scene_of_task(task)
    motion = None if plan is None else pace(task, scene, plan)
    way = None if plan is None else FollowedWay((Leg(plan.path, motion.law),), (motion.joints,))
    goal_image = picture(task.camera, goal_dots, 1)
    frames = log.rows[::5]
    bodies = [b.transform.apply(CORNERS * b.half_extents) for b in task.obstacles]
    return RunResult(
        task=task,
        method=method,
        goal=TaughtGoal(task.camera, goal_image, goal_dots, None),
        seen=Seen(picture(task.camera, initial_dots), goal_image, MatchedPoints(initial_dots, goal_dots)),
        followed=np.arange(len(initial_dots)),
        estimate=estimate,
        plan=plan,
        risk=None,
        motion=motion,
        whole_arm=None if plan is None else whole_arm_of(task, scene, plan, None, motion, way, log),
        log=log,
        final_image=picture(task.camera, goal_dots, 2),
        outside=(outside_picture(0.0), outside_picture(1.0)),
        film=Film(
            times=tuple(row.time for row in frames),
            camera=tuple(picture(task.camera, row.pixels, 9) for row in frames),
            outside=tuple(outside_picture(row.time / 4.0) for row in frames),
        ),
        truth=Truth(estimate.initial_T_goal.as_matrix(), estimate.points, tuple(bodies)),
        way=way,
        replannings=(),
        seconds={"perception": 0.03, "estimation": 0.003, "planning": 8e-4, "control": 6e-5, "whole": 9.1},
        metrics=metrics_of(task, method, plan, log),
    )


def metrics_of(task, method, plan, log):
    return {
        "task": task.name,
        "method": method,
        "status": "converged",
        "reason": "",
        "clearance_asked_m": task.planning.clearance,
        "clearance_planned_m": None if plan is None else 0.0612,
        "clearance_executed_m": 0.0607,
        "arm_clearance_executed_m": 0.0137,
        "visibility_planned_px": None if plan is None else 12.4,
        "visibility_executed_px": 12.9,
        "final_error_px": 0.041,
        "final_translation_error_m": 1.7e-5,
        "final_rotation_error_rad": 1.2e-4,
        "servo_seconds": 4.0,
        "frames": len(log.rows),
        "contacts": [],
        "plan_status": None if plan is None else plan.status,
        "estimate_rms_px": 0.03,
        "planning_seconds": 8e-4,
        "control_seconds_median": 6e-5,
    }


@pytest.fixture(scope="session")
def made_up_run() -> Callable[..., RunResult]:
    """Builds a run: ``made_up_run(name="paper-example-1", method="certified", steps=40)``."""
    return build


@pytest.fixture(scope="session")
def run(made_up_run) -> RunResult:
    """One certified run of the paper's first example."""
    return made_up_run()


@pytest.fixture(scope="session")
def stopped_run(run) -> RunResult:
    """A run that was stopped before its first step."""
    log = RunLog([], set(), "feature_loss", "3 of 9 points are usable; at least 4 are needed")
    metrics = {**run.metrics, "status": "stopped", "reason": log.stop_message, "final_error_px": None}
    return replace(run, log=log, film=Film((), (), ()), metrics=metrics)
