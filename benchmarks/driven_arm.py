"""An arm with simple drives, and the camera on it: gain, lag, limits, watchdog, late readings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from omniservo.geometry.arrays import FloatArray
from omniservo.robots import Arm, CameraImage, RobotState

TICK = 1e-3
FRAME = 1.0 / 30.0

WATCHDOG = 0.1
"""[s] without a command after which the drives brake by themselves"""


@dataclass(frozen=True)
class Drives:
    """What the arm and its camera are like where nothing is broken."""

    gain: float = 1.0
    """turned, of what is sent"""
    lag: float = 0.005
    """time constant [s]"""
    acceleration: float = 1.0
    """share of the arm's limits"""
    reading_late: float = 0.0
    """joints are those of so long ago [s], under the time of now"""
    stamped_then: bool = False
    """under their own time instead"""
    reading_noise: float = 0.0
    """σ [rad]"""
    image_late: float = 0.02
    """from exposure to delivery [s]"""
    stamp_error: float = 0.0
    """added to every image's time stamp [s]"""
    stamp_jitter: float = 0.0
    """likewise, evenly up to this either way [s]"""
    drop: float = 0.0
    """share of images that never come"""


class DrivenArm:
    """Time passes in `advance` only, by the millisecond; `trace` keeps every posture."""

    def __init__(self, arm: Arm, start: FloatArray, drives: Drives, random: np.random.Generator) -> None:
        self.arm, self.drives = arm, drives
        self._random = random
        self._q, self._v, self._u = np.array(start), np.zeros(arm.dof), np.zeros(arm.dof)
        self.trace = [self._q.copy()]
        self.commands: list[tuple[float, FloatArray]] = [(0.0, self._u.copy())]
        self._silent = 0.0
        self._stamps: dict[int, float | None] = {}
        self.own_gain, self.own_drift = np.ones(arm.dof), np.zeros(arm.dof)

    @property
    def time(self) -> float:
        """The robot's clock [s]."""
        return (len(self.trace) - 1) * TICK

    def advance(self, duration: float) -> None:
        """Let time pass [s]."""
        arm, drives = self.arm, self.drives
        limit = drives.acceleration * arm.joint_acceleration * TICK
        for _ in range(round(duration / TICK)):
            self._silent += TICK
            told = self._u if self._silent <= WATCHDOG else np.zeros(arm.dof)
            wanted = drives.gain * self.own_gain * told + self.own_drift
            self._v = self._v + np.clip((wanted - self._v) * min(1.0, TICK / drives.lag), -limit, limit)
            q = np.clip(self._q + self._v * TICK, *arm.joint_range.T)
            self._q = q
            self.trace.append(q)

    def read(self) -> RobotState:
        """Return the joints, as late as they are."""
        late = round(self.drives.reading_late / TICK)
        now = len(self.trace) - 1
        k = max(now - late, 0)
        before = self.trace[max(k - 5, 0)]
        speed = (self.trace[k] - before) / (max(min(k, 5), 1) * TICK)
        noise = self.drives.reading_noise * self._random.standard_normal(self.arm.dof)
        time = self.time - (self.drives.reading_late if self.drives.stamped_then else 0.0)
        return RobotState(time, self.trace[k] + noise, speed)

    def exposed(self) -> tuple[int, float] | None:
        """Return number and time stamp [s] of the newest frame that was delivered; None before the first."""
        k = int(np.floor((self.time - self.drives.image_late) / FRAME + 1e-9))
        while k >= 0 and self._stamp(k) is None:
            k -= 1
        stamp = self._stamp(k) if k >= 0 else None
        return None if stamp is None else (k, stamp)

    def image(self) -> CameraImage | None:
        """Return the newest delivered frame, empty."""
        newest = self.exposed()
        return None if newest is None else CameraImage(newest[1], np.zeros((0, 0), dtype=np.uint8))

    def joints_at(self, frame: float) -> FloatArray:
        """Return where the arm was when a frame was exposed; of a part of a frame, so much between two."""
        return self.trace[min(max(round(frame * FRAME / TICK), 0), len(self.trace) - 1)]

    def command(self, joint_velocities: npt.ArrayLike) -> None:
        """Take velocities [rad/s]."""
        self._u, self._silent = np.array(joint_velocities, dtype=np.float64), 0.0
        self.commands.append((self.time, self._u))

    def stop(self) -> None:
        """Brake; a joint that drifts is held by its brake."""
        self.command(np.zeros(self.arm.dof))
        self.own_drift = np.zeros(self.arm.dof)

    def close(self) -> None:
        """Nothing is open."""

    def _stamp(self, k: int) -> float | None:
        if k not in self._stamps:
            lost = k > 0 and self._random.random() < self.drives.drop
            jitter = self.drives.stamp_jitter * self._random.uniform(-1.0, 1.0)
            self._stamps[k] = None if lost else k * FRAME + self.drives.stamp_error + jitter
        return self._stamps[k]
