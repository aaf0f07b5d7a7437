"""Kannala–Brandt and OCam, one point at a time: radial functions that are inverted by Newton's method.

The inverse starts from a table and stays in the table's interval, which holds the one root because the
function grows over the whole domain; two or three steps reach the last digit.

Every function takes a lens's ``parameters``; `plane_kernels` names the places that all models share.
"""

import math

import numpy as np

from omniservo.cameras.models.arc_tangent import arc_tangent
from omniservo.cameras.models.block_kernels import (
    project_blocks,
    read_points,
    unproject_each,
    write_pixels,
)
from omniservo.cameras.models.plane_kernels import OWN
from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.geometry.kernel import BLOCK, inlined, kernel, leaf

TABLE = 256
"""intervals"""

PER_STEP = OWN + 1
"""the place of 1/step of the table"""

LARGEST_THETA, K1, K2, K3, K4 = OWN, *range(OWN + 2, OWN + 6)
"""the places of Kannala–Brandt's other numbers [rad]"""

THETAS = K4 + 1
"""where its table starts: θ at equal steps of r, then dθ per step"""

SINES = THETAS + 2 * (TABLE + 1)
"""where the sines of its θ start; their cosines follow"""

COUNT, COEFFICIENTS = OWN, OWN + 5
"""where OCam's count of coefficients stands, and where they start; behind them its table: ρ at equal steps of
sin θ/2, then dρ per step"""

_STEPS = 60
_ROUNDING = 4e-16
_CLOSE = 1e-9
_NEAR = 0.02


@inlined
def table_value(p: FloatArray, start: int, place: float) -> tuple[float, float, float]:
    """Return a table's cubic Hermite interpolation at ``place`` (in steps), and its interval's two ends.

    The values stand from ``start`` on, their slopes per step behind them.
    """
    i = min(int(place), TABLE - 1)
    t = place - i
    low, high = p[start + i], p[start + i + 1]
    a, b = p[start + TABLE + 1 + i] - (high - low), (high - low) - p[start + TABLE + 2 + i]
    value = low + t * (high - low) + t * (1.0 - t) * ((1.0 - t) * a + t * b)
    return min(max(value, low), high), low, high


@inlined
def _angle_of_radius(p: FloatArray, r: float, theta: float, low: float, high: float) -> float:
    """Return θ with r(θ) = r, from a start and an interval that holds it: Newton's method, else halving."""
    k1, k2, k3, k4 = p[K1], p[K2], p[K3], p[K4]
    for _ in range(_STEPS):
        t = theta * theta
        error = r - theta * (1.0 + t * (k1 + t * (k2 + t * (k3 + t * k4))))
        slope = 1.0 + t * (3.0 * k1 + t * (5.0 * k2 + t * (7.0 * k3 + t * 9.0 * k4)))
        step = error / slope
        if abs(step) <= _CLOSE * theta:  # the next step would be below the rounding
            return float(theta + step)
        if error > 0.0:
            low = theta
        else:
            high = theta
        if not low <= theta + step <= high:
            step = 0.5 * (low + high) - theta
        theta += step
    return theta


@leaf
def _kannala_brandt_bearing(p: FloatArray, mx: float, my: float) -> tuple[float, float, float, bool]:
    """Return the bearing of a point of the plane in the domain: r(θ) = ‖m‖ solved for θ."""
    r = math.sqrt(mx * mx + my * my)
    theta, low, high = table_value(p, THETAS, r * p[PER_STEP])
    theta = min(_angle_of_radius(p, r, theta, low, high), p[LARGEST_THETA])
    delta = theta - low
    if delta < _NEAR:  # sine and cosine from the table's: twice as fast as calling them
        i, t = SINES + min(int(r * p[PER_STEP]), TABLE - 1), delta * delta
        s = delta * (1.0 - t / 6.0 * (1.0 - t / 20.0 * (1.0 - t / 42.0)))
        c = 1.0 - 0.5 * t * (1.0 - t / 12.0 * (1.0 - t / 30.0))
        sine, cosine = p[i] * c + p[i + TABLE + 1] * s, p[i + TABLE + 1] * c - p[i] * s
    else:
        sine, cosine = math.sin(theta), math.cos(theta)
    scale = sine / r if r > 0.0 else 1.0
    return scale * mx, scale * my, cosine, True


@leaf
def _radius_of_angle(p: FloatArray, side: float, z: float, radius: float) -> float:
    """Return ρ with z ρ + f(ρ) ‖(X, Y)‖ = 0, from a start: Newton's method, else halving."""
    count = int(p[COUNT])
    low, high = 0.0, p[COEFFICIENTS + count + TABLE] * (1.0 + _ROUNDING)
    for _ in range(_STEPS):
        value, slope = p[COEFFICIENTS + count - 1], 0.0
        for k in range(count - 2, -1, -1):
            slope = slope * radius + value
            value = value * radius + p[COEFFICIENTS + k]
        error = -(radius * z + value * side)
        step = error / (z + slope * side)
        if abs(step) <= _CLOSE * radius:
            return float(min(radius + step, high))
        if error > 0.0:
            low = radius
        else:
            high = radius
        if not low <= radius + step <= high:
            step = 0.5 * (low + high) - radius
        radius += step
    return radius


@leaf
def _start(p: FloatArray, side: float, z: float) -> float:
    """Return ρ of a point from the table."""
    half = math.sqrt(
        max(0.0, 0.5 * (1.0 - z / math.sqrt(side * side + z * z)))
    )  # exact enough, at the axis too
    return table_value(p, COEFFICIENTS + int(p[COUNT]), half * p[PER_STEP])[0]


