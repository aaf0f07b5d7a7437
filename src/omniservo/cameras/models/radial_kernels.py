"""Kannala–Brandt and OCam, one point at a time: radial functions that are inverted by Newton's method.

The inverse starts from a table and stays in the table's interval, which holds the one root because the
function grows over the whole domain; two or three steps reach the last digit.

Every function takes a lens's ``parameters``; `lens_model` says what stands in the first 13, and its own are

| | Kannala–Brandt | OCam |
|---|---|---|
| 13 | largest θ | count of coefficients |
| 14 | 1/step of the table | 1/step of the table |
| 15 … 17 | k1, k2, k3 | – |
| from 18 on | k4, then θ at equal steps of r | the coefficients, then ρ at equal steps of sin θ/2 |
"""

import math

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel

TABLE = 256
"""intervals"""

OWN = 18
"""where the coefficients (OCam), or k4 and the table (Kannala–Brandt) start"""

_STEPS = 60
_ROUNDING = 4e-16


@kernel
def kannala_brandt_plane(p: FloatArray, x: float, y: float, z: float) -> tuple[float, float, bool]:
    """Return m = r(θ) (X, Y)/‖(X, Y)‖ with r = θ(1 + k1θ² + k2θ⁴ + k3θ⁶ + k4θ⁸)."""
    side = math.sqrt(x * x + y * y)
    if side == 0.0:
        return 0.0, 0.0, z > 0.0
    theta = math.atan2(side, z)
    t = theta * theta
    scale = theta * (1.0 + t * (p[15] + t * (p[16] + t * (p[17] + t * p[18])))) / side
    return scale * x, scale * y, True


@kernel
def kannala_brandt_bearing(p: FloatArray, mx: float, my: float) -> tuple[float, float, float, bool]:
    """Return the bearing of a point of the plane in the domain: r(θ) = ‖m‖ solved for θ."""
    r = math.sqrt(mx * mx + my * my)
    place = r * p[14]
    i = min(int(place), TABLE - 1)
    low, high = p[19 + i], p[20 + i]
    theta = low + (place - i) * (high - low)
    low, high = low * (1.0 - _ROUNDING), high * (1.0 + _ROUNDING)
    k1, k2, k3, k4 = p[15], p[16], p[17], p[18]
    for _ in range(_STEPS):
        t = theta * theta
        error = r - theta * (1.0 + t * (k1 + t * (k2 + t * (k3 + t * k4))))
        if error > 0.0:
            low = theta
        else:
            high = theta
        slope = 1.0 + t * (3.0 * k1 + t * (5.0 * k2 + t * (7.0 * k3 + t * 9.0 * k4)))
        step = error / slope
        if not low <= theta + step <= high:
            step = 0.5 * (low + high) - theta
        theta += step
        if abs(step) <= 1e-9 * theta:  # the next step would be below the rounding
            break
    theta = min(theta, p[13])
    scale = math.sin(theta) / r if r > 0.0 else 1.0
    return scale * mx, scale * my, math.cos(theta), True


@kernel
def ocam_plane(p: FloatArray, x: float, y: float, z: float, rho: float) -> tuple[float, float, bool]:
    """Return (x, y) [px] of the sensor with (x, y, −f(‖(x, y)‖)) along the point: zρ + f(ρ)‖(X, Y)‖ = 0."""
    side = math.sqrt(x * x + y * y)
    if side == 0.0:
        return 0.0, 0.0, z > 0.0
    sine, cosine = side / rho, z / rho
    half = math.sqrt(0.5 * (1.0 - cosine)) if z < 0.0 else sine / math.sqrt(2.0 * (1.0 + cosine))
    count, place = int(p[13]), half * p[14]
    i = min(int(place), TABLE - 1)
    start = OWN + count
    radius = p[start + i] + (place - i) * (p[start + i + 1] - p[start + i])
    low, high = p[start + max(i - 1, 0)], p[start + min(i + 2, TABLE)] * (1.0 + _ROUNDING)
    for _ in range(_STEPS):
        value, slope = p[OWN + count - 1], 0.0
        for k in range(count - 2, -1, -1):
            slope = slope * radius + value
            value = value * radius + p[OWN + k]
        error = -(radius * cosine + value * sine)
        if error > 0.0:
            low = radius
        else:
            high = radius
        derivative = cosine + slope * sine
        step = error / derivative if derivative != 0.0 else math.inf
        if not low <= radius + step <= high:
            step = 0.5 * (low + high) - radius
        radius += step
        if abs(step) <= 1e-9 * radius:
            break
    scale = radius / side
    return scale * x, scale * y, True


@kernel
def ocam_bearing(p: FloatArray, mx: float, my: float) -> tuple[float, float, float, bool]:
    """Return the unit vector along (x, y, −f(ρ)), f(ρ) = a0 + a1 ρ + a2 ρ² + …."""
    radius = math.sqrt(mx * mx + my * my)
    value = 0.0
    for k in range(int(p[13]) - 1, -1, -1):
        value = value * radius + p[OWN + k]
    scale = 1.0 / math.sqrt(radius * radius + value * value)
    return scale * mx, scale * my, -scale * value, True
