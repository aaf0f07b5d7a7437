"""How far a segment is from a cylinder or an ellipsoid, and how deep inside it.

The signed distance f of a point to a convex body (‖x − nearest point‖ outside, minus a depth inside) is
convex, so the nearest part of a segment p + s d is where the slope f'(s) = n·d changes its sign, n the unit
gradient. Coordinates are those of the body's own axes: the cylinder |x| ≤ e₁, y² + z² ≤ e₂², the ellipsoid
Σ (x_k/e_k)² ≤ 1.
"""

import math

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel, leaf
from omniservo.planning.constraints.body_gap import CYLINDER, EXTENT, SHAPE, in_body_frame, out_of_body_frame

_MOST_STEPS = 60
"""of a search; both searches end long before."""

_SAFE_SIDE = 1e-13
"""Gaps are stated more by this part of the sizes: the nearest point is rounded."""

Vector = tuple[float, float, float]
Gap = tuple[float, float, float, float]
"""unit gradient, signed distance"""


@leaf
def cylinder_distance(e: Vector, x: float, y: float, z: float) -> Gap:
    """Return the unit gradient and the signed distance of (x, y, z) to a cylinder, exact but for rounding."""
    rho = math.sqrt(y * y + z * z)
    u, v = (y / rho, z / rho) if rho > 0.0 else (1.0, 0.0)
    side = 1.0 if x >= 0.0 else -1.0
    beyond, outward = abs(x) - e[0], rho - e[1]
    if max(beyond, outward) <= 0.0:
        return (side, 0.0, 0.0, beyond) if beyond > outward else (0.0, u, v, outward)
    beyond, outward = max(beyond, 0.0), max(outward, 0.0)
    distance = math.sqrt(beyond * beyond + outward * outward)
    part = outward / distance
    return side * beyond / distance, part * u, part * v, distance


@kernel
def ellipsoid_distance(e: Vector, x: float, y: float, z: float) -> Gap:
    """Return the unit gradient and the signed distance of (x, y, z) to an ellipsoid.

    The nearest point of the surface is y_k = e_k² x_k/(t + e_k²) with Σ (e_k x_k/(t + e_k²))² = 1. The sum is
    convex and falls with t ≥ 0: Newton's method from its left climbs to the root (D. Eberly, Distance from a
    point to an ellipse, an ellipsoid, or a hyperellipsoid, 2013). Inside, with ρ = ‖(x_k/e_k)‖, the depth is
    at least (1 − ρ) min e_k, which is what is stated.
    """
    p = x, y, z
    rho = math.sqrt((x / e[0]) ** 2 + (y / e[1]) ** 2 + (z / e[2]) ** 2)
    t, depth = 0.0, 0.0
    if rho > 1.0:
        for k in range(3):
            t = max(t, e[k] * abs(p[k]) - e[k] * e[k])
        for _ in range(_MOST_STEPS):
            value, slope = -1.0, 0.0
            for k in range(3):
                q = e[k] * p[k] / (t + e[k] * e[k])
                value += q * q
                slope += 2.0 * q * q / (t + e[k] * e[k])
            step = value / slope
            if not step > 1e-16 * t:
                break
            t += step
    else:
        depth = (1.0 - rho) * min(e[0], e[1], e[2])
    gx, gy, gz = x / (t + e[0] * e[0]), y / (t + e[1] * e[1]), z / (t + e[2] * e[2])
    length = math.sqrt(gx * gx + gy * gy + gz * gz)
    if length == 0.0:  # in the middle every direction is as good
        return 1.0, 0.0, 0.0, -depth
    return gx / length, gy / length, gz / length, t * length - depth


@leaf
def round_distance(shape: float, e: Vector, x: float, y: float, z: float) -> Gap:
    """Return the unit gradient and the signed distance of (x, y, z) to a body of this shape."""
    if shape == CYLINDER:
        return cylinder_distance(e, x, y, z)
    return ellipsoid_distance(e, x, y, z)


@leaf
def slope_at(shape: float, e: Vector, p: Vector, d: Vector, s: float) -> float:
    """Return the derivative of the signed distance of p + s d at s."""
    x, y, z, _ = round_distance(shape, e, p[0] + s * d[0], p[1] + s * d[1], p[2] + s * d[2])
    return float(x * d[0] + y * d[1] + z * d[2])


@kernel
def nearest_round_part(shape: float, e: Vector, p: Vector, d: Vector) -> float:
    """Return the s in [0, 1] at which p + s d is nearest to the body, or deepest in it.

    Between low and high the slope is first < 0, then > 0; a secant that stays on one side halves the other
    side's slope (Illinois). The signed distance at low is above its minimum by at most −slope · width.
    """
    if d[0] == 0.0 and d[1] == 0.0 and d[2] == 0.0:
        return 0.0
    low, high = 0.0, 1.0
    before, after = slope_at(shape, e, p, d, 0.0), slope_at(shape, e, p, d, 1.0)
    if before >= 0.0:
        return 0.0
    if after <= 0.0:
        return 1.0
    falling, rising, kept = before, after, 0
    enough = 0.1 * _SAFE_SIDE * (e[0] + e[1] + e[2])
    for step in range(_MOST_STEPS):
        s = (low * rising - high * falling) / (rising - falling)
        if step % 4 == 3 or not low < s < high:
            s = 0.5 * (low + high)
        slope = slope_at(shape, e, p, d, s)
        if slope < 0.0:
            low, before, falling = s, slope, slope
            rising = 0.5 * rising if kept < 0 else after
            kept = -1
        else:
            high, after, rising = s, slope, slope
            falling = 0.5 * falling if kept > 0 else before
            kept = 1
        if min(-before, after) * (high - low) <= enough:
            break
    return low if -before < after else high


@leaf
def round_gap(
    body: FloatArray, tx: float, ty: float, tz: float, hx: float, hy: float, hz: float
) -> tuple[float, float, float, float, float]:
    """Return (unit direction n, gap, s) from a cylinder or an ellipsoid to the segment from t to h.

    The gap is their distance, never less than the true one, or negative a depth that the segment's deepest
    point has, never more than the true one; t + s(h − t) is nearest, or deepest.
    """
    p = in_body_frame(body, tx - body[0], ty - body[1], tz - body[2])
    d = in_body_frame(body, hx - tx, hy - ty, hz - tz)
    e = float(body[EXTENT]), float(body[EXTENT + 1]), float(body[EXTENT + 2])
    s = nearest_round_part(body[SHAPE], e, p, d)
    x, y, z, gap = round_distance(body[SHAPE], e, p[0] + s * d[0], p[1] + s * d[1], p[2] + s * d[2])
    size = abs(p[0]) + abs(p[1]) + abs(p[2]) + abs(d[0]) + abs(d[1]) + abs(d[2]) + e[0] + e[1] + e[2]
    nx, ny, nz = out_of_body_frame(body, x, y, z)
    return nx, ny, nz, gap + _SAFE_SIDE * size, s


@leaf
def round_support(body: FloatArray, a: float, b: float, c: float) -> float:
    """Return the greatest n·x over a cylinder or an ellipsoid, n = (a, b, c) along the body's axes."""
    e, f, g = body[EXTENT], body[EXTENT + 1], body[EXTENT + 2]
    if body[SHAPE] == CYLINDER:
        return float(e * abs(a) + f * math.sqrt(b * b + c * c))
    return math.sqrt(e * a * e * a + f * b * f * b + g * c * g * c)
