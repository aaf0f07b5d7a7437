"""Replaying a recording: perception, estimation, planning and tracking once more, on what was recorded."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from omniservo.cameras.conversion import unified_image
from omniservo.errors import InputError, NoSolutionError, ServoStop
from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray
from omniservo.perception import FeatureKind
from omniservo.planning import Plan
from omniservo.recording import RecordedRun
from omniservo.recording.recorded_messages import StepMessage
from omniservo.risk import RiskPlan
from omniservo.run_methods import run_method
from omniservo.runs.begun_as_recorded import begun_as_recorded
from omniservo.runs.comparison import Comparison
from omniservo.runs.controller_of import controller_of
from omniservo.runs.feature_kind_of import feature_kind_of
from omniservo.runs.job_progress import Progress
from omniservo.runs.job_recording import BROKEN_OFF, REFUSED, pose_numbers
from omniservo.runs.joined_views import Job
from omniservo.runs.look_again import LookingPlanner
from omniservo.runs.moves import Moves
from omniservo.runs.planned_job import first_job, planned_job
from omniservo.runs.recorded_job import RecordedJob
from omniservo.runs.recorded_robot import RecordedRobot, RecordingEnds
from omniservo.runs.replanner_of import replanner_of
from omniservo.runs.run_inputs import RunInputs
from omniservo.runs.safety_of_task import safety_of_task
from omniservo.runs.task_gaps import TaskGaps
from omniservo.safety import Controller, Step, VisibilityFilter, servo
from omniservo.scenes import Scene
from omniservo.tasks import Task, TaughtGoal
from omniservo.tracking import Replanner
from omniservo.tracking.planned_motion import PlannedMotion

_TIMES = frozenset({"seconds"})
"""Fields of documents that say how long something took."""


@with_field_docs
@dataclass(frozen=True)
class Replay:
    """What came of it."""

    task: str
    """its name"""
    version: str
    """of the program that recorded it"""
    steps: int
    """control steps that were replayed"""
    differences: tuple[str, ...]
    """what differs, in words; empty: nothing"""
    largest: float
    """difference of what counts as equal; 0: equal bit by bit"""
    dropped: int
    """images that are missing, as the file says; what is before the first was replayed"""
    left: int
    """control steps behind it"""
    cut: bool
    """the file ends before the run does; what is there was replayed"""
    ended: str
    """how the recorded servo did: a reason; empty: the goal was reached; "cut": that is not there"""


def replay_run(
    path: str | Path, *, allow_outside: bool = False, progress: Progress = lambda stage, done: None
) -> Replay:
    """Run perception, estimation, planning and tracking on what a file holds; compare with what it logged.

    The file need not be trusted: only data are read from it, and the task's files in it go into a temporary
    folder, outside of which nothing is read unless ``allow_outside``.

    Args:
        path: of the recording.
        allow_outside: whether files that the task names may lie outside its folder.
        progress: called with what is being done.

    Raises:
        InputError: the file is no recording, damaged, cut off before the first image, or its task is wrong.
    """
    run = RecordedRun(path)
    job = RecordedJob(run)
    inputs, goal = job.inputs()
    with tempfile.TemporaryDirectory(prefix="omniservo-") as folder:
        try:
            begun = begun_as_recorded(inputs, goal, Path(folder), allow_outside=allow_outside)
        except InputError as error:
            raise InputError(f"{path}: {str(error).replace(f'{folder}/', '')}") from None
        found, replayed = Comparison(), _Replayed(job, inputs, (*begun, goal), progress)
        try:
            replayed.go(found)
        finally:
            if job.fault is not None:  # a loop may have taken it for another's
                raise job.fault
    reached = "cut" if job.end is None else job.end.reason
    return Replay(
        begun[0].name, inputs.version, replayed.steps, found.differences, found.largest, job.dropped,
        replayed.left, job.end is None, reached,
    )  # fmt: skip


class _Replayed:
    """One replay."""

    def __init__(
        self, job: RecordedJob, inputs: RunInputs, begun: tuple[Task, Scene, TaughtGoal], progress: Progress
    ) -> None:
        self._job, self._asked, self._progress = job, inputs, progress
        self._task, self._scene, self._goal = begun
        self._method = run_method(inputs.method)
        self._kind: FeatureKind = feature_kind_of(self._task)
        self.steps = 0
        """that were replayed"""
        self.left = 0
        """steps behind an image that is missing"""

    def go(self, found: Comparison) -> None:
        """Do all of it."""
        job, inputs, task, scene = self._job, self._asked, self._task, self._scene
        unified_image(task.camera)
        first = job.look()
        if first is None:
            raise InputError(f"{job.run.path}: no image was looked at")
        self._refuse_other_size(first[1].shape)
        self._progress("estimating motion and structure", 0.0)
        try:
            begun = first_job(task, scene, self._kind, first[1], self._goal, first[2], {})
            self._progress("planning", 0.0)
            planner = LookingPlanner(begun, job.take_shot, self._goal, inputs.seed, self._progress)
            plan, risk, motion = planned_job(planner, self._method, inputs.seed, {})
        except (NoSolutionError, InputError) as refused:
            while job.look() is not None:
                pass
            job.documents()
            if job.match is not None or (job.end is not None and job.end.reason != REFUSED):
                found.differ("plan", f"one recorded; replayed: {refused}")
            return
        if job.look() is not None:
            found.differ("looks", f"more recorded than the {len(planner.looks)} that were needed")
            return
        self._compare_plans(found, planner.job, plan)
        if job.match is not None:
            self._servo(found, planner.job, plan, risk, motion)

    def _compare_plans(self, found: Comparison, job: Job, plan: Plan | None) -> None:
        recorded, match = self._job.documents(), self._job.match
        if match is None:
            if self._job.end is not None:
                found.differ("plan", f"refused as recorded ({self._job.end.message}); replayed: there is one")
            return
        found.numbers("matched points, initial image", "", match.initial, job.seen.matched.initial.ravel())
        found.numbers("matched points, goal image", "", match.goal, job.seen.matched.goal.ravel())
        documents = (job.estimate.to_dict(), None if plan is None else plan.to_dict())
        for name, then, now in zip(("estimate", "plan"), recorded, documents, strict=True):
            if then is not None or (now is not None and self._job.end is not None):
                found.documents(name, then, json.loads(json.dumps(now)), _TIMES)

    def _servo(
        self,
        found: Comparison,
        job: Job,
        plan: Plan | None,
        risk: RiskPlan | None,
        motion: PlannedMotion | None,
    ) -> None:
        """Track the recorded images."""
        self._progress("following the path", 0.0)
        task, scene, estimate, followed = job.task, job.scene, job.estimate, job.followed
        matched, options = job.seen.matched.where(followed), safety_of_task(job.task)
        try:
            controller = controller_of(task, self._method, plan, motion, estimate, followed, matched)
        except NoSolutionError as refused:
            found.differ("method", f"it was followed as recorded; replayed: {refused}")
            return
        replanner = replanner_of(task, scene, plan, risk, motion, controller, self._asked.seed)
        tracker = self._kind.tracker(task.camera, job.seen.initial_image, self._goal.image, matched)
        robot = RecordedRobot(self._job, scene.arm, scene.flange_T_camera, options)
        moves = Moves(task, _nobody_moves, replanner if self._method.replans else None)
        gaps = TaskGaps(task, scene, options, replanner)

        warmed, (predicted, expected) = robot.warmed(), controller.predict(0.0)
        if warmed is not None:
            tracker.update(warmed.pixels, np.where(expected[:, None], predicted, np.nan))

        def after(step: Step) -> None:
            moves.at(step.time)
            self._compare_step(found, robot, step, controller, replanner)
            if replanner is not None and self._method.replans:
                replanner.look(step.time)
            gaps.check(step.state)

        stop = servo(
            robot,
            controller,
            tracker,
            VisibilityFilter(task.camera, delay=task.sensor.latency, options=options),
            on_step=after,
            time_limit=task.servo.time_limit,
            posture=None if replanner is None else replanner.posture,
        )
        self._compare_ends(found, stop, robot)

    def _compare_step(
        self,
        found: Comparison,
        robot: RecordedRobot,
        step: Step,
        controller: Controller,
        replanner: Replanner | None,
    ) -> None:
        report, then = controller.report, robot.recorded_step()
        if report is None:
            raise AssertionError("a step without a report")
        self.steps += 1
        place = f"step {self.steps} ({step.time:.3f} s): "
        leg = 0 if replanner is None else replanner.leg_number(step.time)
        for name, recorded, replayed in _quantities(then, step, report, leg):
            found.numbers(name, place, recorded, replayed)
        self._progress("following the path", 0.0 if np.isnan(report.w) else float(report.w))

    def _compare_ends(self, found: Comparison, stop: ServoStop | None, robot: RecordedRobot) -> None:
        """Compare how the two servos ended; where arm or camera stopped it, why is not replayed."""
        left = robot.steps_left()
        end = self._job.end
        if robot.lost is not None:
            self.left = left
            self._job.read_to_end()
            if not self._job.dropped:
                found.differ("images", f"that of {robot.lost:.6f} s is missing, which the file does not say")
        elif left:
            words = "the goal was reached" if stop is None else str(stop)
            found.differ("end", f"{left} more steps recorded; replayed: {words}")
        elif end is not None and stop is None and end.reason:
            found.differ("end", f"{end.reason} recorded; replayed: the goal was reached")
        elif end is not None and isinstance(stop, RecordingEnds):
            if not end.reason:
                found.differ("end", "the goal was reached as recorded; replayed: it is not yet")
            elif end.reason != BROKEN_OFF and not robot.refused:
                found.differ("end", f"{end.reason} recorded; replayed: nothing stops it")
        elif end is not None and stop is not None and stop.reason != end.reason:
            found.differ("end", f"{end.reason or 'goal'} recorded; replayed: {stop}")

    def _refuse_other_size(self, shape: Sequence[int]) -> None:
        camera = self._task.camera
        if tuple(shape) != (camera.height, camera.width):
            raise InputError(
                f"{self._job.run.path}: an image of {shape[1]} × {shape[0]} px; the camera has "
                f"{camera.width} × {camera.height} px"
            )


def _quantities(then: StepMessage, step: Step, report: Any, leg: int) -> list[tuple[str, Any, Any]]:
    """Return what is compared of a step: name, as recorded, as replayed."""
    return [
        ("time [s]", then.time, step.time),
        ("points found", then.valid, step.valid),
        ("points [px]", then.pixels, np.ravel(step.pixels)),
        ("path parameter w", then.w, report.w),
        ("way followed", then.leg, leg),
        ("reference [px]", then.reference_pixels, np.ravel(report.reference_pixels)),
        ("estimated pose", then.estimated_pose, pose_numbers(report.initial_T_camera)),
        ("camera twist", then.twist, step.filtered.twist),
        ("visibility filter's change", then.filter_change, step.filtered.change),
        ("distance to the reference [px]", then.error_px, report.error_px),
        ("distance to the goal image [px]", then.goal_error_px, report.goal_error_px),
    ]


def _nobody_moves(numbers: Sequence[int], by: FloatArray) -> None:
    """Obstacles stood where they stood."""
