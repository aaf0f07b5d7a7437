"""Least distance: the camera stays away from every target point, ‖h − t‖² − ℓ² ≥ 0, degree 2τ."""

import math

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel
from omniservo.geometry.polynomial import PROVEN
from omniservo.planning.constraints.collision import prove_outside_ball
from omniservo.planning.constraints.push import push_centre


@kernel
def prove_least_distance(
    square: FloatArray, raised: FloatArray, size: float, points: FloatArray, distance: float
) -> tuple[int, float, int]:
    """Decide ‖h_j − t(w)‖ ≥ distance on [0, 1] for every point; with w and j where it fails."""
    if distance > 0.0:
        for j in range(points.shape[0]):
            status, w = prove_outside_ball(square, raised, size, points[j], distance)
            if status != PROVEN:
                return status, w, j
    return PROVEN, 0.0, 0


@kernel
def push_from_points(
    points: FloatArray,
    distance: float,
    pose: FloatArray,
    ell: float,
    targets: FloatArray,
    least: FloatArray,
    system: FloatArray,
) -> float:
    """Push the centre away from the target: g = (‖h − t‖ − distance)/ℓ (see `push`)."""
    cost = 0.0
    for j in range(points.shape[0]):
        x, y, z = pose[9] - points[j, 0], pose[10] - points[j, 1], pose[11] - points[j, 2]
        norm = math.sqrt(x * x + y * y + z * z)
        g = (norm - distance) / ell
        least[0] = min(least[0], g)
        if g < targets[0]:
            f = 1.0 / (ell * max(norm, 1e-9 * ell))
            cost += push_centre(system, pose, f * x, f * y, f * z, targets[0] - g)
    return cost
