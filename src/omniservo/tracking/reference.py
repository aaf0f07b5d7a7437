"""Where the camera is to be, and when: the ways that are followed, one after the other, with pauses."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from omniservo.errors import InputError
from omniservo.geometry.arrays import FloatArray
from omniservo.planning import CameraPath
from omniservo.servoing import Pause
from omniservo.tracking.leg import Leg
from omniservo.tracking.path_state import path_state

JOINS = 1e-6
"""A leg begins where the one before is left, in m and in the quaternion, and as fast, in m/s and rad/s."""

_PLACES = 9
"""at which a way of slowing down is evaluated"""

_LINE = 129
"""at which a leg is taken for straight between two"""

_AT_ONCE = 1e-3
"""Slowing down takes at least this [s]."""


class Reference:
    """The legs of a way, of which the last one ends at the goal.

    Args:
        first: the plan's own.
    """

    def __init__(self, first: Leg) -> None:
        self.legs = [first]
        """in the order in which they are followed"""
        self._pause: Pause | None = None
        self._before: list[Leg] = []
        """the legs without the pause that has not ended"""

    def leg(self, time: float) -> Leg:
        """Return the leg that is followed at ``time`` [s]."""
        for leg in reversed(self.legs):
            if leg.time <= time:
                return leg
        return self.legs[0]

    def state(self, time: float) -> tuple[float, float, FloatArray, FloatArray]:
        """Return w, ẇ [1/s], the camera's pose (7,) and its twist (6,) at ``time`` [s]."""
        return _state(self.leg(time), time)

    def pose(self, time: float) -> FloatArray:
        """Return the camera's pose (7,) at ``time`` [s]: quaternion (x, y, z, w) and translation [m]."""
        return self.state(time)[2]

    def joined(self, leg: Leg) -> Leg:
        """Return a leg as it is to go on with, with the quaternion's sign of the one before.

        Raises:
            InputError: it begins elsewhere than the way before is left, with another twist, or before the
                last one; or the reference is slowed down.
        """
        if self._pause is not None:
            raise InputError("leg: the reference is slowed down; legal: a leg after it goes on")
        if leg.time < self.legs[-1].time:
            raise InputError(f"leg.time: {leg.time:g} s given; it must be taken up after what was seen last")
        before, after = (np.concatenate(_state(each, leg.time)[2:]) for each in (self.leg(leg.time), leg))
        if before[:4] @ after[:4] < 0.0:  # φ and −φ are the same rotation
            after[:4] *= -1.0
            leg = replace(leg, path=CameraPath(-leg.path.rotation, leg.path.translation))
        apart = float(np.abs(before - after).max())
        if not apart <= JOINS:
            raise InputError(f"leg: it does not go on as the way before it is left: {apart:.2g} off")
        return leg

    def slow_down(self, time: float, slowing: float) -> float:
        """Come to rest within ``slowing`` from ``time`` on, or as it does already; return when [s]."""
        if self._pause is None:
            self._pause = Pause(time, max(slowing, _AT_ONCE))
            self._before, self.legs = self.legs, [leg.paused(self._pause) for leg in self.legs]
        return self._pause.begin + self._pause.slowing

    def go_on(self, time: float, rising: float) -> None:
        """Go on from ``time`` [s], as fast as planned after ``rising`` [s], where it was slowed down."""
        if self._pause is not None:
            pause = replace(self._pause, resumed=max(time, self._pause.begin), rising=rising)
            self.legs, self._pause = [leg.paused(pause) for leg in self._before], None

    def distance(self, place: FloatArray) -> float:
        """Return how far a place (3,) [m], in the frame of the pose at time 0, is from the way.

        That is each leg up to where the next begins: what is beyond may not be free any more.
        """
        begin = self.pose(0.0)
        there = Rotation.from_quat(begin[:4]).apply(place) + begin[4:]
        ends = [*(leg.law(after.time)[0] for leg, after in pairwise(self.legs)), 1.0]
        return min(_beside(_line(leg.path, s), there) for leg, s in zip(self.legs, ends, strict=True))

    def places(self, time: float, slowing: float) -> FloatArray:
        """Return places (k, 3) [m] up to where it stands if it slows down from ``time`` on so long [s]."""
        times = time + 0.5 * slowing * np.linspace(0.0, 1.0, _PLACES)
        return np.array([self.pose(float(t))[4:] for t in times])


def _state(leg: Leg, time: float) -> tuple[float, float, FloatArray, FloatArray]:
    """Return w, ẇ, pose (7,) and twist (6,) of a leg at ``time`` [s]."""
    s, speed = leg.law(time)
    pose, twist = np.empty(7), np.empty(6)
    path_state(*leg.path.powers, s, pose, twist)
    twist *= speed
    left = 1.0 - leg.begin
    return leg.begin + left * s, left * speed, pose, twist


@lru_cache(maxsize=16)
def _line(path: CameraPath, end: float) -> FloatArray:
    """Return places (k, 3) along a path up to an end [m]."""
    return np.ascontiguousarray(path(np.linspace(0.0, end, _LINE)).translation)


def _beside(line: FloatArray, place: FloatArray) -> float:
    """Return how far a place (3,) is from the nearest of places (k, 3), straight between them [m]."""
    steps = np.diff(line, axis=0)
    length = np.maximum((steps**2).sum(axis=1), 1e-300)
    share = np.clip(((place - line[:-1]) * steps).sum(axis=1) / length, 0.0, 1.0)
    return float(np.linalg.norm(place - line[:-1] - share[:, None] * steps, axis=1).min())
