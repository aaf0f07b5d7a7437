"""The pose of a central camera from three known points: up to four solutions (P3P).

With unit bearings bᵢ the distances λᵢ > 0 of the points obey λᵢ² + λⱼ² − 2 cᵢⱼ λᵢλⱼ = aᵢⱼ, where cᵢⱼ = bᵢ·bⱼ
and aᵢⱼ are the squared sides of the triangle. Two homogeneous differences of these are conics in λ; a
member of their pencil splits into two lines, and each line meets a conic in two directions of λ (Persson
and Nordberg 2018, "Lambda Twist"). Nothing asks for an image plane: bearings may lie past 90° from the axis.
"""

import math

import numpy as np

from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.geometry.kernel import kernel, leaf

LEAST_SINE = 1e-3
"""A triangle, or its three bearings, flatter than this has no usable pose."""

NEARLY_DOUBLE = 1e-4
"""Relative negative discriminant that noise may give to two solutions which are one."""

POLISHING_STEPS = 3


@kernel
def three_point_poses(
    bearings: FloatArray,
    points: FloatArray,
    chosen: IntArray,
    rotations: FloatArray,
    translations: FloatArray,
) -> int:
    """Write the poses {R, t} = reference_T_camera, (4, 3, 3) and (4, 3); return how many there are.

    ``bearings`` (n, 3) unit, ``points`` (n, 3) [m], ``chosen`` (3,) rows of both.
    """
    b, h = np.empty((3, 3)), np.empty((3, 3))
    for i in range(3):
        for k in range(3):
            b[i, k] = bearings[chosen[i], k]
            h[i, k] = points[chosen[i], k]
    side, cosine = np.zeros(3), np.zeros(3)  # of the pairs 12, 13, 23
    for pair in range(3):
        i, k = (0, 1 + pair) if pair < 2 else (1, 2)
        for m in range(3):
            side[pair] += (h[i, m] - h[k, m]) ** 2
            cosine[pair] += b[i, m] * b[k, m]
    a12, a13, a23 = side[0], side[1], side[2]
    c12, c13, c23 = cosine[0], cosine[1], cosine[2]
    area4 = 4.0 * a12 * a13 - (a12 + a13 - a23) ** 2  # (4 × area)² of the triangle
    if not area4 > 4.0 * LEAST_SINE * LEAST_SINE * max(a12, a13, a23) ** 2:
        return 0
    first, second = np.zeros((3, 3)), np.zeros((3, 3))
    _conics(a12 / a23, a13 / a23, c12, c13, c23, first, second)
    lines = np.empty((2, 3))
    if not _degenerate_member(first, second, lines):
        return 0
    count = 0
    distances = np.empty(3)
    directions = np.empty((2, 3))
    for line in range(2):
        for k in range(_line_meets_conic(lines[line], first, directions)):
            if _scaled(directions[k], a12, a13, a23, c12, c13, c23, distances) and _polished(
                a12, a13, a23, c12, c13, c23, distances
            ):
                _align(b, distances, h, rotations[count], translations[count])
                count += 1
    return count


@leaf
def _conics(
    a12: float, a13: float, c12: float, c13: float, c23: float, first: FloatArray, second: FloatArray
) -> None:
    """Write the forms of M₁₂ − a₁₂M₂₃ and M₁₃ − a₁₃M₂₃ with a₂₃ = 1, both zero at λ."""
    first[0, 0], first[1, 1], first[2, 2] = 1.0, 1.0 - a12, -a12
    first[0, 1] = first[1, 0] = -c12
    first[1, 2] = first[2, 1] = a12 * c23
    second[0, 0], second[1, 1], second[2, 2] = 1.0, -a13, 1.0 - a13
    second[0, 2] = second[2, 0] = -c13
    second[1, 2] = second[2, 1] = a13 * c23


