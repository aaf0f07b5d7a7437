"""The whole job: images → points → motion and structure → path → servo, measured against the truth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import closing
from dataclasses import replace
from time import perf_counter

import numpy as np
from scipy.spatial.transform import RigidTransform

from omniservo.cameras.conversion import unified_image
from omniservo.errors import InputError, NoSolutionError
from omniservo.geometry.arrays import ByteArray, FloatArray
from omniservo.perception import FeatureTracker
from omniservo.planning import Plan
from omniservo.recording import RunRecording
from omniservo.results import Film, RunLog, RunResult, Truth, WholeArm
from omniservo.robots import CameraImage, next_image
from omniservo.run_methods import RunMethod, run_method
from omniservo.runs.controller_of import controller_of
from omniservo.runs.feature_kind_of import feature_kind_of
from omniservo.runs.film import film_of
from omniservo.runs.in_view import require_in_view, require_unhidden
from omniservo.runs.job_progress import Progress
from omniservo.runs.job_recording import JobRecording
from omniservo.runs.look_again import LookingPlanner
from omniservo.runs.looking import looking
from omniservo.runs.motion_metrics import motion_metrics
from omniservo.runs.moved_joint import moved_joint
from omniservo.runs.moves import Moves
from omniservo.runs.planned_job import first_job, planned_job
from omniservo.runs.recorded_cell import RecordedCell
from omniservo.runs.recorder import Recorder
from omniservo.runs.replanner_of import followed_way, replanner_of
from omniservo.runs.robot_cell import OpenCell, RobotCell
from omniservo.runs.safety_of_task import safety_of_task
from omniservo.runs.score import score
from omniservo.runs.supervisor_of import supervisor_of
from omniservo.runs.task_gaps import TaskGaps
from omniservo.runs.teach_goal import teach_goal
from omniservo.runs.true_points import true_points
from omniservo.runs.whole_arm_of import whole_arm_of
from omniservo.safety import Controller, Step, VisibilityFilter, Waiting, servo
from omniservo.scenes import Scene
from omniservo.tasks import Task, TaughtGoal
from omniservo.tracking import Replanner
from omniservo.tracking.planned_motion import PlannedMotion

LAST_IMAGE = 5.0
"""After the end an image is waited for so long [s]."""


def run_task(
    task: Task,
    open_cell: OpenCell,
    *,
    method: str = "certified",
    goal: TaughtGoal | None = None,
    seed: int = 0,
    filmed: bool = True,
    progress: Progress = lambda stage, done: None,
    recording: RunRecording | None = None,
) -> RunResult:
    """Do a whole job and return everything that it produced.

    Args:
        task: the job.
        open_cell: says where it is done.
        method: a name of `omniservo.run_methods.METHODS`, or ``FILE.py:CLASS``, whose code is run.
        goal: what `teach_goal` saved; None: taught now.
        seed: of everything random.
        filmed: whether to render the animation's images, which takes about a fifth of the time.
        progress: called with what is being done, and the share of that stage that is behind.
        recording: takes in what passes between job and cell, and what the job makes of it.

    Raises:
        InputError: the task, the goal or the method cannot be worked on: too few features, another camera
            or target, out of reach, an unknown name.
        NoSolutionError: no match, no motion estimate, no path that the arm can follow, no twist at the goal.
    """
    started, chosen = perf_counter(), run_method(method)
    unified_image(task.camera)  # fitted once, in none of the times that are taken
    goal = _goal(task, open_cell, goal, seed, progress)
    with closing(open_cell(task, seed)) as cell:
        told = None if recording is None else JobRecording(recording)
        try:
            if told is not None:
                now = 0.0 if cell.clock is None else cell.clock()
                told.begin(task, goal, cell.scene, chosen.name, seed, time=now)
                cell = RecordedCell(cell, told)
            result = _run_in(cell, task, chosen, goal, seed, (filmed, told), progress)
        except BaseException as error:
            if told is not None:
                told.broken_off(error)
            raise
    result.seconds["whole"] = perf_counter() - started
    if recording is not None:
        result = replace(result, recorded=recording.settle())
    result = replace(result, metrics=_metrics(result, seed))
    if told is not None:
        told.finished(result.metrics)
    return result


def _run_in(
    cell: RobotCell,
    task: Task,
    method: RunMethod,
    goal: TaughtGoal,
    seed: int,
    kept: tuple[bool, JobRecording | None],
    progress: Progress,
) -> RunResult:
    """Return the run without its metrics; ``kept``: whether it is filmed, and its recording."""
    scene, (filmed, recording) = cell.scene, kept
    image, joints = _look(task, cell, progress)
    if recording is not None:
        recording.looked(image, scene, joints, 0.0)
    seconds: dict[str, float] = {}
    kind = feature_kind_of(task)
    progress("estimating motion and structure", 0.0)
    first = first_job(task, scene, kind, image.pixels, goal, joints, seconds)
    progress("planning", 0.0)
    outside_initial = _outside(cell)
    planner = LookingPlanner(first, looking(cell, recording), goal, seed, progress)
    plan, risk, motion = planned_job(planner, method, seed, seconds)
    job, looks = planner.job, tuple(planner.looks)
    task, scene, seen, estimate, followed = job.task, job.scene, job.seen, job.estimate, job.followed
    if recording is not None:
        recording.planned(seen.matched, estimate, plan)
    progress("following the path", 0.0)
    matched = seen.matched.where(followed)
    truth = None
    if cell.truth is not None:
        points = true_points(task, cell.truth, scene.start_joints, matched.initial)
        truth = _truth(task, scene, goal, points)
    controller = controller_of(task, method, plan, motion, estimate, followed, matched)
    replanner = replanner_of(task, scene, plan, risk, motion, controller, seed)
    tracker = kind.tracker(task.camera, seen.initial_image, goal.image, matched)
    recorder = Recorder(task, cell, controller, replanner, None if truth is None else truth.points, recording)
    _load_code(cell, controller, tracker, recorder)
    cell.approve(_in_words(plan, motion))
    _refuse_moved(cell, scene)
    log = _drive(task, cell, controller, replanner, tracker, recorder, progress, replans=method.replans)
    seconds["control"] = float(np.median(log.column("control_seconds"))) if log.rows else 0.0
    film = _film(log, recorder, cell, progress) if filmed else Film((), (), ())
    progress("measuring the run", 0.0)
    final = _final_image(cell, [image, *recorder.images])
    outside_final = _outside(cell)
    outside = None if outside_initial is None or outside_final is None else (outside_initial, outside_final)
    way = None if replanner is None else followed_way(replanner)
    whole_arm = whole_arm_of(task, scene, plan, risk, motion, way, log)
    return RunResult(
        task, method.name, goal, seen, estimate, followed, plan, risk, motion, whole_arm, log, final, outside,
        film, truth, way, () if replanner is None else tuple(replanner.events), seconds,
        looks=looks,
    )  # fmt: skip


def _film(log: RunLog, recorder: Recorder, cell: RobotCell, progress: Progress) -> Film:
    progress("filming", 0.0)
    return film_of(log, recorder.images, cell.truth)


def _load_code(cell: RobotCell, controller: Controller, tracker: FeatureTracker, recorder: Recorder) -> None:
    """Track one image, where time does not wait for code to be loaded or compiled.

    That is done before somebody agrees to the motion: once agreed to, it begins.
    """
    if cell.clock is None:
        return
    predicted, expected = controller.predict(0.0)
    image = next_image(cell.camera, cell.wait)
    tracker.update(image.pixels, np.where(expected[:, None], predicted, np.nan))
    recorder.warmed(image)


def _in_words(plan: Plan | None, motion: PlannedMotion | None) -> str:
    """Say what the arm is about to do."""
    if plan is None or plan.path is None or motion is None:
        return "servo the camera to the goal image without a plan: nothing is proven"
    end = plan.path(1.0)
    return (
        f"move the camera by {1e3 * np.linalg.norm(end.translation):.0f} mm and "
        f"{np.rad2deg(end.rotation.magnitude()):.1f} deg to the goal, in {motion.seconds:.1f} s, along a "
        f"path that is {plan.status}"
    )


def _refuse_moved(cell: RobotCell, scene: Scene) -> None:
    """Refuse where the arm is not where the plan begins: somebody moved it while the plan was approved."""
    if words := moved_joint(scene.arm, scene.start_joints, cell.driver.read().joint_positions):
        raise NoSolutionError(
            f"{words} since the initial image; nothing was commanded: start again from where the arm now"
            " stands"
        )


def _outside(cell: RobotCell) -> ByteArray | None:
    """Return a bystander's image of the arm as it stands; None where no one can take one."""
    return None if cell.truth is None else cell.truth.outside_picture(cell.driver.read().joint_positions)


