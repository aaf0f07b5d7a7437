"""A camera that moves freely."""

from __future__ import annotations

import math

import numpy as np

from omniservo.errors import ServoStop
from omniservo.geometry.arrays import FloatArray
from omniservo.studies.trajectory import Trajectory

LONGEST = 1.0 / 30.0
"""[s] between two poses that are noted. The way between them counts as straight: at 0.5 m/s and 1.5 rad/s
that is at most 0.1 mm off."""

HOLD = 0.25
"""[s] that a twist acts at most: after so long without an image the camera stands"""


class FreeCarrier:
    """Moves the camera by the exponential map of its twist, at once and exactly.

    Args:
        trajectory: takes in where it goes.
    """

    def __init__(self, trajectory: Trajectory) -> None:
        self._trajectory = trajectory
        self._time, self._twist, self._since = 0.0, np.zeros(6), 0.0
        self._stands = True
        self.rotation = np.eye(3)
        """(3, 3) of initial_T_camera"""
        self.centre = np.zeros(3)
        """(3,) of the camera, in the initial camera frame [m]"""
        self._note()

    def carry(self, twist: FloatArray) -> None:
        """Move by this twist (6,) from now on, for `HOLD` at most."""
        self._twist, self._since, self._stands = twist, self._time, not twist.any()

    def move(self, until: float) -> None:
        """Let the camera move until a time [s]."""
        if until <= self._time:
            return
        acting = min(until, max(self._since + HOLD, self._time)) - self._time
        if acting > 0.0 and not self._stands:
            pieces, begin = max(math.ceil(acting / LONGEST - 1e-9), 1), self._time
            turn, shift = exponential_map(acting / pieces * self._twist)
            for k in range(1, pieces + 1):
                self.centre = self.centre + self.rotation @ shift
                self.rotation, self._time = self.rotation @ turn, begin + acting * k / pieces
                if k < pieces:
                    self._note()
        self._time = until
        self._note()

    def brake(self, stop: ServoStop) -> None:
        """Stand at once."""

    def _note(self) -> None:
        self._trajectory.note(self._time, self.rotation, self.centre)


def exponential_map(motion: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return rotation (3, 3) and translation (3,) [m] of exp of a twist times a time (6,): υ [m], ω [rad].

    R = I + a[ω]× + b[ω]×² and t = (I + b[ω]× + c[ω]×²) υ, with a = sin θ/θ, b = (1 − cos θ)/θ² and
    c = (1 − a)/θ². `RigidTransform.from_exp_coords` has the same, and checks that take longer than all else
    between two images.
    """
    vx, vy, vz, x, y, z = motion.tolist()
    square = x * x + y * y + z * z
    angle = math.sqrt(square)
    if angle < 0.02:  # by their series, where the differences would lose digits
        a, b = 1.0 - square / 6.0 * (1.0 - square / 20.0), 0.5 - square / 24.0 * (1.0 - square / 30.0)
        c = 1.0 / 6.0 - square / 120.0 * (1.0 - square / 42.0)
    else:
        a, b = math.sin(angle) / angle, 2.0 * math.sin(0.5 * angle) ** 2 / square
        c = (1.0 - a) / square
    turn = np.array(
        [
            [1.0 - b * (y * y + z * z), b * x * y - a * z, b * x * z + a * y],
            [b * x * y + a * z, 1.0 - b * (x * x + z * z), b * y * z - a * x],
            [b * x * z - a * y, b * y * z + a * x, 1.0 - b * (x * x + y * y)],
        ]
    )
    along, rest = c * (x * vx + y * vy + z * vz), 1.0 - c * square
    shift = np.array(
        [
            rest * vx + along * x + b * (y * vz - z * vy),
            rest * vy + along * y + b * (z * vx - x * vz),
            rest * vz + along * z + b * (x * vy - y * vx),
        ]
    )
    return turn, shift