@leaf
def _determinant(m: FloatArray) -> float:
    """Return det of a symmetric 3×3 matrix."""
    value: float = (
        m[0, 0] * (m[1, 1] * m[2, 2] - m[1, 2] * m[1, 2])
        - m[0, 1] * (m[0, 1] * m[2, 2] - m[1, 2] * m[0, 2])
        + m[0, 2] * (m[0, 1] * m[1, 2] - m[1, 1] * m[0, 2])
    )
    return value


@leaf
def _mixed_determinant(m: FloatArray, n: FloatArray) -> float:
    """Return d det(m + γn)/dγ at γ = 0 for symmetric matrices: tr(adj(m) n)."""
    value: float = (
        (m[1, 1] * m[2, 2] - m[1, 2] * m[1, 2]) * n[0, 0]
        + (m[0, 0] * m[2, 2] - m[0, 2] * m[0, 2]) * n[1, 1]
        + (m[0, 0] * m[1, 1] - m[0, 1] * m[0, 1]) * n[2, 2]
        + 2.0 * (m[0, 2] * m[1, 2] - m[0, 1] * m[2, 2]) * n[0, 1]
        + 2.0 * (m[0, 1] * m[1, 2] - m[0, 2] * m[1, 1]) * n[0, 2]
        + 2.0 * (m[0, 1] * m[0, 2] - m[0, 0] * m[1, 2]) * n[1, 2]
    )
    return value


@kernel
def _degenerate_member(first: FloatArray, second: FloatArray, lines: FloatArray) -> bool:
    """Write the two lines (2, 3) of a singular member of the pencil; False where none has real lines."""
    roots = np.empty(3)
    count = _cubic_roots(
        _determinant(second),
        _mixed_determinant(second, first),
        _mixed_determinant(first, second),
        _determinant(first),
        roots,
    )
    member, best = np.empty((3, 3)), np.empty((3, 3))
    least = -1e-14
    for place in range(count):
        scale = 1.0 / (1.0 + abs(roots[place]))
        for i in range(3):
            for k in range(3):
                member[i, k] = scale * (first[i, k] + roots[place] * second[i, k])
        # One eigenvalue is 0, so this is the product of the others: negative where the lines are real.
        product = (
            member[0, 0] * member[1, 1]
            + member[0, 0] * member[2, 2]
            + member[1, 1] * member[2, 2]
            - (member[0, 1] ** 2 + member[0, 2] ** 2 + member[1, 2] ** 2)
        )
        if product < least:
            least = product
            member, best = best, member
    if not least < -1e-14:
        return False
    _split(best, lines)
    return True


@kernel
def _split(m: FloatArray, lines: FloatArray) -> None:
    """Write l and l' of the singular m = l l'ᵀ + l' lᵀ.

    adj m = −p pᵀ with p = l × l', and m + [p]× = 2 l l'ᵀ or 2 l' lᵀ (Richter-Gebert, Perspectives on
    Projective Geometry, 11.1): a row and a column of it are the lines.
    """
    p, rank_one = np.empty(3), np.empty((3, 3))
    widest, largest = 0, 0.0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        p[i] = m[j, k] * m[j, k] - m[j, j] * m[k, k]
        if p[i] > p[widest]:
            widest = i
    i, j, k = widest, (widest + 1) % 3, (widest + 2) % 3
    root = math.sqrt(p[i])
    p[i] = root
    p[j] = (m[i, j] * m[k, k] - m[j, k] * m[i, k]) / root
    p[k] = (m[i, k] * m[j, j] - m[i, j] * m[j, k]) / root
    row, column = 0, 0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        rank_one[i, i] = m[i, i]
        rank_one[i, j] = m[i, j] - p[k]
        rank_one[j, i] = m[i, j] + p[k]
    for i in range(3):
        for k in range(3):
            if abs(rank_one[i, k]) > largest:
                row, column, largest = i, k, abs(rank_one[i, k])
    for i in range(3):
        lines[0, i] = rank_one[row, i] / largest
        lines[1, i] = rank_one[i, column] / largest


