"""The arm as a chain of hinges, compiled: where its links stand, and how the flange moves with its joints."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel, leaf
from omniservo.geometry.linear_systems import factor_cholesky, solve_factored

LENGTH_SCALE = 0.3
"""Weighs metres against radians in the singularity test: about the length of one link [m]."""

SINGULAR_VALUE = 0.02
"""Smallest singular value of the camera Jacobian (linear rows over `LENGTH_SCALE`) that is still inverted.

On the RX60 a wrist with q5 = 2…3° is about there."""


class Chain(NamedTuple):
    """A serial chain of n hinges as it stands at q = 0, in the base frame.

    A configuration is the product of exponentials base_T_flange(q) = e^{q₁} … e^{qₙ} base_T_flange(0), e^{qᵢ}
    the turn by qᵢ about the line of joint i (Brockett 1984), so hinges that share a body, and offsets, are
    the same.
    """

    axes: FloatArray
    """(n, 3) unit"""
    anchors: FloatArray
    """(n, 3) a point on each axis [m]"""
    tool: FloatArray
    """(3, 4) axes and place of the flange"""
    ranges: FloatArray
    """(n, 2) of the joints [rad]"""


@kernel
def carry(chain: Chain, q: FloatArray, frames: FloatArray) -> None:
    """Write how each joint's links have moved from where they are at q = 0, in the base frame.

    Args:
        chain: of n joints.
        q: (n,) [rad]
        frames: (n + 1, 3, 4): row i is the turn and shift of what i joints carry; row 0 stands still.
    """
    for k in range(3):
        for m in range(4):
            frames[0, k, m] = 1.0 if k == m else 0.0
    for i in range(q.shape[0]):
        old, new = frames[i], frames[i + 1]
        c, s = math.cos(q[i]), math.sin(q[i])
        x, y, z = chain.axes[i, 0], chain.axes[i, 1], chain.axes[i, 2]
        u, v, w = chain.anchors[i, 0], chain.anchors[i, 1], chain.anchors[i, 2]
        t = 1.0 - c
        for k in range(3):
            a, b, d = old[k, 0], old[k, 1], old[k, 2]
            e = t * (a * x + b * y + d * z)
            new[k, 0] = c * a + e * x + s * (b * z - d * y)
            new[k, 1] = c * b + e * y + s * (d * x - a * z)
            new[k, 2] = c * d + e * z + s * (a * y - b * x)
            new[k, 3] = old[k, 3] + (a - new[k, 0]) * u + (b - new[k, 1]) * v + (d - new[k, 2]) * w


@kernel
def place_tool(chain: Chain, frames: FloatArray, flange: FloatArray) -> None:
    """Write the flange's axes and place (3, 4) in the base frame; ``frames`` as `carry` has written them."""
    last, tool = frames[frames.shape[0] - 1], chain.tool
    for k in range(3):
        for m in range(4):
            flange[k, m] = last[k, 0] * tool[0, m] + last[k, 1] * tool[1, m] + last[k, 2] * tool[2, m]
        flange[k, 3] += last[k, 3]


@kernel
def write_jacobian(
    chain: Chain, frames: FloatArray, flange: FloatArray, length: float, J: FloatArray
) -> None:
    """Write J (6, n): the flange's twist (linear over ``length`` [m], angular), in its own frame, is J q̇."""
    for i in range(J.shape[1]):
        f = frames[i]
        x, y, z = chain.axes[i, 0], chain.axes[i, 1], chain.axes[i, 2]
        u, v, w = chain.anchors[i, 0], chain.anchors[i, 1], chain.anchors[i, 2]
        a = f[0, 0] * x + f[0, 1] * y + f[0, 2] * z
        b = f[1, 0] * x + f[1, 1] * y + f[1, 2] * z
        c = f[2, 0] * x + f[2, 1] * y + f[2, 2] * z
        dx = flange[0, 3] - (f[0, 0] * u + f[0, 1] * v + f[0, 2] * w + f[0, 3])
        dy = flange[1, 3] - (f[1, 0] * u + f[1, 1] * v + f[1, 2] * w + f[1, 3])
        dz = flange[2, 3] - (f[2, 0] * u + f[2, 1] * v + f[2, 2] * w + f[2, 3])
        mx, my, mz = (b * dz - c * dy) / length, (c * dx - a * dz) / length, (a * dy - b * dx) / length
        for k in range(3):
            J[k, i] = flange[0, k] * mx + flange[1, k] * my + flange[2, k] * mz
            J[3 + k, i] = flange[0, k] * a + flange[1, k] * b + flange[2, k] * c


