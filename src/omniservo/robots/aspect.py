"""Which joint configurations lie on which side of an arm's singularities."""

from __future__ import annotations

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.robots.arm import Arm
from omniservo.robots.kinematics.chain import carry

SINGULARITIES = ("shoulder", "elbow", "wrist")
"""What the factors of det J belong to, where there are three; the order of `aspect_of`"""


def aspect_of(arm: Arm, q: FloatArray) -> tuple[int, ...]:
    """Return the signs of the factors of det J in a regular configuration (n,) [rad]: its aspect.

    No motion leads from one aspect to another (Borrel and Liégeois, 1986) but through a singularity, where
    det J is 0. Of an arm with a closed form axes 2 and 3 are parallel, and the last two meet in W; axis 4 is
    parallel to them, too, or also meets W. With aᵢ a point of axis i along xᵢ, of axis 4 that nearest to
    axis 5, det J is but for its sign the product of (W − a₁)·(x₁ × x₂), of x₂·((a₃ − a₂) × (a₄ − a₃)), and of
    x₄·(x₅ × x₆): take the moments about W. Six other joints have one sign, seven none.
    """
    if arm.dof != 6:
        return ()
    if not arm.has_closed_form:
        return (int(np.sign(np.linalg.det(arm.flange_jacobian(q)))),)
    shoulder, elbow, wrist = determinant_factors(arm, q)
    return int(np.sign(shoulder)), int(np.sign(elbow)), int(np.sign(wrist))


def determinant_factors(arm: Arm, q: FloatArray) -> tuple[float, float, float]:
    """Return the three factors of det J of an arm with a closed form, see `aspect_of`."""
    chain, frames = arm.chain, np.empty((7, 3, 4))
    carry(chain, np.ascontiguousarray(q, dtype=np.float64), frames)
    moved = frames[:-1]
    x = np.einsum("ijk,ik->ij", moved[:, :, :3], chain.axes)
    a = np.einsum("ijk,ik->ij", moved[:, :, :3], chain.anchors) + moved[:, :, 3]
    centre = _nearest(a[4], x[4], a[5], x[5])
    fourth = _nearest(a[3], x[3], a[4], x[4])
    return (
        float((centre - a[0]) @ np.cross(x[0], x[1])),
        float(x[1] @ np.cross(a[2] - a[1], fourth - a[2])),
        float(x[3] @ np.cross(x[4], x[5])),
    )


def _nearest(a: FloatArray, x: FloatArray, b: FloatArray, y: FloatArray) -> FloatArray:
    """Return the point of the line through ``a`` along ``x`` that is nearest to the line through ``b``."""
    s, _ = np.linalg.lstsq(np.stack([x, -y], axis=1), b - a)[0]
    nearest: FloatArray = a + s * x
    return nearest
