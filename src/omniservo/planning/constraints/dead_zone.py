"""Dead zone: the image stays outside a disc in pixels, ‖p − p₀‖ ≥ r.

With D = Z + ξρ > 0 the pixel is p − p₀ = (fx X + s Y + (cu − u₀) D, fy Y + (cv − v₀) D)/D. A point outside
the disc is cut off from it by a tangent of the disc: e·(p − p₀) ≥ r for one unit vector e. That is an image
line, so a cone n·c ≤ κρ, degree 2σ + τ; which tangent may change from piece to piece of the path.
"""

import math

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel, leaf

FX, SKEW, FY, U, V, RADIUS, XI = range(7)
"""The places of `Constraints.disc`: of K, of cu − u₀ and cv − v₀, of r [px], of ξ."""

Limit = tuple[float, float, float, float]
"""n and κ of n·c ≤ κ‖c‖"""


@leaf
def offset_from_disc(disc: FloatArray, x: float, y: float, z: float) -> tuple[float, float]:
    """Return p − p₀ [px] of a camera point with D > 0; (0, 0) where D ≤ 0."""
    d = z + disc[XI] * math.sqrt(x * x + y * y + z * z)
    if not d > 0.0:
        return 0.0, 0.0
    return (disc[FX] * x + disc[SKEW] * y) / d + disc[U], disc[FY] * y / d + disc[V]


@kernel
def tangent_limit(disc: FloatArray, x: float, y: float, z: float) -> Limit:
    """Return the image limit whose line touches the disc on the side of the camera point (x, y, z).

    The limit implies ‖p − p₀‖ ≥ r exactly: e is shortened so that ‖e‖ ≤ 1 in spite of rounding.
    """
    u, v = offset_from_disc(disc, x, y, z)
    length = math.hypot(u, v)
    eu, ev = (u / length, v / length) if length > 0.0 else (1.0, 0.0)
    eu, ev = eu * (1.0 - 1e-15), ev * (1.0 - 1e-15)
    third = eu * disc[U] + ev * disc[V] - disc[RADIUS]
    return -eu * disc[FX], -(eu * disc[SKEW] + ev * disc[FY]), -third, disc[XI] * third


@leaf
def disc_size(disc: FloatArray) -> float:
    """Return a bound on |n|₁ + 3|κ| of every tangent limit, for the error bound."""
    third = abs(disc[U]) + abs(disc[V]) + disc[RADIUS]
    return float(abs(disc[FX]) + abs(disc[SKEW]) + abs(disc[FY]) + third * (1.0 + 3.0 * disc[XI]))


@leaf
def disc_margin(disc: FloatArray, x: float, y: float, z: float) -> float:
    """Return ‖p − p₀‖ − r [px] of a camera point; −∞ where D ≤ 0."""
    d = z + disc[XI] * math.sqrt(x * x + y * y + z * z)
    if not d > 0.0:
        return -np.inf
    u, v = offset_from_disc(disc, x, y, z)
    return float(math.hypot(u, v) - disc[RADIUS])
