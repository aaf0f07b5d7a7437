"""The log of a run: one row per control step, in memory as columns, on disk as CSV."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass, field, fields
from typing import Literal

import numpy as np

from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.safety import Waiting


@dataclass(frozen=True)
class LogRow:
    """One control step. Everything under *truth* serves scoring only."""

    time: float
    """[s] since the start of the servo"""
    w: float
    """path parameter that the time law gave"""
    leg: int
    """which way was followed: 0 the plan's, then what was entered after it"""
    read_time: float
    """[s] likewise, of the joints: on a real robot not always as long after that of the image"""
    joints: FloatArray
    """(n,) as read [rad]"""
    planned_joints: FloatArray
    """(n,) where the plan has them at ``time`` [rad]; NaN without a plan"""
    joint_velocities: FloatArray
    """(n,) commanded [rad/s]"""
    twist: FloatArray
    """(6,) commanded camera twist (linear, angular), camera frame [m/s, rad/s]"""
    filter_change: FloatArray
    """(6,) what the visibility filter added to the controller's twist [m/s, rad/s]"""
    held_back: bool
    """the supervisor slowed the command down, or the joints take longer than a frame to reach it"""
    pixels: FloatArray
    """(n, 2) points as detected [px]; NaN where lost"""
    valid: BoolArray
    """(n,) points found in this frame"""
    reference_pixels: FloatArray
    """(n, 2) where the points should be at this time [px]"""
    error_px: float
    """rms of detected minus reference [px]"""
    goal_error_px: float
    """rms of detected minus goal image [px]"""
    estimated_position: FloatArray
    """(3,) camera centre estimated from the image, initial camera frame [m]"""
    measured_position: FloatArray
    """(3,) camera centre by the joints as read round the exposure, initial camera frame [m]"""
    measured_rotation: FloatArray
    """(3,) likewise the rotation vector of initial_R_camera [rad]"""
    true_position: FloatArray
    """truth: (3,) camera centre, initial camera frame [m]; NaN on a real robot, as is all truth"""
    true_rotation: FloatArray
    """truth: (3,) rotation vector of initial_R_camera [rad]"""
    true_pixels: FloatArray
    """truth: (n, 2) projections of the points' centres [px]"""
    arm_clearance: float
    """truth: smallest distance between arm or camera body and any obstacle [m]; negative: penetration"""
    control_seconds: float
    """time from the points' pixels to the joint velocities [s]"""


@dataclass
class RunLog:
    """All rows of a run and how it ended."""

    rows: list[LogRow] = field(default_factory=list)
    contacts: set[tuple[str, str]] = field(default_factory=set)
    """truth: pairs of bodies that touched"""
    stop_reason: str = ""
    """empty: converged; else one word, as in `omniservo.errors`"""
    stop_message: str = ""
    waits: list[Waiting] = field(default_factory=list)
    """when images were missing and the arm slowed down, stood and waited"""

    def column(self, name: str) -> FloatArray:
        """Return one field of all rows, stacked: (steps, …)."""
        return np.asarray([getattr(row, name) for row in self.rows], dtype=np.float64)

    def wait(self, waiting: Waiting) -> None:
        """Note that the arm waits for images, or that it did."""
        if self.waits and self.waits[-1].since == waiting.since:
            self.waits.pop()
        self.waits.append(waiting)

    def moved_blind(self, waiting: Waiting) -> float:
        """Return how far the camera moved between the images round a waiting, by the joints [m].

        NaN where there is none after it.
        """
        before = [row for row in self.rows if row.time < waiting.since]
        after = [row for row in self.rows if row.time >= waiting.since]
        if not before or not after:
            return float("nan")
        return float(np.linalg.norm(after[0].measured_position - before[-1].measured_position))

    @property
    def has_truth(self) -> bool:
        """Whether rows have the truth beside them, as only the simulator knows it."""
        return bool(self.rows) and bool(np.isfinite(self.rows[0].true_position).all())

    def executed(self, name: Literal["position", "rotation", "pixels"]) -> FloatArray:
        """Return the camera's executed positions or rotations (steps, 3), or the points (steps, n, 2) [px].

        The truth where there is one; on a real robot what joints and images say.
        """
        measured = "pixels" if name == "pixels" else f"measured_{name}"
        found = self.column(f"true_{name}" if self.has_truth else measured)
        return found if self.rows or name == "pixels" else found.reshape(0, 3)

    def to_csv(self) -> str:
        """Return the log as CSV: arrays spread over columns ``name_0, name_1_0, …``."""
        text = io.StringIO()
        writer = csv.writer(text)
        if not self.rows:
            return ""
        names = [f.name for f in fields(LogRow)]
        header: list[str] = []
        for name in names:
            shape = np.shape(getattr(self.rows[0], name))
            header += ["_".join([name, *map(str, index)]) for index in np.ndindex(*shape)]
        writer.writerow(header)
        for row in self.rows:
            values: list[float] = []
            for name in names:
                values += np.ravel(np.asarray(getattr(row, name), dtype=np.float64)).tolist()
            writer.writerow(values)
        return text.getvalue()
