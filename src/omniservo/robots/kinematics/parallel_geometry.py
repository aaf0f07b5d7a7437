"""Closed-form inverse kinematics: axes 2, 3 and 4 parallel, as Universal Robots build their arms."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.robots.kinematics.wrist_geometry import SHORTEST

_ALIGNED = 1e-8
"""[m], [rad] by which axes may miss being parallel, perpendicular or concurrent: URDFs round their angles."""

_STRAIGHT = 1e-9
"""Rounding allowed in a cosine, or a length [m], at the border of the reach."""

_FREE_SINE = 1e-7
"""|sin| between axes 4 and 6 below which they are parallel, and joint 6 may take any position."""


@dataclass(frozen=True, eq=False)
class ParallelGeometry:
    """Axes 2, 3, 4 parallel; 1 and 5 perpendicular to them; 6 perpendicular to 5 and through a point of it.

    base_T_flange(q) = e₁(q1) … e₆(q6) base_T_flange(0) with eᵢ the turn about axis i as it lies at q = 0,
    which may be any configuration. Solved in turn for q1 (what axes 2 to 4 leave along themselves), q5, q6,
    and the two links in the plane across.
    """

    axes: FloatArray
    """(6, 3) unit vectors at q = 0"""
    anchors: FloatArray
    """(6, 3) a point on each axis [m]; that of axis 6 lies on axis 5, too"""
    zero: FloatArray
    """(4, 4) base_T_flange at q = 0"""
    free_joint: ClassVar[int] = 5
    """the joint that may stand anywhere where axes 4 and 6 are parallel"""

    @classmethod
    def of(cls, axes: FloatArray, anchors: FloatArray, flange: FloatArray) -> ParallelGeometry | None:
        """Return the geometry of an arm at q = 0; None where it is of another form.

        Args:
            axes: (n, 3) of the joints.
            anchors: (n, 3) a point on each axis [m].
            flange: (4, 4) its pose.
        """
        if axes.shape != (6, 3):
            return None
        lift, elbow, turn = axes[1], axes[2], axes[3]
        parallel = max(abs(_cross(lift, elbow)).max(), abs(_cross(lift, turn)).max())
        across = max(abs(axes[0] @ lift), abs(axes[4] @ lift), abs(axes[5] @ axes[4]))
        between = anchors[5] - anchors[4]
        apart = abs(between @ _cross(axes[4], axes[5]))  # of perpendicular axes 5 and 6
        upper, forearm = (_within(lift, anchors[i + 1] - anchors[i]) for i in (1, 2))
        if max(parallel, across, apart) > _ALIGNED or min(_norm(upper), _norm(forearm)) < SHORTEST:
            return None
        points = anchors.copy()
        points[5] = anchors[5] - (between @ axes[5]) * axes[5]
        return cls(axes, points, flange)

    def solutions(self, rotation: FloatArray, translation: FloatArray, free: float) -> FloatArray:
        """Return every q (k, 6) [rad] in (−π, π] that reaches the pose; k ≤ 8, and 0 out of reach.

        Where axes 4 and 6 are parallel: q6 = ``free``.

        Args:
            rotation: (3, 3) base_R_flange.
            translation: (3,) of base_T_flange [m].
            free: [rad]
        """
        turned = rotation @ self.zero[:3, :3].T
        shift = translation - turned @ self.zero[:3, 3]
        found: list[tuple[float, ...]] = []
        for q1 in self._pans(turned @ self.anchors[5] + shift):
            after_1, place_1 = self._undo(0, q1, turned, shift)
            for q5, q6 in self._wrists(after_1, free):
                found += [(q1, q2, q3, q4, q5, q6) for q2, q3, q4 in self._lifts(after_1, place_1, q5, q6)]
        wrapped = np.array(found, dtype=np.float64).reshape(-1, 6)
        return np.pi - np.mod(np.pi - wrapped, 2.0 * np.pi)

    def _pans(self, wrist: FloatArray) -> list[float]:
        """The two q1 with which axes 2 to 4 can bring the meeting point of axes 5 and 6 to ``wrist``."""
        first, lift = self.axes[0], self.axes[1]
        arm = wrist - self.anchors[0]
        along = lift @ (self.anchors[5] - self.anchors[0])
        return _angles(arm @ lift, arm @ _cross(first, lift), along)

    def _wrists(self, after_1: FloatArray, free: float) -> list[tuple[float, float]]:
        """The (q5, q6) with which axis 6 and the flange lie to axis 2 as e₁⁻¹ e₁…e₆ says."""
        lift, fifth, last = self.axes[1], self.axes[4], self.axes[5]
        found = []
        target = after_1.T @ lift
        for q5 in _angles(lift @ last, lift @ _cross(fifth, last), lift @ (after_1 @ last)):
            seen = _turn(fifth, -q5) @ lift
            across = _within(last, seen)
            if _norm(across) < _FREE_SINE:
                return [(q5, free)]
            found.append((q5, -_signed(last, across, target)))
        return found

    def _lifts(
        self, after_1: FloatArray, place_1: FloatArray, q5: float, q6: float
    ) -> list[tuple[float, float, float]]:
        """The two (q2, q3, q4), elbow up and down; none out of reach."""
        lift = self.axes[1]
        back = _turn(self.axes[5], -q6) @ _turn(
            self.axes[4], -q5
        )  # e₆⁻¹ e₅⁻¹ keeps the point where both axes meet
        point = self.anchors[5]
        turned = after_1 @ back
        wrist = after_1 @ (back @ (self.anchors[3] - point) + point) + place_1
        total = _signed(lift, self.axes[0], turned @ self.axes[0])
        upper, forearm = (_within(lift, self.anchors[i + 1] - self.anchors[i]) for i in (1, 2))
        reached = _within(lift, wrist - self.anchors[1])
        a, b = _norm(upper), _norm(forearm)
        cosine = float(reached @ reached - a * a - b * b) / (2.0 * a * b)
        if abs(cosine) > 1.0 + _STRAIGHT:
            return []
        bend, rest = math.acos(min(1.0, max(-1.0, cosine))), _signed(lift, upper, forearm)
        found = []
        for sign in (1.0, -1.0) if bend > 0.0 else (1.0,):
            elbow = sign * bend - rest
            shoulder = _signed(lift, upper + _turn(lift, elbow) @ forearm, reached)
            found.append((shoulder, elbow * self._way(2), (total - shoulder - elbow) * self._way(3)))
        return found

    def _way(self, joint: int) -> float:
        """+1 where the joint turns as joint 2 does, else −1."""
        return math.copysign(1.0, float(self.axes[joint] @ self.axes[1]))

    def _undo(
        self, joint: int, angle: float, turned: FloatArray, shift: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return rotation and translation of e⁻¹ (turned, shift)."""
        back, point = _turn(self.axes[joint], -angle), self.anchors[joint]
        return back @ turned, back @ (shift - point) + point