@kernel
def write_miss(flange: FloatArray, goal: FloatArray, twist: FloatArray) -> None:
    """Write the twist (6,) that leads from the flange (3, 4) to ``goal`` (4, 4), in the flange's frame.

    Linear part over `LENGTH_SCALE`: straight on; angular: the rotation vector of what is missing, ≤ π.
    """
    r = np.empty((3, 3))
    for i in range(3):
        twist[i] = 0.0
        for k in range(3):
            twist[i] += flange[k, i] * (goal[k, 3] - flange[k, 3]) / LENGTH_SCALE
        for j in range(3):
            r[i, j] = flange[0, i] * goal[0, j] + flange[1, i] * goal[1, j] + flange[2, i] * goal[2, j]
    w, x, y, z = _quaternion(r)
    sine = math.sqrt(x * x + y * y + z * z)
    # 2 atan2(|v|, w)/|v| → 2/w; w is 1 to second order there.
    factor = 2.0 * math.atan2(sine, w) / sine if sine > 1e-12 else 2.0
    twist[3], twist[4], twist[5] = factor * x, factor * y, factor * z


@leaf
def _quaternion(r: FloatArray) -> tuple[float, float, float, float]:
    """Return (w, x, y, z) of a rotation matrix, w ≥ 0, by its largest component (Shepperd 1978)."""
    xx, yy, zz = r[0, 0], r[1, 1], r[2, 2]
    if xx + yy + zz > max(xx, yy, zz):
        w = 0.5 * math.sqrt(1.0 + xx + yy + zz)
        s = 0.25 / w
        return w, s * (r[2, 1] - r[1, 2]), s * (r[0, 2] - r[2, 0]), s * (r[1, 0] - r[0, 1])
    if xx >= yy and xx >= zz:
        x = 0.5 * math.sqrt(1.0 + xx - yy - zz)
        s = 0.25 / x
        w, y, z = s * (r[2, 1] - r[1, 2]), s * (r[0, 1] + r[1, 0]), s * (r[0, 2] + r[2, 0])
    elif yy >= zz:
        y = 0.5 * math.sqrt(1.0 + yy - zz - xx)
        s = 0.25 / y
        w, x, z = s * (r[0, 2] - r[2, 0]), s * (r[0, 1] + r[1, 0]), s * (r[1, 2] + r[2, 1])
    else:
        z = 0.5 * math.sqrt(1.0 + zz - xx - yy)
        s = 0.25 / z
        w, x, y = s * (r[1, 0] - r[0, 1]), s * (r[0, 2] + r[2, 0]), s * (r[1, 2] + r[2, 1])
    return (w, x, y, z) if w >= 0.0 else (-w, -x, -y, -z)


@kernel
def locate(chain: Chain, q: FloatArray, length: float, flange: FloatArray, J: FloatArray) -> None:
    """Write the flange's axes and place (3, 4) at the joints q (n,), and its Jacobian J (6, n).

    See `write_jacobian`.
    """
    frames = np.empty((q.shape[0] + 1, 3, 4))
    carry(chain, q, frames)
    place_tool(chain, frames, flange)
    write_jacobian(chain, frames, flange, length, J)


@kernel
def miss(chain: Chain, q: FloatArray, goal: FloatArray, twist: FloatArray, J: FloatArray) -> None:
    """Write the flange's twist (6,) from the joints q (n,) to ``goal`` (4, 4), and its Jacobian J (6, n).

    Both in the flange frame, linear rows over `LENGTH_SCALE`; to first order in the distance.
    """
    flange = np.empty((3, 4))
    locate(chain, q, LENGTH_SCALE, flange, J)
    write_miss(flange, goal, twist)


@kernel
def least_motion(J: FloatArray, damping: float, twist: FloatArray, motion: FloatArray) -> bool:
    """Write dq = Jᵀ(JJᵀ + μI)⁻¹ twist (n,): of what does the twist (6,), the smallest; False: singular."""
    n = J.shape[1]
    gram, weights = np.empty((6, 6)), np.empty(6)
    for i in range(6):
        weights[i] = twist[i]
    write_gram(J, damping, gram)
    if not factor_cholesky(gram, 6, 0.0):
        return False
    solve_factored(gram, 6, weights)
    for j in range(n):
        motion[j] = 0.0
        for i in range(6):
            motion[j] += J[i, j] * weights[i]
    return True


@leaf
def write_gram(J: FloatArray, damping: float, gram: FloatArray) -> None:
    """Write JJᵀ + μI (6, 6)."""
    for i in range(6):
        for k in range(i + 1):
            total = damping if i == k else 0.0
            for j in range(J.shape[1]):
                total += J[i, j] * J[k, j]
            gram[i, k] = gram[k, i] = total


@leaf
def turned(to_camera: FloatArray, flange_J: FloatArray, J: FloatArray) -> None:
    """Write the camera's Jacobian (6, n) from the flange's, by a matrix (6, 6) as of `twist_matrix`."""
    for i in range(6):
        for j in range(J.shape[1]):
            total = 0.0
            for k in range(6):
                total += to_camera[i, k] * flange_J[k, j]
            J[i, j] = total