def _final_image(cell: RobotCell, seen: Sequence[CameraImage]) -> ByteArray:
    """Return an image from where the arm came to rest; the last one seen where the camera is lost."""
    try:
        return next_image(cell.camera, cell.wait, patience=LAST_IMAGE).pixels
    except Exception:  # whatever a camera raises that is gone; why the run was stopped is known already
        return seen[-1].pixels


def _look(task: Task, cell: RobotCell, progress: Progress) -> tuple[CameraImage, FloatArray]:
    """Return the initial image, and the joints (n,) [rad] as they are read."""
    progress("looking at the target", 0.0)
    if cell.truth is not None:
        require_in_view(task, RigidTransform.identity(), "the initial image")
    require_unhidden(task, cell, cell.scene.start_joints, "the initial image")
    return next_image(cell.camera, cell.wait), cell.driver.read().joint_positions


def _goal(
    task: Task, open_cell: OpenCell, goal: TaughtGoal | None, seed: int, progress: Progress
) -> TaughtGoal:
    if goal is None:
        progress("teaching the goal", 0.0)
        require_in_view(task, RigidTransform.identity(), "the initial image")
        with closing(open_cell(task, seed + 1)) as cell:
            return teach_goal(task, cell)
    if goal.camera != task.camera:
        raise InputError(f"{task.name}: the goal was taught with another camera; teach it again")
    known = len(task.start.joints_near)
    if goal.joints is not None and len(goal.joints) != known:
        raise InputError(
            f"{task.name}: the goal was taught with {len(goal.joints)} joints; the task's arm has {known}; "
            "teach it again"
        )
    if goal.target is not None and (why := task.target.unlike(goal.target)):
        raise InputError(f"{task.name}: the goal was taught of another target: {why}; teach it again")
    return goal


