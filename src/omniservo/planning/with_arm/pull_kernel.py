"""The rows of the arm's demands at one posture, compiled."""

from __future__ import annotations

import numpy as np

from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.geometry.held import held
from omniservo.geometry.kernel import kernel
from omniservo.robots.chain import Chain
from omniservo.robots.posture import sensitivities

LIMITS, SINGULARITY, CLEARANCE = range(3)
"""Places in ``targets`` and ``least``."""


@kernel
def write_pulls(
    chain: Chain,
    to_camera: FloatArray,
    rooms: FloatArray,
    regular: float,
    joints: FloatArray,
    posture: IntArray,
    gaps: FloatArray,
    gap_slopes: FloatArray,
    targets: FloatArray,
    systems: FloatArray,
    least: FloatArray,
    costs: FloatArray,
) -> None:
    """Write what `write_pull` does for m postures.

    Args:
        chain: of n joints.
        to_camera: see `sensitivities`.
        rooms: see `write_pull`.
        regular: likewise.
        joints: (m, n) [rad]
        posture: (k,) of each gap, ascending.
        gaps: (k,) g of pairs that are near.
        gap_slopes: (k, n) ∂g/∂q.
        targets: (3,)
        systems: (m, 6, 7) out.
        least: (m, 3) out.
        costs: (m,) out.
    """
    chain, end = held(chain), 0
    for i in range(joints.shape[0]):
        begin = end
        while end < posture.shape[0] and posture[end] == i:
            end += 1
        near, slopes = gaps[begin:end], gap_slopes[begin:end]
        costs[i] = write_pull(
            chain, to_camera, rooms, regular, joints[i], near, slopes, targets, systems[i], least[i]
        )


@kernel
def write_pull(
    chain: Chain,
    to_camera: FloatArray,
    rooms: FloatArray,
    regular: float,
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
        to_camera: see `sensitivities`.
        rooms: (n, 2) lowest and highest position that leaves the reserve [rad].
        regular: the smallest singular value that is asked for.
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
    value = sensitivities(held(chain), to_camera, q, to_joints, slope) - regular
    for i in range(6):
        for k in range(7):
            system[i, k] = 0.0
    least[LIMITS], least[SINGULARITY], least[CLEARANCE] = 1.0, min(value, 1.0), 1.0
    cost = _add_row(to_joints, slope, targets[SINGULARITY] - value, system)
    for j in range(n):
        for side in range(2):
            row[j] = 1.0 if side == 0 else -1.0
            room = row[j] * (q[j] - rooms[j, side])
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