@leaf
def _newton_steps(
    p: FloatArray, side: FloatArray, z: FloatArray, radius: FloatArray, value: FloatArray, slope: FloatArray
) -> None:
    """Take two Newton steps from the ``radius`` of each point; leave the last step in ``value``."""
    count = int(p[COUNT])
    for _ in range(2):
        value[:], slope[:] = p[COEFFICIENTS + count - 1], 0.0
        for k in range(count - 2, -1, -1):
            a = p[COEFFICIENTS + k]
            for i in range(radius.shape[0]):
                slope[i] = slope[i] * radius[i] + value[i]
                value[i] = value[i] * radius[i] + a
        for i in range(radius.shape[0]):
            value[i] = -(radius[i] * z[i] + value[i] * side[i]) / (z[i] + slope[i] * side[i])
            radius[i] += value[i]


@leaf
def _ocam_plane(
    p: FloatArray, x: FloatArray, y: FloatArray, z: FloatArray, work: tuple[FloatArray, ...]
) -> None:
    """Replace points by (x, y) [px] of the sensor with (x, y, −f(‖(x, y)‖)) along them.

    That is z ρ + f(ρ) ‖(X, Y)‖ = 0. x is NaN straight behind.
    """
    side, radius, value, slope = work
    high = p[COEFFICIENTS + int(p[COUNT]) + TABLE]
    for i in range(x.shape[0]):
        side[i] = math.sqrt(x[i] * x[i] + y[i] * y[i])
        radius[i] = _start(p, side[i], z[i]) if side[i] > 0.0 else 0.0
    _newton_steps(p, side, z, radius, value, slope)
    for i in range(x.shape[0]):
        sure = (abs(value[i]) <= _CLOSE * radius[i]) & (radius[i] >= 0.0) & (radius[i] <= high)
        if not sure and side[i] > 0.0:
            radius[i] = _radius_of_angle(p, side[i], z[i], _start(p, side[i], z[i]))
    for i in range(x.shape[0]):
        scale = radius[i] / side[i] if side[i] > 0.0 else 1.0
        x[i], y[i] = scale * x[i] if (side[i] > 0.0) | (z[i] > 0.0) else math.nan, scale * y[i]


@leaf
def _ocam_bearing(p: FloatArray, mx: float, my: float) -> tuple[float, float, float, bool]:
    """Return the unit vector along (x, y, −f(ρ)), f(ρ) = a0 + a1 ρ + a2 ρ² + …."""
    radius = math.sqrt(mx * mx + my * my)
    value = 0.0
    for k in range(int(p[COUNT]) - 1, -1, -1):
        value = value * radius + p[COEFFICIENTS + k]
    scale = 1.0 / math.sqrt(radius * radius + value * value)
    return scale * mx, scale * my, -scale * value, True


@leaf
def _kannala_brandt_plane(p: FloatArray, x: FloatArray, y: FloatArray, z: FloatArray) -> None:
    """Replace points by m = r(θ) (X, Y)/‖(X, Y)‖ with r = θ(1 + k1θ² + k2θ⁴ + k3θ⁶ + k4θ⁸).

    x is NaN straight behind.
    """
    for i in range(x.shape[0]):
        side = math.sqrt(x[i] * x[i] + y[i] * y[i])
        theta = arc_tangent(side, z[i])
        t = theta * theta
        scale = theta * (1.0 + t * (p[K1] + t * (p[K2] + t * (p[K3] + t * p[K4]))))
        scale = scale / (side if side > 0.0 else 1.0)
        x[i], y[i] = scale * x[i] if (side > 0.0) | (z[i] > 0.0) else math.nan, scale * y[i]


@kernel
def project_kannala_brandt(p: FloatArray, points: FloatArray, pixels: FloatArray, valid: BoolArray) -> None:
    """Project each row of ``points`` (n, 3) into ``pixels`` (n, 2) and ``valid`` (n,)."""
    project_blocks(_kannala_brandt_plane, p, points, pixels, valid)


@leaf
def unproject_kannala_brandt(
    p: FloatArray, pixels: FloatArray, bearings: FloatArray, valid: BoolArray
) -> None:
    """Unproject each row of ``pixels`` (n, 2) into ``bearings`` (n, 3) and ``valid`` (n,)."""
    unproject_each(_kannala_brandt_bearing, p, pixels, bearings, valid)


@kernel
def project_ocam(p: FloatArray, points: FloatArray, pixels: FloatArray, valid: BoolArray) -> None:
    """Project each row of ``points`` (n, 3) into ``pixels`` (n, 2) and ``valid`` (n,)."""
    block_x, block_y, block_z = np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK)
    side, radius, value, slope = np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK)
    for start in range(0, points.shape[0], BLOCK):
        stop = min(start + BLOCK, points.shape[0])
        n = stop - start
        x, y, z = block_x[:n], block_y[:n], block_z[:n]
        read_points(p, points[start:stop], x, y, z)
        _ocam_plane(p, x, y, z, (side[:n], radius[:n], value[:n], slope[:n]))
        write_pixels(p, x, y, pixels[start:stop], valid[start:stop])


@leaf
def unproject_ocam(p: FloatArray, pixels: FloatArray, bearings: FloatArray, valid: BoolArray) -> None:
    """Unproject each row of ``pixels`` (n, 2) into ``bearings`` (n, 3) and ``valid`` (n,)."""
    unproject_each(_ocam_bearing, p, pixels, bearings, valid)
