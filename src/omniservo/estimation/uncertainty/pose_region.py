"""How far a camera's pose may be from its optimum: the region that the pixels leave, not its linear image.

A small plane seen nearly face on looks the same, to the second order, tilted either way: the cost has a bent
valley or two minima, and the ellipsoid of the linearised cost covers the truth far less often than it says.
The region S ≤ S₀ + q σ² does cover it. Its tips are walked to for 95% and for 5 σ, and the ellipsoid is
stretched to those that it leaves out, and to other minima that are not negligible; see `likelihood_region`.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import chdtri

from omniservo.estimation.refinement.pose_minima import COST
from omniservo.estimation.refinement.pose_refinement import (
    PoseEquations,
    normal_equations,
    pose_cost,
)
from omniservo.estimation.robust.pose_fit import KnownPixels
from omniservo.estimation.uncertainty.likelihood_region import (
    HALVINGS,
    LEAST_NOISE_PX,
    LEVEL,
    LONGEST_STEP,
    STEPS,
    STRAIGHT,
    stretch_weights,
    write_border_step,
)
from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel
from omniservo.geometry.quaternions import turn_quaternion

BEYOND = math.erfc(5.0 / math.sqrt(2.0))
"""probability of an error beyond 5 σ"""

SIZES = tuple(math.sqrt(float(chdtri(6, chance))) for chance in (1.0 - LEVEL, BEYOND))
"""[σ] of six numbers: of the 95% region, and of that of 5 σ"""


def pose_stretch(
    known: KnownPixels, weights: FloatArray, minima: FloatArray, covariance: FloatArray, variance: float
) -> FloatArray:
    """Return what a pose's covariance (6, 6) lacks of (t, δ): Σ β p pᵀ; zero where the linear image holds.

    Args:
        known: the points and pixels.
        weights: (n,) of the residuals; 0 leaves a point out.
        minima: (m, 8) the best one, and others that are not negligible.
        covariance: (6, 6) that of first order.
        variance: σ² of a coordinate of weight 1 [px²].
    """
    if variance < LEAST_NOISE_PX**2:
        return np.zeros((6, 6))
    best, unit = minima[0], np.ones(6)
    # of translations, the distance of the points: they count as the angles they make
    unit[:3] = np.linalg.norm(known.points[weights > 0.0] - best[4:7], axis=1).mean()
    scaled = covariance / np.outer(unit, unit)
    values, axes = np.linalg.eigh(scaled)
    ways = (axes * np.sqrt(np.maximum(values, 0.0))).T
    ways = np.concatenate((ways, -ways))
    rows = (known.parameters, known.points, known.pixels, weights)
    tips, sizes = [minima[1:, :COST]], [np.full(len(minima) - 1, SIZES[0])]
    for size in SIZES:
        tips.append(walk_poses(*rows, best[:COST], ways, unit, size * math.sqrt(variance)))
        sizes.append(np.full(len(tips[-1]), size))
    reached, away = np.concatenate(tips), np.concatenate(sizes)[:, None]
    if not len(reached):
        return np.zeros((6, 6))
    turns = Rotation.from_quat(best[:4]).inv() * Rotation.from_quat(reached[:, :4])
    offsets = np.concatenate((reached[:, 4:] - best[4:7], turns.as_rotvec()), axis=1) / away
    by = stretch_weights(scaled, offsets / unit, 1.0)
    lacking: FloatArray = (by[:, None] * offsets).T @ offsets
    return lacking


@kernel
def walk_poses(
    parameters: FloatArray,
    points: FloatArray,
    pixels: FloatArray,
    weights: FloatArray,
    best: FloatArray,
    ways: FloatArray,
    unit: FloatArray,
    reach: float,
) -> FloatArray:
    """Return the poses (k, 7) farthest along ``ways`` (k, 6) with a cost of up to ``reach``² [px²] more.

    The ways are axes of the linear ellipsoid over ``unit``, one σ long. There are no poses where the cost at
    the ends of all axes is as the ellipsoid says.
    """
    poses, count, room = np.empty((ways.shape[0], 7)), ways.shape[0], reach * reach
    equations, covered = PoseEquations(np.empty((6, 6)), np.empty(6)), np.empty(6)
    q, t = best[:4].copy(), best[4:].copy()
    cost = normal_equations(parameters, points, pixels, weights, math.inf, q, t, equations)
    bent = False
    for k in range(count):
        square = 0.0  # of the axis under the model, in px²: one σ²
        for i in range(6):
            covered[i] = ways[k, i] * unit[i]
        for i in range(6):
            for m in range(6):
                square += covered[i] * equations.normal[i, m] * covered[m]
        far = reach / math.sqrt(max(square, 1e-300))
        for i in range(6):
            covered[i] *= far
        turned = turn_quaternion(q, covered[3], covered[4], covered[5])
        there = pose_cost(parameters, points, pixels, weights, math.inf, turned, t + covered[:3])
        bent = bent or not abs(there - cost - room) <= STRAIGHT * room
    if not bent:
        return poses[:0]
    for k in range(count):
        poses[k] = best
        _walk(parameters, points, pixels, weights, ways[k] / unit, room, poses[k])
    return poses


@kernel
def _walk(
    parameters: FloatArray,
    points: FloatArray,
    pixels: FloatArray,
    weights: FloatArray,
    way: FloatArray,
    room: float,
    pose: FloatArray,
) -> None:
    """Move the best pose to where ``way`` is largest on the border of the region; see `likelihood_region`."""
    equations, cost = PoseEquations(np.empty((6, 6)), np.empty(6)), math.inf
    for k in range(STEPS):
        part = min(1.0, (k + 1.0) / (STEPS - 2.0))
        q, t = pose[:4].copy(), pose[4:].copy()
        here = normal_equations(parameters, points, pixels, weights, math.inf, q, t, equations)
        cost = min(cost, here)
        left, step = cost + part * part * room - here, way.copy()
        if not write_border_step(equations.normal, equations.gradient, left, step):
            return
        shorter = min(1.0, LONGEST_STEP / math.sqrt((step[3:] * step[3:]).sum() + 1e-300))
        over = True
        for _ in range(HALVINGS):
            turned = turn_quaternion(q, shorter * step[3], shorter * step[4], shorter * step[5])
            moved = t + shorter * step[:3]
            there = pose_cost(parameters, points, pixels, weights, math.inf, turned, moved)
            over = not there <= cost + (1.0 + STRAIGHT) * room
            if not over:
                break
            shorter *= 0.5
        if over:
            return
        pose[:4], pose[4:] = turned, moved
