"""Which joint configurations lie on which side of an arm's singularities."""

from __future__ import annotations

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.robots.arm import Arm
from omniservo.robots.kinematics.chain import carry

SINGULARITIES = ("shoulder", "elbow", "wrist")
"""What the factors of det J belong to, where there are three; the order of `aspects_of`"""


def aspects_of(arm: Arm, q: FloatArray) -> FloatArray:
    """Return the signs of the factors of det J in regular configurations (k, n) [rad]: their aspects (k, m).

    No motion leads from one aspect to another (Borrel and Liégeois, 1986) but through a singularity, where
    det J is 0. Of an arm with a closed form axes 2 and 3 are parallel, and the last two meet in W; axis 4 is
    parallel to them, too, or also meets W. With aᵢ a point of axis i along xᵢ, of axis 4 that nearest to
    axis 5, det J is but for its sign the product of (W − a₁)·(x₁ × x₂), of x₂·((a₃ − a₂) × (a₄ − a₃)), and of
    x₄·(x₅ × x₆): take the moments about W. Six other joints have one sign, seven none.
    """
    if arm.dof != 6:
        return np.empty((len(q), 0))
    if arm.has_closed_form:
        return np.sign(determinant_factors(arm, q))
    return np.array([[np.sign(np.linalg.det(arm.flange_jacobian(one)))] for one in q])


def determinant_factors(arm: Arm, q: FloatArray) -> FloatArray:
    """Return the three factors (k, 3) of det J of an arm with a closed form, see `aspects_of`."""
    chain, frames = arm.chain, np.empty((len(q), 7, 3, 4))
    for one, moved in zip(np.ascontiguousarray(q), frames, strict=True):
        carry(chain, one, moved)
    turns, shifts = frames[:, :-1, :, :3], frames[:, :-1, :, 3]
    x = np.einsum("kijc,ic->ikj", turns, chain.axes)
    a = np.einsum("kijc,ic->ikj", turns, chain.anchors) + shifts.transpose(1, 0, 2)
    centre, fourth = _nearest(a[4], x[4], a[5], x[5]), _nearest(a[3], x[3], a[4], x[4])
    return np.stack(
        [
            _triple(centre - a[0], x[0], x[1]),
            _triple(x[1], a[2] - a[1], fourth - a[2]),
            _triple(x[3], x[4], x[5]),
        ],
        axis=1,
    )


def _nearest(a: FloatArray, x: FloatArray, b: FloatArray, y: FloatArray) -> FloatArray:
    """Return the points (k, 3) of lines through ``a`` along ``x`` nearest to lines through ``b``."""
    across, apart = (x * y).sum(axis=1), b - a
    along = ((apart * x).sum(axis=1) - across * (apart * y).sum(axis=1)) / (1.0 - across**2)
    nearest: FloatArray = a + along[:, None] * x
    return nearest


def _triple(a: FloatArray, b: FloatArray, c: FloatArray) -> FloatArray:
    """Return a·(b × c), row by row."""
    product: FloatArray = (a * np.cross(b, c)).sum(axis=1)
    return product
