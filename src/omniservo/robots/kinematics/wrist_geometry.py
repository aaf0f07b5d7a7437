"""Closed-form inverse kinematics: parallel shoulder and elbow axes, spherical wrist."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from omniservo.geometry.arrays import FloatArray

_STRAIGHT = 1e-9
"""Rounding allowed in a cosine or a squared length [m²] at the border of the reach."""

SHORTEST = 1e-3
"""[m] of upper arm and forearm: an elbow that turns about the shoulder or the wrist has no closed form."""

_FREE_SINE = 1e-7
"""|sin q5| below which joints 4 and 6 turn about the same line, and their sum alone is determined."""


_FORM = (2, 1, 1, 2, 1, 2)  # axes z y y z y z: shoulder, elbow, spherical wrist


@dataclass(frozen=True)
class WristGeometry:
    """Lengths of the arm at q = 0, stretched upwards, axes z y y z y z [m].

    base_T_flange(q) = T(0, 0, height) Rz(q1) · Ry(q2) T(0, offset, upper) · Ry(q3) T(0, 0, forearm) ·
    Rz(q4) Ry(q5) Rz(q6) T(0, 0, flange): the three last axes meet in the wrist's centre.
    """

    height: float
    """base to the axes of joints 1 and 2"""
    upper: float
    """axis 2 to axis 3"""
    offset: float
    """of the forearm's plane along axis 2"""
    forearm: float
    """axis 3 to the wrist's centre"""
    flange: float
    """wrist's centre to the flange"""
    free_joint: ClassVar[int] = 3
    """the joint that may stand anywhere where axes 4 and 6 are the same line"""

    @classmethod
    def of(cls, axes: FloatArray, anchors: FloatArray, flange: FloatArray) -> WristGeometry | None:
        """Return the lengths of an arm at q = 0; None where it is of another form.

        Args:
            axes: (n, 3) of the joints.
            anchors: (n, 3) a point on each axis [m].
            flange: (4, 4) its pose.
        """
        expected = np.eye(3)[list(_FORM)]
        if axes.shape != expected.shape or not np.allclose(axes, expected, atol=1e-12):
            return None
        offset, top = float(anchors[2, 1]), flange[:3, 3]
        across = np.array([point[:2] for point in (*anchors, top)])
        if not np.allclose(across, [[0, 0]] * 2 + [[0, offset]] * 5, atol=1e-12):
            return None
        upper, forearm = float(anchors[2, 2] - anchors[1, 2]), float(anchors[4, 2] - anchors[2, 2])
        if not np.allclose(flange[:3, :3], np.eye(3), atol=1e-12) or min(abs(upper), abs(forearm)) < SHORTEST:
            return None
        return cls(
            height=float(anchors[1, 2]),
            upper=upper,
            offset=offset,
            forearm=forearm,
            flange=float(top[2] - anchors[4, 2]),
        )

    def solutions(self, rotation: FloatArray, translation: FloatArray, free: float) -> FloatArray:
        """Return every q (k, 6) [rad] in (−π, π] that reaches the pose; k ≤ 8, and 0 out of reach.

        Where q5 is a multiple of π joints 4 and 6 are coaxial: then q4 = ``free``.

        Args:
            rotation: (3, 3) base_R_flange.
            translation: (3,) of base_T_flange [m].
            free: [rad]
        """
        centre = translation - self.flange * rotation[:, 2]
        found: list[tuple[float, ...]] = []
        for q1, q2, q3 in self._arm_angles(
            float(centre[0]), float(centre[1]), float(centre[2]) - self.height
        ):
            forearm_R_flange = _turn(q1, q2 + q3).T @ rotation
            found += [(q1, q2, q3, *wrist) for wrist in _wrist_angles(forearm_R_flange, free)]
        different = list(dict.fromkeys(found))  # a straight elbow bends neither way
        wrapped = np.array(different, dtype=np.float64).reshape(-1, 6)
        return np.pi - np.mod(np.pi - wrapped, 2.0 * np.pi)

    def _arm_angles(self, x: float, y: float, z: float) -> list[tuple[float, float, float]]:
        """The four ways (front or back shoulder, elbow up or down) to put the wrist's centre at (x, y, z)."""
        forward_squared = x * x + y * y - self.offset**2
        if forward_squared < -_STRAIGHT:
            return []
        size = math.sqrt(max(forward_squared, 0.0))
        found = []
        for forward, bend in itertools.product((size, -size), (1.0, -1.0)):
            cosine = (forward**2 + z**2 - self.upper**2 - self.forearm**2) / (2.0 * self.upper * self.forearm)
            if abs(cosine) > 1.0 + _STRAIGHT:
                continue
            q3 = bend * math.acos(min(1.0, max(-1.0, cosine)))
            q1 = math.atan2(y, x) - math.atan2(self.offset, forward)
            lean = math.atan2(self.forearm * math.sin(q3), self.upper + self.forearm * math.cos(q3))
            found.append((q1, math.atan2(forward, z) - lean, q3))
        return found


def _turn(about_z: float, about_y: float) -> FloatArray:
    """Return Rz(about_z) Ry(about_y), (3, 3)."""
    cz, sz, cy, sy = math.cos(about_z), math.sin(about_z), math.cos(about_y), math.sin(about_y)
    return np.array([[cz * cy, -sz, cz * sy], [sz * cy, cz, sz * sy], [-sy, 0.0, cy]])


def _wrist_angles(matrix: FloatArray, free_q4: float) -> list[tuple[float, float, float]]:
    """The two (q4, q5, q6) with Rz(q4) Ry(q5) Rz(q6) = matrix; one where sin q5 = 0."""
    sine = math.hypot(matrix[0, 2], matrix[1, 2])
    if sine < _FREE_SINE:
        q5 = 0.0 if matrix[2, 2] > 0 else math.pi
        rest = _turn(free_q4, q5).T @ matrix
        return [(free_q4, q5, math.atan2(rest[1, 0], rest[0, 0]))]
    return [
        (
            math.atan2(sign * matrix[1, 2], sign * matrix[0, 2]),
            math.atan2(sign * sine, matrix[2, 2]),
            math.atan2(sign * matrix[2, 1], -sign * matrix[2, 0]),
        )
        for sign in (1.0, -1.0)
    ]
