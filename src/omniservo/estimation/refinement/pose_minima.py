"""The minima of the pixel cost over a camera's pose: the best one, and those that rival it.

Seen from afar, points on a plane look the same after the plane is mirrored across the line of sight: with v
the unit vector to their middle and n the plane's normal, the rotations R and (I − 2vvᵀ) R (I − 2nnᵀ) of the
target have nearly the same image (Schweighofer, Pinz 2006). So the mirrored pose of what is flat is a start;
with few points, all poses of the widest triangle are starts too.
"""

import math

import numpy as np

from omniservo.estimation.minimal_solvers.three_point_pose import three_point_poses
from omniservo.estimation.refinement.pose_refinement import minimise_pose
from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.geometry.kernel import kernel, leaf
from omniservo.geometry.linear_systems import symmetric_eigen
from omniservo.geometry.quaternions import matrix_from_quaternion, quaternion_from_matrix

COST = 7
"""A minimum is a row (8,): quaternion (x, y, z, w), translation [m], and in this place Σ(wr)² [px²]."""

MOST_MINIMA = 6
FEW_POINTS = 6
"""Up to here a triangle's other poses may be minima of all points."""

FLAT = 0.3
"""Thicker targets (third extent over the second) do not look alike when they are mirrored."""

LEAST_WIDTH = 1e-3
"""Points whose extent across a line is below this part of that along it count as one line."""

SAME_ANGLE = 1e-3
SAME_DISTANCE = 1e-3
"""Poses closer than both, in rad and in distances from the target, are one minimum."""


@kernel
def principal_axes(
    points: FloatArray, weights: FloatArray, middle: FloatArray, normal: FloatArray
) -> tuple[float, float]:
    """Write middle and direction of least extent (3,) of the points with a weight; return width, thickness.

    Width is the second extent (singular value) over the first, 0 for points on a line; thickness the third
    over the second, 0 for points on a plane.
    """
    count = 0
    for i in range(3):
        middle[i] = 0.0
    for j in range(points.shape[0]):
        if weights[j] > 0.0:
            count += 1
            for i in range(3):
                middle[i] += points[j, i]
    for i in range(3):
        middle[i] /= max(count, 1)
    gram = np.zeros((3, 3))
    for j in range(points.shape[0]):
        if weights[j] > 0.0:
            for i in range(3):
                for k in range(3):
                    gram[i, k] += (points[j, i] - middle[i]) * (points[j, k] - middle[k])
    values, vectors = symmetric_eigen(gram)
    for i in range(3):
        normal[i] = vectors[i, 0]
    if not values[1] > 0.0:
        return 0.0, 0.0
    return math.sqrt(values[1] / values[2]), math.sqrt(max(values[0], 0.0) / values[1])


@kernel
def pose_minima(
    parameters: FloatArray,
    points: FloatArray,
    pixels: FloatArray,
    bearings: FloatArray,
    weights: FloatArray,
    quaternion: FloatArray,
    translation: FloatArray,
    minima: FloatArray,
) -> int:
    """Write the minima found from a good pose, best first; return how many.

    ``weights`` (n,) as in `minimise_pose`, 0 for points that are left out; ``minima`` is (MOST_MINIMA, 8).
    """
    middle, normal = np.empty(3), np.empty(3)
    _, thickness = principal_axes(points, weights, middle, normal)
    q, t, cost, ok = minimise_pose(parameters, points, pixels, weights, math.inf, quaternion, translation)
    count = _insert(q, t, cost, middle, minima, 0) if ok else 0
    if count > 0 and thickness < FLAT:
        _mirrored(minima[0], middle, normal, q, t)
        q, t, cost, ok = minimise_pose(parameters, points, pixels, weights, math.inf, q, t)
        count = _insert(q, t, cost, middle, minima, count) if ok else count
    members = 0
    for j in range(weights.shape[0]):
        if weights[j] > 0.0:
            members += 1
    if members <= FEW_POINTS:
        rotations, translations, chosen = np.empty((4, 3, 3)), np.empty((4, 3)), np.empty(3, dtype=np.int64)
        _widest_triangle(points, weights, chosen)
        for i in range(three_point_poses(bearings, points, chosen, rotations, translations)):
            q = quaternion_from_matrix(rotations[i])
            q, t, cost, ok = minimise_pose(parameters, points, pixels, weights, math.inf, q, translations[i])
            count = _insert(q, t, cost, middle, minima, count) if ok else count
    return count