def _angles(a: float, b: float, c: float) -> list[float]:
    """Every x with a cos x + b sin x = c, two of them, or none; 0 where any x does."""
    size = math.hypot(a, b)
    if max(size, abs(c)) < _STRAIGHT:
        return [0.0]
    if size < 1e-12 or abs(c) > size * (1.0 + _STRAIGHT):
        return []
    middle, half = math.atan2(b, a), math.acos(min(1.0, max(-1.0, c / size)))
    return [middle + half, middle - half] if half > 0.0 else [middle]


def _turn(axis: FloatArray, angle: float) -> FloatArray:
    """Return the rotation about a unit vector, (3, 3), by Rodrigues' formula."""
    s, c = math.sin(angle), math.cos(angle)
    x, y, z = axis.tolist()
    k = 1.0 - c
    return np.array(
        [
            [c + k * x * x, k * x * y - s * z, k * x * z + s * y],
            [k * x * y + s * z, c + k * y * y, k * y * z - s * x],
            [k * x * z - s * y, k * y * z + s * x, c + k * z * z],
        ]
    )


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    (x, y, z), (u, v, w) = a.tolist(), b.tolist()
    return np.array([y * w - z * v, z * u - x * w, x * v - y * u])


def _norm(a: FloatArray) -> float:
    return math.sqrt(float(a @ a))


def _within(axis: FloatArray, a: FloatArray) -> FloatArray:
    """Return the part of ``a`` perpendicular to the unit vector."""
    part: FloatArray = a - (a @ axis) * axis
    return part


def _signed(axis: FloatArray, a: FloatArray, b: FloatArray) -> float:
    """Return the angle about the axis from ``a`` to ``b``, both seen along it."""
    return math.atan2(float(axis @ _cross(a, b)), float(a @ b - (axis @ a) * (axis @ b)))
