"""The control law (43): features' error and planned motion to a camera twist."""

import math

import numpy as np
import numpy.typing as npt

from omniservo.errors import InputError, SingularInteraction
from omniservo.geometry.arrays import FloatArray, finite_array, finite_number
from omniservo.geometry.kernel import kernel, leaf
from omniservo.geometry.linear_systems import factor_cholesky, solve_factored

LEAST_CONDITIONING = 1e-4
"""Below this conditioning (see :func:`solve_twist`) the features do not determine a twist.

Points on one line give 0 up to rounding (1e-8), a flat 3×3 grid that spans ±1.1° gives 1e-4, one that
spans ±11° gives 1e-2, the largest possible value is 0.24."""


def camera_twist(
    error: npt.ArrayLike, interaction: npt.ArrayLike, feed_forward: npt.ArrayLike | None, gain: float
) -> FloatArray:
    """Return the camera twist v = −λ₂ L⁺ (s − s_p) + L⁺ (∂s_p/∂w) ẇ of (43).

    Args:
        error: s − s_p, (n, k); k and the features' unit are the caller's.
        interaction: L, (n, k, 6): ds/dt = L · twist.
        feed_forward: (∂s_p/∂w) ẇ, (n, k) [1/s]; None: the reference stands still.
        gain: λ₂ [1/s].

    Returns:
        (6,): linear [m/s] and angular [rad/s], of the camera, in the camera frame.

    Raises:
        SingularInteraction: L does not determine a twist (conditioning below LEAST_CONDITIONING).
        InputError: shapes that do not fit, a number that is not finite, or a negative gain.
    """
    e = finite_array("error", error, (None, None))
    rows = finite_array("interaction", interaction, (*e.shape, 6)).reshape(-1, 6)
    flow = np.zeros_like(e) if feed_forward is None else finite_array("feed_forward", feed_forward, e.shape)
    rate = finite_number("gain", gain, minimum=0.0)
    twist = np.empty(6)
    conditioning = solve_twist(
        np.ascontiguousarray(rows), np.ascontiguousarray((flow - rate * e).ravel()), twist
    )
    if conditioning < LEAST_CONDITIONING:
        raise SingularInteraction(singular_message(len(e), conditioning))
    return twist


def singular_message(count: int, conditioning: float) -> str:
    """Return the sentence that a SingularInteraction carries."""
    return (
        f"{count} features do not determine a camera twist: conditioning {conditioning:.1e}, "
        f"at least {LEAST_CONDITIONING:g} is needed (points on one line, or too close together?)"
    )


def limited_twist(
    twist: npt.ArrayLike, max_linear_speed: float, max_angular_speed: float
) -> tuple[FloatArray, float]:
    """Return the twist, scaled as a whole so that both speeds keep their limits, and the factor ≤ 1.

    The direction of motion stays; speeds in [m/s] and [rad/s].

    Raises:
        InputError: a twist that is not six finite numbers, or a limit that is not positive.
    """
    limited = np.ascontiguousarray(finite_array("twist", twist, (6,)))
    for name, value in (("max_linear_speed", max_linear_speed), ("max_angular_speed", max_angular_speed)):
        if not value > 0.0:
            raise InputError(f"{name}: {value} given; legal: > 0")
    return limited, limit_twist(limited, float(max_linear_speed), float(max_angular_speed))


@kernel
def solve_twist(rows: FloatArray, target: FloatArray, twist: FloatArray) -> float:
    """Write the twist (6,) that minimises ‖rows · twist − target‖² and return the conditioning.

    Normal equations and Cholesky. To be free of units, the linear and the angular half of ``rows`` (m, 6)
    are first divided by their Frobenius norms; with σ_i the singular values of that matrix the
    conditioning is (Σ 1/σ_i²)^(−1/2), so that σ_min/√6 ≤ conditioning ≤ σ_min. It is 0, and the twist
    zero, where the Cholesky factorisation fails.
    """
    scale = np.zeros(6)
    normal = np.zeros((6, 6))
    twist[:] = 0.0
    for i in range(rows.shape[0]):
        for a in range(6):
            twist[a] += rows[i, a] * target[i]
            for b in range(a + 1):
                normal[a, b] += rows[i, a] * rows[i, b]
    linear = normal[0, 0] + normal[1, 1] + normal[2, 2]
    angular = normal[3, 3] + normal[4, 4] + normal[5, 5]
    if not (linear > 0.0 and angular > 0.0):
        twist[:] = 0.0
        return 0.0
    for a in range(6):
        scale[a] = 1.0 / math.sqrt(linear if a < 3 else angular)
    for a in range(6):
        twist[a] *= scale[a]
        for b in range(a + 1):
            normal[a, b] *= scale[a] * scale[b]
    if not factor_cholesky(normal, 6, 0.0):
        twist[:] = 0.0
        return 0.0
    solve_factored(normal, 6, twist)
    for a in range(6):
        twist[a] *= scale[a]
    return 1.0 / math.sqrt(_trace_of_inverse(normal))


@kernel
def _trace_of_inverse(factor: FloatArray) -> float:
    """Return trace((F Fᵀ)⁻¹) = ‖F⁻¹‖²_F of a Cholesky factor F (6, 6)."""
    column = np.empty(6)
    total = 0.0
    for k in range(6):
        for i in range(k, 6):
            entry = 1.0 if i == k else 0.0
            for m in range(k, i):
                entry -= factor[i, m] * column[m]
            column[i] = entry / factor[i, i]
            total += column[i] * column[i]
    return total


@leaf
def limit_twist(twist: FloatArray, max_linear_speed: float, max_angular_speed: float) -> float:
    """Scale ``twist`` (6,) in place so that both speeds keep their limits; return the factor ≤ 1."""
    linear = math.sqrt(twist[0] * twist[0] + twist[1] * twist[1] + twist[2] * twist[2])
    angular = math.sqrt(twist[3] * twist[3] + twist[4] * twist[4] + twist[5] * twist[5])
    factor = 1.0
    if linear > max_linear_speed:
        factor = max_linear_speed / linear
    if angular * factor > max_angular_speed:
        factor = max_angular_speed / angular
    for a in range(6):
        twist[a] *= factor
    return factor