@leaf
def _cubic_roots(a: float, b: float, c: float, d: float, roots: FloatArray) -> int:
    """Write the real roots of aγ³ + bγ² + cγ + d, polished by Newton's method; return how many."""
    if abs(a) < 1e-14 * (abs(b) + abs(c) + abs(d)):
        return _quadratic_roots(b, 0.5 * c, d, roots)
    b, c, d = b / a, c / a, d / a
    shift = b / 3.0
    p = c / 3.0 - shift * shift
    q = shift * shift * shift - 0.5 * shift * c + 0.5 * d
    discriminant = q * q + p * p * p
    if discriminant > 0.0:
        u = math.sqrt(discriminant) + abs(q)
        u = math.copysign(u ** (1.0 / 3.0), -q)
        roots[0] = u - (p / u if u != 0.0 else 0.0) - shift
        count = 1
    else:
        radius = math.sqrt(-p)
        angle = math.acos(max(-1.0, min(1.0, -q / (radius * radius * radius)))) if radius > 0.0 else 0.0
        for k in range(3):
            roots[k] = 2.0 * radius * math.cos((angle + 2.0 * math.pi * k) / 3.0) - shift
        count = 3
    for k in range(count):
        for _ in range(2):
            x = roots[k]
            slope = (3.0 * x + 2.0 * b) * x + c
            if slope != 0.0:
                step = (((x + b) * x + c) * x + d) / slope
                if abs(step) < 1e-3 * (1.0 + abs(x)):
                    roots[k] = x - step
    return count


@leaf
def _quadratic_roots(a: float, half_b: float, c: float, roots: FloatArray) -> int:
    """Write the real roots of ax² + 2·half_b·x + c; return how many."""
    discriminant = half_b * half_b - a * c
    if not discriminant >= 0.0:
        return 0
    q = -(half_b + math.copysign(math.sqrt(discriminant), half_b))
    count = 0
    if a != 0.0:
        roots[0] = q / a
        count = 1
    if q != 0.0:
        roots[count] = c / q
        count += 1
    return count


@kernel
def _line_meets_conic(line: FloatArray, conic: FloatArray, directions: FloatArray) -> int:
    """Write the directions λ (2, 3) with line·λ = 0 and λᵀ conic λ = 0; return how many are real."""
    p, q = np.zeros(3), np.empty(3)
    small = 0
    for i in range(1, 3):
        if abs(line[i]) < abs(line[small]):
            small = i
    i, k = (small + 1) % 3, (small + 2) % 3
    norm = math.sqrt(line[i] ** 2 + line[k] ** 2)
    p[i], p[k] = line[k] / norm, -line[i] / norm
    for m in range(3):
        q[m] = line[(m + 1) % 3] * p[(m + 2) % 3] - line[(m + 2) % 3] * p[(m + 1) % 3]
    length = math.sqrt(q[0] ** 2 + q[1] ** 2 + q[2] ** 2)
    pp, pq, qq = 0.0, 0.0, 0.0
    for m in range(3):
        q[m] /= length
    for m in range(3):
        for n in range(3):
            pp += p[m] * conic[m, n] * p[n]
            pq += p[m] * conic[m, n] * q[n]
            qq += q[m] * conic[m, n] * q[n]
    discriminant = pq * pq - pp * qq
    if discriminant < -NEARLY_DOUBLE * (pq * pq + abs(pp * qq)):
        return 0
    # (x, y) of λ = xp + yq: (s, pp) and (qq, s), homogeneous, so that neither end is singular
    s = -(pq + math.copysign(math.sqrt(max(discriminant, 0.0)), pq))
    for m in range(3):
        directions[0, m] = s * p[m] + pp * q[m]
        directions[1, m] = qq * p[m] + s * q[m]
    return 2


@leaf
def _scaled(
    direction: FloatArray,
    a12: float,
    a13: float,
    a23: float,
    c12: float,
    c13: float,
    c23: float,
    distances: FloatArray,
) -> bool:
    """Write the distances along a direction of λ; False where they are not all positive."""
    x, y, z = direction[0], direction[1], direction[2]
    if x + y + z < 0.0:
        x, y, z = -x, -y, -z
    if not (x > 0.0 and y > 0.0 and z > 0.0):
        return False
    form = 2.0 * (x * x + y * y + z * z - c12 * x * y - c13 * x * z - c23 * y * z)
    if not form > 0.0:
        return False
    scale = math.sqrt((a12 + a13 + a23) / form)
    distances[0], distances[1], distances[2] = scale * x, scale * y, scale * z
    return True


