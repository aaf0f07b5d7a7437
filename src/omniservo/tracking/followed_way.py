"""The way that a run was led on: the plan's, and what was entered after it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.geometry.arrays import FloatArray
from omniservo.robots import JointPath
from omniservo.tracking.leg import Leg


@dataclass(frozen=True, eq=False)
class FollowedWay:
    """Legs, each followed until the next one is entered."""

    legs: tuple[Leg, ...]
    joints: tuple[JointPath, ...]
    """that follow each"""

    def poses(self, w: FloatArray) -> RigidTransform:
        """Return initial_T_camera at places w (m,) of the whole way."""
        found = [self._on_leg(k, w[k == self._leg_of(w)]) for k in range(len(self.legs))]
        poses = [leg.path(s) for leg, s in zip(self.legs, found, strict=True)]
        return RigidTransform.from_components(
            np.concatenate([pose.translation for pose in poses]),
            Rotation.concatenate([pose.rotation for pose in poses]),
        )

    def joints_at(self, times: FloatArray) -> FloatArray:
        """Return where the joints are to be at ``times`` (m,) [s]: (m, n) [rad]."""
        return np.array([self._joints(float(time))[0] for time in times])

    def speeds_at(self, times: FloatArray) -> FloatArray:
        """Return how fast they are to turn at ``times`` (m,) [s]: (m, n) [rad/s]."""
        return np.array([self._joints(float(time))[1] for time in times])

    @property
    def seconds(self) -> float:
        """When the last leg's law is finished, to 10 ms [s]."""
        time = self.legs[-1].time
        while not self.legs[-1].law.finished(time):
            time += 0.01
        return time

    def jumps(self, k: int) -> tuple[float, float]:
        """Return what taking up leg k ≥ 1 makes of twist [m/s, rad/s] and joint speeds [rad/s], at most."""
        time, ends = self.legs[k].time, []
        for leg, joints in zip(self.legs[k - 1 : k + 1], self.joints[k - 1 : k + 1], strict=True):
            s, speed = leg.law(time)
            ends.append((speed * leg.path(s, 1), speed * joints(s, 1)))
        (twist, turn), (later, after) = ends
        return float(np.abs(later - twist).max()), float(np.abs(after - turn).max())

    def positions(self, places: int) -> FloatArray:
        """Return camera centres (places, 3) [m] all along the way, evenly spaced in w."""
        return self.poses(np.linspace(0.0, 1.0, places)).translation

    def _leg_of(self, w: FloatArray) -> FloatArray:
        begins = [leg.begin for leg in self.legs]
        return np.maximum(np.searchsorted(begins, w, side="right") - 1, 0)

    def _on_leg(self, k: int, w: FloatArray) -> FloatArray:
        begin = self.legs[k].begin
        return np.clip((w - begin) / (1.0 - begin), 0.0, 1.0)

    def _joints(self, time: float) -> tuple[FloatArray, FloatArray]:
        k = max([k for k, leg in enumerate(self.legs) if leg.time <= time], default=0)
        s, speed = self.legs[k].law(time)
        return self.joints[k](s), speed * self.joints[k](s, 1)
