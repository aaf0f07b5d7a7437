"""Writes the log of a run: what the loop knew, and the truth beside it for scoring."""

from __future__ import annotations

from typing import TypedDict

import numpy as np

from omniservo.errors import ServoStop
from omniservo.geometry.arrays import FloatArray
from omniservo.recording import Call
from omniservo.results import LogRow, RunLog
from omniservo.robots import CameraImage
from omniservo.runs.job_recording import JobRecording
from omniservo.runs.robot_cell import RobotCell
from omniservo.safety import Controller, Step, Waiting
from omniservo.tasks import Task
from omniservo.tracking import Replanner


class _TrueColumns(TypedDict):
    """The fields of a `LogRow` that are truth."""

    true_position: FloatArray
    true_rotation: FloatArray
    true_pixels: FloatArray
    arm_clearance: float


class Recorder:
    """Collects one row per control step."""

    def __init__(
        self,
        task: Task,
        cell: RobotCell,
        controller: Controller,
        replanner: Replanner | None,
        points: FloatArray | None,
        recording: JobRecording | None = None,
    ) -> None:
        """Prepare an empty log; ``points`` (n, 3) are the true points in the order of the loop's pixels.

        None where there is no truth. ``recording`` is reported every step, too.
        """
        self._recording = recording
        self._camera = task.camera
        self._initial_T_world = task.start.world_T_camera.transform.inv()
        self._scene, self._truth = cell.scene, cell.truth
        self._controller = controller
        self._replanner = replanner
        self._points = points
        self._log = RunLog()
        self.images: list[CameraImage] = []
        """what the camera saw, one per row"""

    def warmed(self, image: CameraImage) -> None:
        """Note that the points were looked for in an image before the servo."""
        if self._recording is not None:
            self._recording.call(Call.WARMED, image.time)

    def step(self, step: Step) -> None:
        """Add a row."""
        report = self._controller.report
        if report is None:
            raise AssertionError("a step without a report")
        measured = self._initial_T_world * self._scene.world_T_camera(step.exposure_joints)
        self._log.rows.append(
            LogRow(
                time=step.time,
                w=report.w,
                leg=0 if self._replanner is None else self._replanner.leg_number(step.time),
                read_time=step.time + step.state.time - step.image.time,
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
                measured_position=measured.translation,
                measured_rotation=measured.rotation.as_rotvec(),
                **self._true_columns(step),
                control_seconds=step.control_seconds,
            )
        )
        self.images.append(step.image)
        if self._recording is not None:
            if self._replanner is not None:
                self._recording.follow([leg.path for leg in self._replanner.legs])
            self._recording.step(step, report, self._log.rows[-1].leg, self._scene)

    def wait(self, waiting: Waiting) -> None:
        """Note that the arm waits for images, or that this is over."""
        self._log.wait(waiting)
        if self._recording is not None:
            self._recording.wait(waiting)

    def _true_columns(self, step: Step) -> _TrueColumns:
        """Return the truth of the image's exposure; NaN without one."""
        if self._truth is None or self._points is None:
            none = np.full(3, np.nan)
            return _TrueColumns(
                true_position=none,
                true_rotation=none,
                true_pixels=np.full_like(step.pixels, np.nan),
                arm_clearance=np.nan,
            )
        truth = self._initial_T_world * self._truth.world_T_camera(step.image.time)
        return _TrueColumns(
            true_position=truth.translation,
            true_rotation=truth.rotation.as_rotvec(),
            true_pixels=self._camera.project(truth.inv().apply(self._points))[0],
            arm_clearance=self._truth.arm_obstacle_distance(),
        )

    def _planned(self, step: Step) -> FloatArray:
        if self._replanner is None:
            return np.full_like(step.state.joint_positions, np.nan)
        return self._replanner.posture(step.time)[0]

    def finish(self, stop: ServoStop | None) -> RunLog:
        """Return the log with how the run ended."""
        if self._truth is not None:
            self._log.contacts |= self._truth.contacts()
        if stop is not None:
            self._log.stop_reason, self._log.stop_message = stop.reason, str(stop)
        if self._recording is not None:
            self._recording.ended(stop)
        return self._log
