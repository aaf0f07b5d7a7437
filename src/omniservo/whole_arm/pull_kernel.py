"""The rows of the arm's constraints at configurations, compiled."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.geometry.held import held
from omniservo.geometry.kernel import kernel
from omniservo.robots.collision.gap_kernels import write_gap_slope
from omniservo.robots.collision.posture_gaps import Postures, near_pairs
from omniservo.robots.collision.shapes import Shapes
from omniservo.robots.kinematics.chain import Chain
from omniservo.robots.kinematics.posture import sensitivities

LIMITS, SINGULARITY, CLEARANCE = range(3)
"""Places in ``targets`` and ``least``."""


class JointConstraints(NamedTuple):
    """What a configuration has to keep."""

    to_camera: FloatArray
    """see `sensitivities`"""
    rooms: FloatArray
    """(n, 2) lowest and highest position that leaves the reserve [rad]"""
    regular: FloatArray
    """(1,) the smallest singular value"""
    gaps: FloatArray
    """(p,) of each pair [m]"""
    ell: FloatArray
    """(1,) [m] what gaps are divided by"""


class Near(NamedTuple):
    """The k gaps that are near in some configuration, ascending in the configuration."""

    posture: IntArray
    """(k,) of each gap"""
    pair: IntArray
    """(k,) likewise"""
    gaps: FloatArray
    """(k,) [m]"""


class Pulls(NamedTuple):
    """Rows of m configurations as in `omniservo.planning.constraints.push`."""

    systems: FloatArray
    """(m, 6, 7) [Σ a aᵀ, Σ a r] for a camera motion ξ = (linear [m], angular) in the camera frame"""
    costs: FloatArray
    """(m,) Σ r²/2"""
    least: FloatArray
    """(m, 3) smallest g"""


@kernel
def measured_pulls(
    chain: Chain,
    shapes: Shapes,
    frames: FloatArray,
    postures: Postures,
    asked: JointConstraints,
    joints: FloatArray,
    targets: FloatArray,
    pulls: Pulls,
) -> tuple[IntArray, IntArray, FloatArray, IntArray]:
    """Return what `near_pairs` finds below its target; unless some of it may touch, `write_pulls`."""
    chain, shapes, postures = held(chain), held(shapes), held(postures)
    within = asked.gaps + asked.ell[0] * max(targets[CLEARANCE], 0.0)
    posture, pair, gaps, touching = near_pairs(chain, shapes, frames, joints, within, postures)
    if touching.shape[0] == 0:
        write_pulls(chain, shapes, postures, asked, joints, Near(posture, pair, gaps), targets, pulls)
    return posture, pair, gaps, touching


@kernel
def write_pulls(
    chain: Chain,
    shapes: Shapes,
    postures: Postures,
    asked: JointConstraints,
    joints: FloatArray,
    near: Near,
    targets: FloatArray,
    pulls: Pulls,
) -> None:
    """Write what `write_pull` does for m configurations.

    Args:
        chain: of n joints.
        shapes: of the arm and what stands around.
        postures: as measured.
        asked: of a configuration.
        joints: (m, n) [rad]
        near: of all configurations.
        targets: (3,)
        pulls: out.
    """
    chain, shapes, postures, end = held(chain), held(shapes), held(postures), 0
    posture, pair, gaps = near
    left, slopes = np.empty(gaps.shape[0]), np.empty((gaps.shape[0], joints.shape[1]))
    for k in range(gaps.shape[0]):
        i, p = posture[k], pair[k]
        left[k] = (gaps[k] - asked.gaps[p]) / asked.ell[0]
        write_gap_slope(
            postures.anchors[i],
            postures.directions[i],
            shapes.carried,
            shapes.pairs[p],
            postures.ends[i, p],
            postures.normals[i, p],
            slopes[k],
        )
        for j in range(slopes.shape[1]):
            slopes[k, j] /= asked.ell[0]
    for i in range(joints.shape[0]):
        begin = end
        while end < posture.shape[0] and posture[end] == i:
            end += 1
        pulls.costs[i] = write_pull(
            chain,
            asked,
            joints[i],
            left[begin:end],
            slopes[begin:end],
            targets,
            pulls.systems[i],
            pulls.least[i],
        )


@kernel
def write_pull(
    chain: Chain,
    asked: JointConstraints,
    q: FloatArray,
    gaps: FloatArray,
    gap_slopes: FloatArray,
    targets: FloatArray,
    system: FloatArray,
    least: FloatArray,
) -> float:
    """Write the rows of what is below its target, as in `omniservo.planning.constraints.push`.

    Args:
        chain: of n joints.
        asked: of the configuration.
        q: (n,) [rad]
        gaps: (k,) g of pairs that are near.
        gap_slopes: (k, n) ∂g/∂q.
        targets: (3,)
        system: (6, 7) out: [Σ a aᵀ, Σ a r] with a = J⁺ᵀ ∂g/∂q and r = target − g.
        least: (3,) out: the smallest g of each group; 1 where none is smaller.

    Returns:
        Σ r²/2.
    """
    n = q.shape[0]
    to_joints, slope, row = np.empty((n, 6)), np.empty(n), np.zeros(n)
    value = sensitivities(held(chain), asked.to_camera, q, to_joints, slope) - asked.regular[0]
    for i in range(6):
        for k in range(7):
            system[i, k] = 0.0
    least[LIMITS], least[SINGULARITY], least[CLEARANCE] = 1.0, min(value, 1.0), 1.0
    cost = _add_row(to_joints, slope, targets[SINGULARITY] - value, system)
    for j in range(n):
        for side in range(2):
            row[j] = 1.0 if side == 0 else -1.0
            room = row[j] * (q[j] - asked.rooms[j, side])
            least[LIMITS] = min(least[LIMITS], room)
            cost += _add_row(to_joints, row, targets[LIMITS] - room, system)
        row[j] = 0.0
    for k in range(gaps.shape[0]):
        least[CLEARANCE] = min(least[CLEARANCE], gaps[k])
        cost += _add_row(to_joints, gap_slopes[k], targets[CLEARANCE] - gaps[k], system)
    return float(cost)


@kernel
def _add_row(to_joints: FloatArray, slope: FloatArray, residual: float, system: FloatArray) -> float:
    """Add the row of a constraint with ∂g/∂q = slope (n,), if it is below its target; return r²/2."""
    if not residual > 0.0:
        return 0.0
    a = np.zeros(6)
    for j in range(slope.shape[0]):
        for i in range(6):
            a[i] += slope[j] * to_joints[j, i]
    for i in range(6):
        for k in range(6):
            system[i, k] += a[i] * a[k]
        system[i, 6] += a[i] * residual
    return 0.5 * residual * residual
