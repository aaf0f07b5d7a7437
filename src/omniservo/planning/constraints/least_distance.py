"""Least distance: the camera stays away from every target point, ‖h − t‖² − ℓ² ≥ 0, degree 2τ."""

import math

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import leaf
from omniservo.geometry.subdivision import PROVEN
from omniservo.planning.constraints.collision import prove_outside_ball
from omniservo.planning.constraints.place import TX, TY, TZ
from omniservo.planning.constraints.push import ASLEEP, Samples, push_centre


@leaf
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


@leaf
def push_from_points(points: FloatArray, distance: float, ell: float, samples: Samples, group: int) -> None:
    """Push the centre away from the target: g = (‖h − t‖ − distance)/ℓ (see `push`)."""
    poses, targets, least = samples.poses, samples.targets, samples.least
    systems, costs = samples.systems, samples.costs
    if targets[group] == ASLEEP:
        return
    target, lowest = targets[group], least[group]
    for s in range(poses.shape[0]):
        for j in range(points.shape[0]):
            x, y, z = poses[s, TX] - points[j, 0], poses[s, TY] - points[j, 1], poses[s, TZ] - points[j, 2]
            square = x * x + y * y + z * z
            far = distance + ell * max(target, lowest)
            if square >= far * far:
                continue
            norm = math.sqrt(square)
            g = (norm - distance) / ell
            lowest = min(lowest, g)
            if g < target:
                f = 1.0 / (ell * max(norm, 1e-9 * ell))
                push_centre(systems, costs, s, poses, f * x, f * y, f * z, target - g)
    least[group] = lowest