@leaf
def _polished(
    a12: float, a13: float, a23: float, c12: float, c13: float, c23: float, distances: FloatArray
) -> bool:
    """Improve the distances by Newton's method on the three sides; False where one is not positive then."""
    x, y, z = distances[0], distances[1], distances[2]
    for _ in range(POLISHING_STEPS):
        r1 = x * x + y * y - 2.0 * c12 * x * y - a12
        r2 = x * x + z * z - 2.0 * c13 * x * z - a13
        r3 = y * y + z * z - 2.0 * c23 * y * z - a23
        if abs(r1) + abs(r2) + abs(r3) < 1e-15 * (a12 + a13 + a23):
            break
        j11, j12 = x - c12 * y, y - c12 * x
        j21, j23 = x - c13 * z, z - c13 * x
        j32, j33 = y - c23 * z, z - c23 * y
        determinant = -2.0 * (j11 * j23 * j32 + j12 * j21 * j33)
        # Where two solutions are nearly one, Newton's step is no guide.
        if not abs(determinant) > 1e-9 * x * y * z:
            break
        sx = (-j23 * j32 * r1 - j12 * j33 * r2 + j12 * j23 * r3) / determinant
        sy = (-j21 * j33 * r1 + j11 * j33 * r2 - j11 * j23 * r3) / determinant
        sz = (j21 * j32 * r1 - j11 * j32 * r2 - j12 * j21 * r3) / determinant
        if not abs(sx) + abs(sy) + abs(sz) < 0.1 * (x + y + z):
            break
        x, y, z = x - sx, y - sy, z - sz
    distances[0], distances[1], distances[2] = x, y, z
    return bool(x > 0.0 and y > 0.0 and z > 0.0)


@kernel
def _align(
    b: FloatArray, distances: FloatArray, h: FloatArray, rotation: FloatArray, translation: FloatArray
) -> None:
    """Write the pose that maps the triangle λᵢbᵢ onto the triangle hᵢ, middle on middle."""
    c, seen, known = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for i in range(3):
        for k in range(3):
            c[i, k] = distances[i] * b[i, k]
    _axes(c, seen)
    _axes(h, known)
    for i in range(3):
        for k in range(3):
            rotation[i, k] = known[0, i] * seen[0, k] + known[1, i] * seen[1, k] + known[2, i] * seen[2, k]
    for i in range(3):
        translation[i] = (h[0, i] + h[1, i] + h[2, i]) / 3.0
        for k in range(3):
            translation[i] -= rotation[i, k] * (c[0, k] + c[1, k] + c[2, k]) / 3.0


@leaf
def _axes(corners: FloatArray, axes: FloatArray) -> None:
    """Write a triangle's orthonormal axes, one a row: along its first side, across, and its normal."""
    for k in range(3):
        axes[0, k] = corners[1, k] - corners[0, k]
        axes[1, k] = corners[2, k] - corners[0, k]
    for turn in range(2):  # the normal of both sides, then the second axis
        i, k, target = (0, 1, 2) if turn == 0 else (2, 0, 1)
        x = axes[i, 1] * axes[k, 2] - axes[i, 2] * axes[k, 1]
        y = axes[i, 2] * axes[k, 0] - axes[i, 0] * axes[k, 2]
        z = axes[i, 0] * axes[k, 1] - axes[i, 1] * axes[k, 0]
        norm = math.sqrt(x * x + y * y + z * z)
        axes[target, 0], axes[target, 1], axes[target, 2] = x / norm, y / norm, z / norm
    norm = math.sqrt(axes[0, 0] ** 2 + axes[0, 1] ** 2 + axes[0, 2] ** 2)
    for k in range(3):
        axes[0, k] /= norm
