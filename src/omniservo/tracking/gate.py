"""Wrong features among the seen ones: what the pose of the others does not explain."""

import math

import numpy as np

from omniservo.cameras.unified_kernels import project_point
from omniservo.estimation.refinement.pose_refinement import LEAST_POINTS, refine_pose_kernel
from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.geometry.kernel import kernel
from omniservo.geometry.matrix_products import transposed_times
from omniservo.geometry.quaternions import matrix_from_quaternion

GATE = 3.5
"""A point is wrong where it lies more than so many σ away"""

MEDIAN_OF_DISTANCES = 1.1774
"""of two-dimensional Gaussian noise, in σ: √(2 ln 2)"""

ROUNDS = 5


@kernel
def robust_pose(
    parameters: FloatArray,
    points: FloatArray,
    pixels: FloatArray,
    fit: BoolArray,
    valid: BoolArray,
    gate: float,
    guess: FloatArray,
    pose: FloatArray,
) -> tuple[float, bool]:
    """Write the pose (7,) of the points that belong, mark the others as not ``valid``; return (rms [px], ok).

    It begins with the points that moved against ``guess`` as most do. Then in rounds: σ from the median
    distance between pixel and projection, which a few wrong points do not move; every ``valid`` point beyond
    both ``gate`` [px] and 3.5 σ is left out, and one that the pose does not see; a point within comes back.
    It ends where nothing changes, or where fewer than four points would be left.

    Args:
        parameters: the camera's.
        points: (n, 3) [m].
        pixels: (n, 2) [px].
        fit: (n,) the valid points that ``guess`` sees.
        valid: (n,) in and out.
        gate: least distance of a wrong point [px].
        guess: (7,) near the pose.
        pose: (7,) out, unchanged where ok is False.
    """
    n = points.shape[0]
    gaps, distances = np.empty((n, 2)), np.empty(n)
    kept, trial = fit.copy(), np.empty(n, dtype=np.bool_)
    _measure(parameters, points, pixels, fit, guess, gaps)
    _against_the_others(gaps, fit, distances)
    if _mark(distances, fit, fit, gate, trial) >= LEAST_POINTS:
        kept[:] = trial
    q, t, rms, ok = refine_pose_kernel(parameters, points, pixels, kept, guess[:4], guess[4:])
    if not ok:
        return math.inf, False
    pose[:4], pose[4:] = q, t
    for _ in range(ROUNDS):
        _measure(parameters, points, pixels, valid, pose, gaps)
        for j in range(n):
            distances[j] = math.hypot(gaps[j, 0], gaps[j, 1])
        count = _mark(distances, valid, kept, gate, trial)
        if count < LEAST_POINTS or (trial == kept).all():
            break
        q, t, found, ok = refine_pose_kernel(parameters, points, pixels, trial, pose[:4], pose[4:])
        if not ok:
            break
        pose[:4], pose[4:], rms = q, t, found
        kept[:] = trial
    for j in range(n):
        valid[j] = valid[j] and kept[j]
    return rms, True


@kernel
def _mark(distances: FloatArray, of: BoolArray, scale_of: BoolArray, gate: float, within: BoolArray) -> int:
    """Mark the points ``of`` within the gate, σ that of the points ``scale_of``; return how many."""
    bound = max(gate, GATE * _median(distances[scale_of]) / MEDIAN_OF_DISTANCES)
    count = 0
    for j in range(of.shape[0]):
        within[j] = of[j] and distances[j] <= bound
        if within[j]:
            count += 1
    return count


@kernel
def _against_the_others(gaps: FloatArray, fit: BoolArray, distances: FloatArray) -> None:
    """Write how far each gap (n, 2) lies from the median gap, which a wrong guess gives all points alike."""
    du, dv = _median(gaps[fit, 0]), _median(gaps[fit, 1])
    for j in range(fit.shape[0]):
        distances[j] = math.hypot(gaps[j, 0] - du, gaps[j, 1] - dv)


@kernel
def _measure(
    parameters: FloatArray,
    points: FloatArray,
    pixels: FloatArray,
    of: BoolArray,
    pose: FloatArray,
    gaps: FloatArray,
) -> None:
    """Write projection minus pixel (n, 2) [px] of the points ``of``; infinity without a projection."""
    r = np.empty((3, 3))
    matrix_from_quaternion(pose[0], pose[1], pose[2], pose[3], r)
    for j in range(points.shape[0]):
        gaps[j, 0] = gaps[j, 1] = math.inf
        if not of[j]:
            continue
        x, y, z = points[j, 0] - pose[4], points[j, 1] - pose[5], points[j, 2] - pose[6]
        x, y, z = transposed_times(r, x, y, z)
        u, v, ok = project_point(parameters, x, y, z)
        if ok:
            gaps[j, 0], gaps[j, 1] = u - pixels[j, 0], v - pixels[j, 1]


@kernel
def _median(values: FloatArray) -> float:
    """Return the median of values (m,), 0 of none."""
    ordered = np.sort(values)
    m = ordered.shape[0]
    return 0.5 * (ordered[(m - 1) // 2] + ordered[m // 2]) if m > 0 else 0.0
