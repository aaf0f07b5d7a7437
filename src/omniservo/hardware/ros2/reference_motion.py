"""What the joints were commanded to do from an instant on: a velocity for a while, then braking to rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from omniservo.field_docs import with_field_docs
from omniservo.geometry.arrays import FloatArray


@with_field_docs
@dataclass(frozen=True)
class ReferenceMotion:
    """Joints that keep a velocity for ``hold``, then brake together as fast as their accelerations allow."""

    begin: float
    """`time.monotonic()` [s]"""
    positions: FloatArray
    """(n,) at the beginning [rad]"""
    velocities: FloatArray
    """(n,) [rad/s]"""
    hold: float
    """[s]"""
    accelerations: FloatArray
    """(n,) of braking, at most [rad/s²]"""

    @property
    def braking(self) -> float:
        """How long the braking takes [s]."""
        return float(np.max(np.abs(self.velocities) / self.accelerations))

    @property
    def end(self) -> float:
        """When the joints are at rest, by `time.monotonic()` [s]."""
        return self.begin + self.hold + self.braking

    def at(self, time: float) -> tuple[FloatArray, FloatArray]:
        """Return positions (n,) [rad] and velocities (n,) [rad/s] at a time of `time.monotonic()`."""
        braking = self.braking
        if time >= self.end:  # at rest exactly: controllers refuse a trajectory with another end
            return self.positions + (self.hold + 0.5 * braking) * self.velocities, 0.0 * self.velocities
        since = max(time - self.begin, 0.0)
        held = min(since, self.hold)
        into = since - held
        share = into / braking if braking else 0.0
        travelled = held + into * (1.0 - 0.5 * share)
        return self.positions + travelled * self.velocities, (1.0 - share) * self.velocities
