"""Writes the log of a run: what the loop knew, and the truth beside it for scoring."""

from __future__ import annotations

import numpy as np

from omniservo.errors import ServoStop
from omniservo.geometry.arrays import FloatArray
from omniservo.results import LogRow, RunLog
from omniservo.robots import CameraImage
from omniservo.runs.ground_truth import GroundTruth
from omniservo.runs.job_recording import JobRecording
from omniservo.safety import Controller, Step
from omniservo.scenes import Scene
from omniservo.tasks import Task
from omniservo.tracking import Replanner


class Recorder:
    """Collects one row per control step."""

    def __init__(
        self,
        task: Task,
        truth: GroundTruth,
        controller: Controller,
        replanner: Replanner | None,
        points: FloatArray,
        recording: tuple[JobRecording, Scene] | None = None,
    ) -> None:
        """Prepare an empty log; ``points`` (n, 3) are the true points in the order of the loop's pixels.

        ``recording`` is told of every step, too, and of the arm's scene.
        """
        self._recording = recording
        self._camera = task.camera
        self._world_T_initial = task.start.world_T_camera.transform
        self._truth = truth
        self._controller = controller
        self._replanner = replanner
        self._points = points
        self._log = RunLog()
        self.images: list[CameraImage] = []
        """what the camera saw, one per row"""

    def step(self, step: Step) -> None:
        """Add a row. The truth is that of the image's exposure."""
        report = self._controller.report
        if report is None:
            raise AssertionError("a step without a report")
        truth = self._world_T_initial.inv() * self._truth.world_T_camera(step.image.time)
        true_pixels, _ = self._camera.project(truth.inv().apply(self._points))
        self._log.rows.append(
            LogRow(
                time=step.time,
                w=report.w,
                leg=0 if self._replanner is None else self._replanner.leg_number(step.time),
                joints=step.state.joint_positions,
                planned_joints=self._planned(step),
                joint_velocities=step.passed.target,
                twist=step.filtered.twist,
                filter_change=step.filtered.change,
                held_back=bool(step.passed.limits),
                pixels=step.pixels,
                valid=step.valid,
                reference_pixels=report.reference_pixels,
                error_px=report.error_px,
                goal_error_px=report.goal_error_px,
                estimated_position=report.initial_T_camera.translation,
                true_position=truth.translation,
                true_rotation=truth.rotation.as_rotvec(),
                true_pixels=true_pixels,
                arm_clearance=self._truth.arm_obstacle_distance(),
                control_seconds=step.control_seconds,
            )
        )
        self.images.append(step.image)
        if self._recording is not None:
            recording, scene = self._recording
            if self._replanner is not None:
                recording.follow([leg.path for leg in self._replanner.legs])
            recording.step(step, report, self._log.rows[-1].leg, scene)

    def _planned(self, step: Step) -> FloatArray:
        if self._replanner is None:
            return np.full_like(step.state.joint_positions, np.nan)
        return self._replanner.posture(step.time)[0]

    def finish(self, stop: ServoStop | None) -> RunLog:
        """Return the log with how the run ended."""
        self._log.contacts |= self._truth.contacts()
        if stop is not None:
            self._log.stop_reason, self._log.stop_message = stop.reason, str(stop)
        if self._recording is not None:
            self._recording[0].ended(stop)
        return self._log
