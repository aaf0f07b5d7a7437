"""The compiled part of matching, first half: hypotheses from triples of dots.

All dots have one radius, so the size of a dot's image tells its distance in radii: each view alone gives a
rough cloud of points, and the two clouds differ by a rigid motion x_b = R x_a + t.
"""

from __future__ import annotations

import math

import numpy as np

from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.geometry.kernel import kernel, leaf

CAP = 16.0
"""cost of a dot without a partner, in variances"""


@leaf
def cross(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    """Vector product out = a × b."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@leaf
def dot(a: FloatArray, b: FloatArray) -> float:
    """Scalar product of 3-vectors."""
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@leaf
def gap(a: FloatArray, b: FloatArray) -> float:
    """Distance of two points."""
    return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


@leaf
def unit(a: FloatArray) -> float:
    """Divide a 3-vector by its length, which is returned; zero stays zero."""
    length = math.sqrt(dot(a, a))
    if length > 0.0:
        for k in range(3):
            a[k] /= length
    return length


@leaf
def triangle_frame(p: FloatArray, q: FloatArray, r: FloatArray, out: FloatArray) -> bool:
    """Orthonormal frame (rows of ``out``) of a triangle: along pq, in its plane, normal.

    False: the three points lie on a line.
    """
    x, y, z = out[0], out[1], out[2]
    for k in range(3):
        x[k] = q[k] - p[k]
        y[k] = r[k] - p[k]
    unit(x)
    unit(y)
    cross(x, y, z)
    flat = unit(z) < 1e-9
    cross(z, x, y)
    return not flat


@leaf
def assign(cost: FloatArray, limit: float, partner: IntArray) -> float:
    """Pair rows with columns that are each other's nearest and nearer than ``limit``.

    Returns the sum of costs.

    ``partner`` receives the column of each row, -1 for none; a row without partner costs ``limit``.
    """
    total = 0.0
    for i in range(cost.shape[0]):
        best = 0
        for j in range(cost.shape[1]):
            if cost[i, j] < cost[i, best]:
                best = j
        mutual = cost[i, best] < limit
        for k in range(cost.shape[0]):
            mutual = mutual and cost[k, best] >= cost[i, best]
        partner[i] = -1
        if mutual:
            partner[i] = best
            total += cost[i, best]
        else:
            total += limit
    return total


@leaf
def motion_between(
    frame_a: FloatArray,
    frame_b: FloatArray,
    cloud_a: FloatArray,
    triple_a: IntArray,
    cloud_b: FloatArray,
    triple_b: tuple[int, int, int],
    rotation: FloatArray,
    motion: FloatArray,
) -> None:
    """Set ``rotation`` and ``motion`` (R by rows, t) that lay one triangle on the other."""
    for r in range(3):
        t = 0.0
        for c in range(3):
            rotation[r, c] = 0.0
            for k in range(3):
                rotation[r, c] += frame_b[k, r] * frame_a[k, c]
            motion[3 * r + c] = rotation[r, c]
        for c in range(3):
            t += (cloud_b[triple_b[c], r] - dot(rotation[r], cloud_a[triple_a[c]])) / 3.0
        motion[9 + r] = t


@kernel
def register_triples(
    cloud_a: FloatArray,
    cloud_b: FloatArray,
    variance: FloatArray,
    triples: IntArray,
    partners: IntArray,
    scores: FloatArray,
    motions: FloatArray,
) -> int:
    """Lay each triple of the first cloud onto every triple of the second that has about its side lengths.

    Args:
        cloud_a: (n, 3) dots of the first view, in radii of a dot.
        cloud_b: (m, 3) dots of the second view.
        variance: (m,) of the difference between a dot of the second cloud and the same dot of the first.
        triples: (k, 3) indices into the first cloud.
        partners: (h, n) receives the partner of each dot, -1 for none.
        scores: (h,) receives the sum of squared distances in variances, capped at `CAP` a dot.
        motions: (h, 12) receives R by rows, then t.

    Returns:
        the number of hypotheses written, at most h.
    """
    n, m = len(cloud_a), len(cloud_b)
    frame_a, frame_b, rotation = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    cost = np.empty((n, m))
    moved = np.empty(3)
    count = 0
    for k in range(len(triples)):
        i0, i1, i2 = triples[k]
        if not triangle_frame(cloud_a[i0], cloud_a[i1], cloud_a[i2], frame_a):
            continue
        for j0 in range(m):
            for j1 in range(m):
                if not _alike(cloud_a, cloud_b, i0, i1, j0, j1, variance):
                    continue
                for j2 in range(m):
                    if count == len(scores):
                        return count
                    alike = _alike(cloud_a, cloud_b, i0, i2, j0, j2, variance)
                    if not (alike and _alike(cloud_a, cloud_b, i1, i2, j1, j2, variance)):
                        continue
                    if not triangle_frame(cloud_b[j0], cloud_b[j1], cloud_b[j2], frame_b):
                        continue
                    motion_between(
                        frame_a, frame_b, cloud_a, triples[k], cloud_b, (j0, j1, j2), rotation, motions[count]
                    )
                    for i in range(n):
                        for r in range(3):
                            moved[r] = dot(rotation[r], cloud_a[i]) + motions[count, 9 + r]
                        for j in range(m):
                            cost[i, j] = gap(moved, cloud_b[j]) ** 2 / variance[j]
                    scores[count] = assign(cost, CAP, partners[count])
                    count += 1
    return count


@leaf
def _alike(
    cloud_a: FloatArray, cloud_b: FloatArray, i: int, k: int, j: int, h: int, variance: FloatArray
) -> bool:
    if j == h:
        return False
    off = gap(cloud_a[i], cloud_a[k]) - gap(cloud_b[j], cloud_b[h])
    return bool(off * off < 12.0 * (variance[j] + variance[h]))
