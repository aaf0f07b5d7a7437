"""Whether the motion from one pose to the next keeps every constraint: compiled, and in NumPy.

Centres on a line, rotations by slerp, as in `attempt.Polyline`; poses at most `STEP` · ℓ and `TURN` apart.
"""

from __future__ import annotations

import math

import numpy as np
from benchmarks.comparisons.planning.neutral import Neutral
from benchmarks.comparisons.planning.pose_check import pose_values
from benchmarks.comparisons.planning.samples import Poses, families
from scipy.spatial.transform import Rotation

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel

STEP = 0.003
"""of ℓ"""
TURN = 0.008
"""[rad]"""
COARSE = 8
"""In NumPy every such pose is looked at before all are."""


@kernel
def steps_between(ell: float, start: FloatArray, end: FloatArray) -> int:
    """Return the number of checked poses after the first, of poses (7,): centre, unit quaternion."""
    dx, dy, dz = end[0] - start[0], end[1] - start[1], end[2] - start[2]
    cosine = abs(start[3] * end[3] + start[4] * end[4] + start[5] * end[5] + start[6] * end[6])
    turn = 2.0 * math.acos(min(cosine, 1.0))
    return int(max(math.ceil(math.sqrt(dx * dx + dy * dy + dz * dz) / (STEP * ell)), turn // TURN + 1.0, 1.0))


@kernel
def motion_is_free(neutral: Neutral, start: FloatArray, end: FloatArray) -> bool:
    """Tell whether the poses after the first keep everything; halves first: a bad motion ends early."""
    count = steps_between(neutral.ell, start, end)
    cosine = start[3] * end[3] + start[4] * end[4] + start[5] * end[5] + start[6] * end[6]
    sign = 1.0 if cosine >= 0.0 else -1.0
    angle = math.acos(min(abs(cosine), 1.0))
    quaternion, t, least = np.empty(4), np.empty(3), np.zeros(5)
    stride = 1
    while stride < count:
        stride *= 2
    while stride > 0:
        i = stride
        while i <= count:
            part = i / count
            a, b = 1.0 - part, sign * part
            if angle > 1e-6:
                a, b = (
                    math.sin((1.0 - part) * angle) / math.sin(angle),
                    sign * math.sin(part * angle) / math.sin(angle),
                )
            for c in range(4):
                quaternion[c] = a * start[3 + c] + b * end[3 + c]
            for c in range(3):
                t[c] = start[c] + part * (end[c] - start[c])
            if pose_values(neutral, quaternion, t, least) < 0.0:
                return False
            i += 2 * stride
        stride //= 2
    return True


def motion_is_free_numpy(neutral: Neutral, start: FloatArray, end: FloatArray) -> bool:
    """Tell the same in NumPy: every `COARSE`-th pose first, which ends most bad motions."""
    count = steps_between(neutral.ell, start, end)
    part = np.arange(count, 0, -1) / count
    return _poses_are_free(neutral, start, end, part[::COARSE]) and (
        count <= 1 or _poses_are_free(neutral, start, end, part)
    )


def _poses_are_free(neutral: Neutral, start: FloatArray, end: FloatArray, part: FloatArray) -> bool:
    cosine = float(start[3:] @ end[3:])
    angle = math.acos(min(abs(cosine), 1.0))
    a, b = 1.0 - part, part
    if angle > 1e-6:
        a, b = np.sin(a * angle) / math.sin(angle), np.sin(b * angle) / math.sin(angle)
    phi = a[:, None] * start[3:] + math.copysign(1.0, cosine) * b[:, None] * end[3:]
    t = start[:3] + part[:, None] * (end[:3] - start[:3])
    found = families(neutral, Poses(phi, t, Rotation.from_quat(phi).as_matrix()), False)
    return all(not g.size or g.min() >= 0.0 for g, _ in found)