@leaf
def _insert(
    q: FloatArray, t: FloatArray, cost: float, middle: FloatArray, minima: FloatArray, count: int
) -> int:
    """Insert a minimum among the first ``count``, in the order of the cost, unless it is known."""
    distance2 = (middle[0] - t[0]) ** 2 + (middle[1] - t[1]) ** 2 + (middle[2] - t[2]) ** 2
    for m in range(count):
        cosine, gap = 0.0, 0.0
        for i in range(4):
            cosine += q[i] * minima[m, i]
        for i in range(3):
            gap += (t[i] - minima[m, 4 + i]) ** 2
        near = 1.0 - min(abs(cosine), 1.0) < 0.125 * SAME_ANGLE * SAME_ANGLE
        if near and gap < SAME_DISTANCE * SAME_DISTANCE * distance2:
            return count
    place = count
    while place > 0 and minima[place - 1, COST] > cost:
        place -= 1
    if place >= MOST_MINIMA:
        return count
    for m in range(min(count, MOST_MINIMA - 1), place, -1):
        for i in range(COST + 1):
            minima[m, i] = minima[m - 1, i]
    for i in range(4):
        minima[place, i] = q[i]
    for i in range(3):
        minima[place, 4 + i] = t[i]
    minima[place, COST] = cost
    return min(count + 1, MOST_MINIMA)


@kernel
def _mirrored(pose: FloatArray, middle: FloatArray, normal: FloatArray, q: FloatArray, t: FloatArray) -> None:
    """Write the pose that shows the target mirrored at the plane across the line of sight to its middle."""
    r, turned = np.empty((3, 3)), np.empty((3, 3))
    matrix_from_quaternion(pose[0], pose[1], pose[2], pose[3], r)
    sight = np.zeros(3)  # the middle in the camera
    for i in range(3):
        for k in range(3):
            sight[i] += r[k, i] * (middle[k] - pose[4 + k])
    square = sight[0] ** 2 + sight[1] ** 2 + sight[2] ** 2
    across = np.zeros(3)  # Rᵀ n, the normal in the camera
    for i in range(3):
        for k in range(3):
            across[i] += r[k, i] * normal[k]
    along = (across[0] * sight[0] + across[1] * sight[1] + across[2] * sight[2]) / square
    # reference_R_camera of the mirrored pose: (I − 2nnᵀ) R (I − 2vvᵀ)
    for i in range(3):
        rv = (r[i, 0] * sight[0] + r[i, 1] * sight[1] + r[i, 2] * sight[2]) / square
        for k in range(3):
            turned[i, k] = (
                r[i, k]
                - 2.0 * rv * sight[k]
                - 2.0 * normal[i] * across[k]
                + 4.0 * normal[i] * along * sight[k]
            )
    turn = quaternion_from_matrix(turned)
    for i in range(4):
        q[i] = turn[i]
    for i in range(3):
        t[i] = middle[i] - (turned[i, 0] * sight[0] + turned[i, 1] * sight[1] + turned[i, 2] * sight[2])


@leaf
def _widest_triangle(points: FloatArray, weights: FloatArray, chosen: IntArray) -> None:
    """Write the rows of a wide triangle: two points far apart, and the one farthest from their line."""
    first = 0
    while not weights[first] > 0.0:
        first += 1
    for i in range(3):
        chosen[i] = first
    for end in range(2):
        largest = -1.0
        for j in range(points.shape[0]):
            gap = (
                (points[j, 0] - points[chosen[end], 0]) ** 2
                + (points[j, 1] - points[chosen[end], 1]) ** 2
                + (points[j, 2] - points[chosen[end], 2]) ** 2
            )
            if weights[j] > 0.0 and gap > largest:
                chosen[1 - end], largest = j, gap
    largest = -1.0
    a, b = chosen[0], chosen[1]
    for j in range(points.shape[0]):
        x, y, z = points[j, 0] - points[a, 0], points[j, 1] - points[a, 1], points[j, 2] - points[a, 2]
        ex, ey, ez = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2]
        area = (y * ez - z * ey) ** 2 + (z * ex - x * ez) ** 2 + (x * ey - y * ex) ** 2
        if weights[j] > 0.0 and area > largest:
            chosen[2], largest = j, area
