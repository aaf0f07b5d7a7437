"""From known points with wrong ones among them to a pose: minimal samples, local optimisation, members.

Random triples give up to four poses each (P3P); a pose is scored by Σ min(r², threshold²) over all points, r
in the image, and every new best one is refined on the points near it (LO-RANSAC, MSAC score; Chum, Matas,
Kittler 2003; Torr, Zisserman 2000).
"""

import math

import numpy as np

from omniservo.cameras.unified_kernels import project_point
from omniservo.estimation.minimal_solvers.three_point_pose import three_point_poses
from omniservo.estimation.refinement.pose_refinement import minimise_pose
from omniservo.estimation.robust.consensus import draw
from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.geometry.kernel import kernel, leaf
from omniservo.geometry.quaternions import matrix_from_quaternion, quaternion_from_matrix

LEAST_SAMPLES = 3
MOST_SAMPLES = 1000
CONFIDENCE = 0.999
LOCAL_ROUNDS = 1
MEMBER_ROUNDS = 4

GATE = 4.0
"""A point whose distance from its pixel exceeds this many σ is rejected: one of 3 000 good ones."""

SAMPLE_THRESHOLD_PX = 2.0
"""Distance at which a point stops to count while sampling, where the noise is not stated."""

OUTER_GATE = 10.0
"""Farther points are not even tried."""

LARGEST_GROWTH = 2.0
"""No point is added that raises σ beyond so many times the prior, or what is stated."""

PRIOR_NOISE_PX = 0.5
PRIOR_WEIGHT = 4.0
"""While members are chosen, an unknown σ is blended with this prior, worth so many residuals."""

BISECTIONS = 30
"""find the median; sorting takes longer to compile than all the rest"""

MEDIAN_OF_SQUARES = 2.0 * math.log(2.0)
"""of the squared distance of a pixel with σ = 1 in both coordinates"""


@leaf
def sampling_threshold(noise: float) -> float:
    """Return the distance [px] at which a point stops to count while sampling; ``noise`` 0: not stated."""
    return GATE * noise if noise > 0.0 else SAMPLE_THRESHOLD_PX


@kernel
def find_pose(
    parameters: FloatArray,
    points: FloatArray,
    pixels: FloatArray,
    bearings: FloatArray,
    weights: FloatArray,
    threshold: float,
    quaternion: FloatArray,
    translation: FloatArray,
) -> int:
    """Write the pose with the least score; return how many points lie within the threshold, −1: no pose.

    ``weights`` (n,) multiply distances in px, ``threshold`` is in their unit (infinite: all points count).
    The same input gives the same answer.
    """
    n = points.shape[0]
    rotations, translations, chosen = np.empty((4, 3, 3)), np.empty((4, 3)), np.empty(3, dtype=np.int64)
    squares, inner = np.empty(n), np.empty(n)
    best, count, needed, drawn, state = math.inf, -1, MOST_SAMPLES, 0, n
    while drawn < needed:
        drawn += 1
        state = draw(state, n, chosen)
        for i in range(three_point_poses(bearings, points, chosen, rotations, translations)):
            q, t = quaternion_from_matrix(rotations[i]), translations[i].copy()
            score, inliers = pose_score(parameters, points, pixels, weights, threshold, q, t, squares)
            for _ in range(LOCAL_ROUNDS + 1):
                if not score < best:
                    break
                best, count = score, inliers
                _copy_pose(q, t, quaternion, translation)
                if inliers < 4:
                    break
                for j in range(n):
                    inner[j] = weights[j] if squares[j] < threshold * threshold else 0.0
                q, t, _, _ = minimise_pose(parameters, points, pixels, inner, 0.5 * threshold, q, t)
                score, inliers = pose_score(parameters, points, pixels, weights, threshold, q, t, squares)
        clean = (max(count, 0) / n) ** 3
        if clean > 1e-9:
            limit = math.log(1.0 - CONFIDENCE) / math.log(1.0 - min(clean, 1.0 - 1e-12))
            needed = max(LEAST_SAMPLES, min(MOST_SAMPLES, int(limit) + 1))
    return count


@kernel
def pose_score(
    parameters: FloatArray,
    points: FloatArray,
    pixels: FloatArray,
    weights: FloatArray,
    threshold: float,
    quaternion: FloatArray,
    translation: FloatArray,
    squares: FloatArray,
) -> tuple[float, int]:
    """Return Σ min(r², threshold²) and how many r² lie below; write r² (n,), infinite outside the domain."""
    score, inliers, bound = 0.0, 0, threshold * threshold
    residuals = np.empty((points.shape[0], 2))
    write_pose_residuals(parameters, points, pixels, quaternion, translation, residuals)
    for j in range(points.shape[0]):
        squares[j] = weights[j] * weights[j] * (residuals[j, 0] ** 2 + residuals[j, 1] ** 2)
        if math.isnan(squares[j]):
            squares[j] = math.inf
        if squares[j] < bound:
            inliers += 1
        score += min(squares[j], bound)
    return score, inliers


@kernel
def write_pose_residuals(
    parameters: FloatArray,
    points: FloatArray,
    pixels: FloatArray,
    quaternion: FloatArray,
    translation: FloatArray,
    residuals: FloatArray,
) -> None:
    """Write projection minus pixel (n, 2) [px]; NaN for a point outside the camera's domain."""
    r, c = np.empty((3, 3)), np.empty(3)
    matrix_from_quaternion(quaternion[0], quaternion[1], quaternion[2], quaternion[3], r)
    for j in range(points.shape[0]):
        for i in range(3):
            c[i] = 0.0
            for k in range(3):
                c[i] += r[k, i] * (points[j, k] - translation[k])
        u, v, _ = project_point(parameters, c[0], c[1], c[2])
        residuals[j, 0], residuals[j, 1] = u - pixels[j, 0], v - pixels[j, 1]