def _drive(
    task: Task,
    cell: RobotCell,
    controller: Controller,
    replanner: Replanner | None,
    tracker: FeatureTracker,
    recorder: Recorder,
    progress: Progress,
    *,
    replans: bool,
) -> RunLog:
    options = safety_of_task(task)
    moves = Moves(task, cell.move_obstacles, replanner if replans else None)
    gaps = TaskGaps(task, cell.scene, options, replanner)

    def after(step: Step) -> None:
        moves.at(step.time)
        recorder.step(step)
        if replanner is not None and replans:
            replanner.look(step.time)
        gaps.check(step.state)
        progress("following the path", behind())

    def behind() -> float:
        w = math.nan if controller.report is None else controller.report.w
        return 0.0 if math.isnan(w) else w

    def waits(waiting: Waiting) -> None:
        recorder.wait(waiting)
        if math.isnan(waiting.until):
            progress("waiting for images", behind())

    visibility = VisibilityFilter(task.camera, delay=task.sensor.latency, options=options)
    stop = servo(
        supervisor_of(cell, options),
        controller,
        tracker,
        visibility,
        on_step=after,
        on_wait=waits,
        time_limit=task.servo.time_limit,
        posture=None if replanner is None else replanner.posture,
    )
    return recorder.finish(stop)


def _truth(task: Task, scene: Scene, goal: TaughtGoal, points: FloatArray) -> Truth:
    """The truth. Scoring only."""
    initial_T_world = task.start.world_T_camera.transform.inv()
    initial_T_goal = task.teach.initial_T_goal.transform
    if goal.joints is not None:
        initial_T_goal = initial_T_world * scene.world_T_camera(goal.joints)
    corners = [initial_T_world.apply(b.corners) for b in scene.obstacles if hasattr(b, "corners")]
    places = list(corners)
    for move in sorted(task.moves, key=lambda move: move.time):
        for i in move.bodies:
            places[i] = places[i] + move.by
            corners.append(places[i])
    return Truth(initial_T_goal.as_matrix(), points, tuple(corners))


def _arm_metrics(whole: WholeArm | None) -> dict[str, object]:
    if whole is None:
        return {}
    return {
        "arm_clearance_proof": whole.proof.status,
        "link_clearance_asked_m": whole.asked,
        **_margin_parts(whole),
        "link_clearance_planned_m": whole.least(whole.planned),
        "link_clearance_executed_m": whole.least(whole.executed),
    }


