"""A configuration's Jacobian, compiled: how near a singularity is, what a motion asks of the joints."""

from __future__ import annotations

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.held import held
from omniservo.geometry.kernel import kernel
from omniservo.robots.kinematics.chain import LENGTH_SCALE, Chain, locate, turned
from omniservo.robots.path_following.step_kernels import singular_values

_DAMPED = 1e-3
"""Singular values below it are not inverted: what a camera motion asks of the joints stays bounded."""

_TINY = 1e-6
"""A singular value below it leaves no direction v = Jᵀu/σ."""


@kernel
def sensitivities(
    chain: Chain, to_camera: FloatArray, q: FloatArray, to_joints: FloatArray, slope: FloatArray
) -> float:
    """Return the smallest singular value σ of the camera's Jacobian J at the joints q (n,).

    Args:
        chain: of n joints.
        to_camera: (6, 6) camera twist from flange twist, metres over `LENGTH_SCALE`, in which σ is measured.
        q: (n,) [rad]
        to_joints: (n, 6) out: J⁺, the joints' least motion for the camera's (linear [m], angular), with
            singular values below 1e-3 taken for that.
        slope: (n,) out: ∂σ/∂q = uᵀ(∂J/∂q)v, by column ∂Jᵢ/∂qₖ = [Jᵢ, Jₖ] for i < k, else 0.
    """
    chain, n = held(chain), q.shape[0]
    flange_J, J = np.empty((6, n)), np.empty((6, n))
    locate(chain, q, LENGTH_SCALE, np.empty((3, 4)), flange_J)
    turned(to_camera, flange_J, J)
    sigma, left = singular_values(J)
    for j in range(n):
        for i in range(6):
            to_joints[j, i] = 0.0
        for k in range(6):
            along = 0.0
            for i in range(6):
                along += left[i, k] * J[i, j]
            along /= max(sigma[k], _TINY) * max(sigma[k], _DAMPED)
            for i in range(6):
                to_joints[j, i] += along * left[i, k]
        for i in range(3):
            to_joints[j, i] /= LENGTH_SCALE
    before = np.zeros(6)
    for j in range(n):
        u, v, w, a, b, c = before[0], before[1], before[2], before[3], before[4], before[5]
        x, y, z, d, e, f = J[0, j], J[1, j], J[2, j], J[3, j], J[4, j], J[5, j]
        slope[j] = (
            left[0, 0] * (b * z - c * y + v * f - w * e)
            + left[1, 0] * (c * x - a * z + w * d - u * f)
            + left[2, 0] * (a * y - b * x + u * e - v * d)
            + left[3, 0] * (b * f - c * e)
            + left[4, 0] * (c * d - a * f)
            + left[5, 0] * (a * e - b * d)
        )
        along = 0.0
        for i in range(6):
            along += left[i, 0] * J[i, j]
        for i in range(6):
            before[i] += along / max(sigma[0], _TINY) * J[i, j]
    return float(sigma[0])