@kernel
def choose_members(
    parameters: FloatArray,
    points: FloatArray,
    pixels: FloatArray,
    weights: FloatArray,
    noise: float,
    quaternion: FloatArray,
    translation: FloatArray,
    members: BoolArray,
) -> int:
    """Refine a pose of `find_pose` robustly and write the points within the gate of it; return how many.

    Each round fits the members with a Cauchy loss of scale 2σ, estimates σ from their median distance where
    ``noise`` is not it but 0, and takes all points within the gate.
    """
    n, threshold = points.shape[0], sampling_threshold(noise)
    squares, inner = np.empty(n), np.empty(n)
    _, count = pose_score(parameters, points, pixels, weights, threshold, quaternion, translation, squares)
    bound, sigma = threshold * threshold, noise
    for j in range(n):
        members[j] = squares[j] < bound
    for _ in range(MEMBER_ROUNDS):
        if count < 4:
            break
        if noise == 0.0:
            sigma = _blended_noise(squares, members, count)
        for j in range(n):
            inner[j] = weights[j] if members[j] else 0.0
        q, t, cost, _ = minimise_pose(parameters, points, pixels, inner, 2.0 * sigma, quaternion, translation)
        if cost < math.inf:
            _copy_pose(q, t, quaternion, translation)
        pose_score(parameters, points, pixels, weights, threshold, quaternion, translation, squares)
        if noise == 0.0:
            sigma = _blended_noise(squares, members, count)
        changed = False
        count = 0
        for j in range(n):
            near = squares[j] <= (GATE * sigma) ** 2
            changed |= near != members[j]
            members[j] = near
            count += 1 if near else 0
        if not changed:
            break
    return count


@kernel
def grow_members(
    parameters: FloatArray,
    points: FloatArray,
    pixels: FloatArray,
    weights: FloatArray,
    noise: float,
    quaternion: FloatArray,
    translation: FloatArray,
    members: BoolArray,
) -> int:
    """Add points that all agree once they are fitted too, the nearest first; return how many members.

    A pose of few points predicts another one's pixel much worse than it fits their own: a good point may lie
    beyond the gate only because it was left out.
    """
    n = points.shape[0]
    squares, inner, wider = np.empty(n), np.empty(n), members.copy()
    count = 0
    for j in range(n):
        count += 1 if members[j] else 0
    while count < n:
        pose_score(parameters, points, pixels, weights, math.inf, quaternion, translation, squares)
        sigma = noise if noise > 0.0 else _blended_noise(squares, members, count)
        nearest = -1
        for j in range(n):
            wider[j] = members[j]
            if not members[j] and (nearest < 0 or squares[j] < squares[nearest]):
                nearest = j
        if not squares[nearest] < (OUTER_GATE * sigma) ** 2:
            break
        wider[nearest] = True
        for j in range(n):
            inner[j] = weights[j] if wider[j] else 0.0
        q, t, _, ok = minimise_pose(parameters, points, pixels, inner, math.inf, quaternion, translation)
        pose_score(parameters, points, pixels, weights, math.inf, q, t, squares)
        sigma = noise if noise > 0.0 else _blended_noise(squares, wider, count + 1)
        for j in range(n):
            ok = ok and (not wider[j] or squares[j] <= (GATE * sigma) ** 2)
        if not ok or sigma > max(PRIOR_NOISE_PX, noise) * LARGEST_GROWTH:
            break
        members[nearest] = True
        count += 1
        _copy_pose(q, t, quaternion, translation)
    return count


@kernel
def noise_of_all(
    parameters: FloatArray,
    points: FloatArray,
    pixels: FloatArray,
    weights: FloatArray,
    noise: float,
    quaternion: FloatArray,
    translation: FloatArray,
) -> tuple[float, float]:
    """Return σ (``noise`` where that is not 0) and the largest distance under a pose of all points."""
    n = points.shape[0]
    squares, everyone = np.empty(n), np.ones(n, dtype=np.bool_)
    pose_score(parameters, points, pixels, weights, math.inf, quaternion, translation, squares)
    sigma = noise if noise > 0.0 else _blended_noise(squares, everyone, n)
    farthest = 0.0
    for j in range(n):
        farthest = max(farthest, squares[j])
    return sigma, math.sqrt(farthest)


@leaf
def _blended_noise(squares: FloatArray, members: BoolArray, count: int) -> float:
    """Return σ from the median squared distance of the members and the prior."""
    low, high = 0.0, 0.0
    for j in range(squares.shape[0]):
        if members[j]:
            high = max(high, squares[j])
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        below = 0
        for j in range(squares.shape[0]):
            if members[j] and squares[j] <= middle:
                below += 1
        if 2 * below >= count:
            high = middle
        else:
            low = middle
    square = high / MEDIAN_OF_SQUARES
    freedom = max(2 * count - 6, 0)
    sigma: float = math.sqrt(
        (PRIOR_WEIGHT * PRIOR_NOISE_PX * PRIOR_NOISE_PX + 2 * count * square) / (PRIOR_WEIGHT + freedom)
    )
    return sigma


@leaf
def _copy_pose(q: FloatArray, t: FloatArray, quaternion: FloatArray, translation: FloatArray) -> None:
    """Copy (q, t); an assignment of arrays would take longer to compile."""
    for i in range(4):
        quaternion[i] = q[i]
    for i in range(3):
        translation[i] = t[i]