def _margin_parts(whole: WholeArm) -> dict[str, object]:
    """What gaps are kept wider for, beside what is required."""
    parts: dict[str, object] = {}
    if whole.margin is not None:
        parts["link_margin_estimate_m"] = whole.margin.estimate
        parts["link_margin_mount_m"] = whole.margin.mount
        parts["link_margin_added_m"] = whole.margin.added
    if whole.tube is not None:
        parts["link_margin_tracking_m"] = max(whole.tube.links.values())
        parts["camera_margin_tracking_m"] = whole.tube.position
        parts["visibility_margin_tracking_px"] = whole.tube.image
    return parts


def _metrics(result: RunResult, seed: int) -> dict[str, object]:
    seconds = {f"{stage}_seconds": value for stage, value in result.seconds.items()}
    seconds["control_seconds_median"] = seconds.pop("control_seconds")
    return {
        "task": result.task.name,
        "method": result.method,
        "seed": seed,
        **score(result.task, result.plan, result.way, result.log, result.truth),
        "notices": list(result.notices),
        "arm_notices": [] if result.whole_arm is None else list(result.whole_arm.notices),
        "plan_status": None if result.plan is None else result.plan.status,
        "estimate_rms_px": result.estimate.rms_px,
        **_risk_metrics(result),
        **motion_metrics(result),
        **_arm_metrics(result.whole_arm),
        **_replanning_metrics(result),
        **_look_metrics(result),
        **_wait_metrics(result),
        **_recording_metrics(result),
        "planning_seconds": None,  # unless planned
        **seconds,
    }


def _look_metrics(result: RunResult) -> dict[str, object]:
    """Return nothing for a run that needed no second look."""
    if not result.looks:
        return {}
    first, last = result.looks[0].before, result.looks[-1].after
    return {
        "looks": len(result.looks),
        "looks_for_nothing": sum(bool(look.nothing) for look in result.looks),
        "looks_motion_seconds": sum(look.motion_seconds for look in result.looks),
        "looks_computing_seconds": sum(look.computing_seconds for look in result.looks),
        "goal_sigma_before_looks_m": first.goal_m,
        "goal_sigma_after_looks_m": last.goal_m,
        "points_sigma_before_looks_m": first.points_m,
        "points_sigma_after_looks_m": last.points_m,
    }


def _wait_metrics(result: RunResult) -> dict[str, object]:
    """Return nothing for a run that never waited for images."""
    waits = result.log.waits
    if not waits:
        return {}
    blind = [moved for wait in waits if math.isfinite(moved := result.log.moved_blind(wait))]
    return {
        "waits": len(waits),
        "waited_seconds": sum(wait.until - wait.since for wait in waits),
        "moved_blind_m": max(blind, default=None),
    }


def _recording_metrics(result: RunResult) -> dict[str, object]:
    """Return nothing for a run whose recording waits for the disk: it has everything."""
    recorded = result.recorded
    if recorded is None or not recorded.images:
        return {}
    return {"recorded_images": recorded.images, "recorded_images_dropped": recorded.dropped}


def _replanning_metrics(result: RunResult) -> dict[str, object]:
    """Return nothing for a run on which nothing changed."""
    events = result.replannings
    if not events:
        return {}
    legs = 0 if result.way is None else len(result.way.legs)
    jumps = [] if result.way is None else [result.way.jumps(k) for k in range(1, legs)]
    return {
        "changes_on_the_way": len(events),
        "replanned": sum(event.outcome == "replanned" for event in events),
        "replanning_seconds": max(event.seconds for event in events),
        "replanning_twist_jump": max((jump[0] for jump in jumps), default=None),
        "replanning_joint_jump": max((jump[1] for jump in jumps), default=None),
    }


def _risk_metrics(result: RunResult) -> dict[str, object]:
    risk, whole = result.risk, result.whole_arm
    if risk is None:
        return {}
    return {
        "risk_asked": result.task.planning.risk,
        "risk_of_camera": risk.risk,
        "risk_of_links": 0.0 if risk.links is None else risk.links.risk,
        "risk_of_tracking": 0.0 if whole is None or whole.tube is None else whole.tube.share,
        "risk_predicted": risk.predicted,
        "risk_predicted_bound": risk.predicted_bound,
        "clearance_for_uncertainty_m": risk.extra_clearance,
        "visibility_for_uncertainty_px": risk.extra_visibility,
    }
