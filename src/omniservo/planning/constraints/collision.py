"""Collision: the camera centre stays outside spheres, ‖t − o‖² − (r + d)² ≥ 0 (26)–(28), degree 2τ."""

import math

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel, leaf
from omniservo.geometry.subdivision import PROVEN, prove_nonnegative
from omniservo.planning.constraints.constraints import SPHERE_REACH
from omniservo.planning.constraints.place import TX, TY, TZ
from omniservo.planning.constraints.push import ASLEEP, Samples, push_centre


@kernel
def prove_outside_ball(
    square: FloatArray, raised: FloatArray, size: float, centre: FloatArray, reach: float
) -> tuple[int, float]:
    """Decide ‖t(w) − o‖ ≥ reach on [0, 1], with `squares` of t and its magnitude ``size``."""
    x, y, z = centre[0], centre[1], centre[2]
    m = square.shape[1]
    constant = x * x + y * y + z * z - reach * reach
    controls = np.empty((1, m))
    for k in range(m):
        inner = x * raised[0, k] + y * raised[1, k] + z * raised[2, k]
        controls[0, k] = square[0, k] - 2.0 * inner + constant
    total = size + max(abs(x), abs(y), abs(z))
    return prove_nonnegative(controls, 3.0 * (m - 1) + 20.0, 3.0 * total * total + reach * reach)


@leaf
def prove_collision_free(
    square: FloatArray, raised: FloatArray, size: float, obstacles: FloatArray
) -> tuple[int, float]:
    """Decide the clearance of every obstacle; an obstacle whose reach is 0 asks for nothing."""
    for i in range(obstacles.shape[0]):
        if obstacles[i, SPHERE_REACH] > 0.0:
            status, w = prove_outside_ball(square, raised, size, obstacles[i], obstacles[i, SPHERE_REACH])
            if status != PROVEN:
                return status, w
    return PROVEN, 0.0


@leaf
def push_from_obstacles(obstacles: FloatArray, ell: float, samples: Samples, first: int) -> None:
    """Push the centre out of the spheres: g = (‖t − o‖ − reach)/max(reach, ℓ/20) (see `push`)."""
    poses, targets, least = samples.poses, samples.targets, samples.least
    systems, costs = samples.systems, samples.costs
    for i in range(obstacles.shape[0]):
        group, reach = first + i, obstacles[i, SPHERE_REACH]
        if reach <= 0.0 or targets[group] == ASLEEP:
            continue
        unit = max(reach, 0.05 * ell)
        for s in range(poses.shape[0]):
            x, y, z = (
                poses[s, TX] - obstacles[i, 0],
                poses[s, TY] - obstacles[i, 1],
                poses[s, TZ] - obstacles[i, 2],
            )
            distance = math.sqrt(x * x + y * y + z * z)
            g = (distance - reach) / unit
            least[group] = min(least[group], g)
            if g < targets[group]:
                f = 1.0 / (unit * max(distance, 1e-9 * unit))
                push_centre(systems, costs, s, poses, f * x, f * y, f * z, targets[group] - g)
