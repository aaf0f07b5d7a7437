"""Points from the bearings of several placed views, with wrong ones among them."""

import math

import numpy as np

from omniservo.cameras.unified_kernels import project_point
from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.geometry.kernel import kernel, leaf
from omniservo.geometry.matrix_products import transposed_times
from omniservo.geometry.quaternions import matrix_from_quaternion

LEAST_SINE = 1e-3
"""Two rays that meet at a smaller angle make no point."""


@kernel
def triangulate_views(
    parameters: FloatArray,
    pixels: FloatArray,
    bearings: FloatArray,
    seen: BoolArray,
    poses: FloatArray,
    threshold: float,
    points: FloatArray,
    agree: BoolArray,
) -> None:
    """Write the points (n, 3), NaN where no two rays meet, and which views agree with them (v, n).

    Every pair of rays gives the point halfway between them where they are closest; the one with the least
    Σ min(r², threshold²) [px²] over all views that see the point is taken. ``pixels`` (v, n, 2), ``bearings``
    (v, n, 3), ``seen`` (v, n), ``poses`` (v, 7) reference_T_camera.
    """
    views, n = seen.shape
    rotations = np.empty((views, 3, 3))
    for v in range(views):
        matrix_from_quaternion(poses[v, 0], poses[v, 1], poses[v, 2], poses[v, 3], rotations[v])
    trial, residuals = np.empty(3), np.empty(views)
    for j in range(n):
        best = math.inf
        for v in range(views):
            agree[v, j] = False
        for i in range(3):
            points[j, i] = math.nan
        for a in range(views):
            for b in range(a):
                if not (seen[a, j] and seen[b, j]):
                    continue
                if not _halfway(bearings[a, j], bearings[b, j], rotations, poses, a, b, trial):
                    continue
                score = _score(
                    parameters, pixels[:, j], seen[:, j], rotations, poses, threshold, trial, residuals
                )
                if score < best:
                    best = score
                    for i in range(3):
                        points[j, i] = trial[i]
                    for v in range(views):
                        agree[v, j] = residuals[v] < threshold * threshold


@kernel
def _halfway(
    bearing_a: FloatArray,
    bearing_b: FloatArray,
    rotations: FloatArray,
    poses: FloatArray,
    a: int,
    b: int,
    point: FloatArray,
) -> bool:
    """Write the middle of the shortest line between two rays; False where they do not meet in front."""
    p, q, base = np.zeros(3), np.zeros(3), np.empty(3)
    for i in range(3):
        base[i] = poses[b, 4 + i] - poses[a, 4 + i]
        for k in range(3):
            p[i] += rotations[a, i, k] * bearing_a[k]
            q[i] += rotations[b, i, k] * bearing_b[k]
    cosine = p[0] * q[0] + p[1] * q[1] + p[2] * q[2]
    x = base[0] * p[0] + base[1] * p[1] + base[2] * p[2]
    y = base[0] * q[0] + base[1] * q[1] + base[2] * q[2]
    sine2 = 1.0 - cosine * cosine
    if not sine2 > LEAST_SINE * LEAST_SINE:
        return False
    first, second = (x - cosine * y) / sine2, (cosine * x - y) / sine2
    for i in range(3):
        point[i] = 0.5 * (poses[a, 4 + i] + first * p[i] + poses[b, 4 + i] + second * q[i])
    return bool(first > 0.0 and second > 0.0)


@leaf
def _score(
    parameters: FloatArray,
    pixels: FloatArray,
    seen: BoolArray,
    rotations: FloatArray,
    poses: FloatArray,
    threshold: float,
    point: FloatArray,
    residuals: FloatArray,
) -> float:
    """Return Σ min(r², threshold²) of a point, its pixels (v, 2); write r² (v,), infinite where not seen."""
    score = 0.0
    for v in range(seen.shape[0]):
        residuals[v] = math.inf
        if not seen[v]:
            continue
        x, y, z = point[0] - poses[v, 4], point[1] - poses[v, 5], point[2] - poses[v, 6]
        r = rotations[v]
        x, y, z = transposed_times(r, x, y, z)
        p, q, ok = project_point(parameters, x, y, z)
        if ok:
            residuals[v] = (p - pixels[v, 0]) ** 2 + (q - pixels[v, 1]) ** 2
        score += min(residuals[v], threshold * threshold)
    return score
