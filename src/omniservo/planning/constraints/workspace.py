"""Workspace: the camera centre stays in a box, least ≤ t ≤ greatest, degree τ."""

import math

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import inlined, kernel, leaf
from omniservo.geometry.subdivision import PROVEN, prove_nonnegative
from omniservo.planning.constraints.place import TX
from omniservo.planning.constraints.push import ASLEEP, Samples, push_centre


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


@inlined
def prove_workspace(controls: FloatArray, size: float, box: FloatArray) -> tuple[int, float]:
    """Decide all six walls of ``box`` (2, 3)."""
    for side in range(2):
        for axis in range(3):
            status, w = prove_wall(controls, size, side, axis, box[side, axis])
            if status != PROVEN:
                return status, w
    return PROVEN, 0.0


@leaf
def push_into_box(box: FloatArray, ell: float, samples: Samples, first: int) -> None:
    """Push the centre into the box: g = distance to a wall / ℓ (see `push`)."""
    poses, targets, least = samples.poses, samples.targets, samples.least
    systems, costs = samples.systems, samples.costs
    for wall in range(6):
        group, side, axis = first + wall, wall // 3, wall % 3
        if targets[group] == ASLEEP or math.isinf(box[side, axis]):
            continue
        f = (1.0 if side == 0 else -1.0) / ell
        x, y, z = f if axis == 0 else 0.0, f if axis == 1 else 0.0, f if axis == 2 else 0.0
        for s in range(poses.shape[0]):
            g = f * (poses[s, TX + axis] - box[side, axis])
            least[group] = min(least[group], g)
            if g < targets[group]:
                push_centre(systems, costs, s, poses, x, y, z, targets[group] - g)
