"""The domain of the unified model itself, before any lens or distortion narrows it."""

from __future__ import annotations

import math


def model_domain(xi: float) -> tuple[float, float]:
    """Return the least Z/ρ that can be projected (exclusive) and the largest r² that can be unprojected.

    ξ ≤ 1: (−ξ, ∞); ξ > 1: (−1/ξ, 1/(ξ²−1)).
    """
    return (-xi, math.inf) if xi <= 1.0 else (-1.0 / xi, 1.0 / ((xi - 1.0) * (xi + 1.0)))


def cosine_of_radius(xi: float, radius: float) -> float:
    """Return Z/ρ of the bearings that reach the finite radius r = ‖m‖: (ξ + √(1 + (1−ξ²)r²))/(1 + r²) − ξ."""
    r2 = radius * radius
    return (xi + math.sqrt(max(0.0, 1.0 + (1.0 - xi) * (1.0 + xi) * r2))) / (1.0 + r2) - xi


def radius_of_angle(xi: float, angle: float) -> float:
    """Return r = ‖m‖ of bearings at ``angle`` from the axis [rad]; at and past the domain's end, its rim."""
    cosine, r2 = model_domain(xi)
    if math.cos(angle) <= cosine:
        return math.sqrt(r2)
    return math.sin(angle) / (math.cos(angle) + xi)
