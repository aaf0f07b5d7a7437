"""Workspace: the camera centre stays in a box, least ≤ t ≤ greatest, degree τ."""

import math

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel
from omniservo.geometry.polynomial import PROVEN, prove_nonnegative
from omniservo.planning.constraints.push import push_centre


@kernel
def prove_wall(controls: FloatArray, size: float, side: int, axis: int, bound: float) -> tuple[int, float]:
    """Decide t_axis ≥ bound (side 0) or t_axis ≤ bound (side 1) on [0, 1]; controls of t (3, τ+1)."""
    if math.isinf(bound):
        return PROVEN, 0.0
    n = controls.shape[1] - 1
    gap = np.empty((1, n + 1))
    for k in range(n + 1):
        gap[0, k] = controls[axis, k] - bound if side == 0 else bound - controls[axis, k]
    return prove_nonnegative(gap, n + 6.0, size + abs(bound))


@kernel
def prove_workspace(controls: FloatArray, size: float, box: FloatArray) -> tuple[int, float]:
    """Decide all six walls of ``box`` (2, 3)."""
    for side in range(2):
        for axis in range(3):
            status, w = prove_wall(controls, size, side, axis, box[side, axis])
            if status != PROVEN:
                return status, w
    return PROVEN, 0.0


@kernel
def push_into_box(
    box: FloatArray,
    pose: FloatArray,
    ell: float,
    targets: FloatArray,
    least: FloatArray,
    system: FloatArray,
) -> float:
    """Push the centre into the box: g = distance to a wall / ℓ (see `push`)."""
    cost = 0.0
    for wall in range(6):
        side, axis = wall // 3, wall % 3
        sign = 1.0 if side == 0 else -1.0
        g = sign * (pose[9 + axis] - box[side, axis]) / ell
        least[wall] = min(least[wall], g)
        if g < targets[wall]:
            f = sign / ell
            x, y, z = f if axis == 0 else 0.0, f if axis == 1 else 0.0, f if axis == 2 else 0.0
            cost += push_centre(system, pose, x, y, z, targets[wall] - g)
    return cost
