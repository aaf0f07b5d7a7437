"""The rest of a path, seen from where the camera is, and the proven path nearest to it."""

import math

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.held import held
from omniservo.geometry.kernel import kernel, leaf
from omniservo.geometry.polynomial import bernstein_from_power
from omniservo.geometry.subdivision import PROVEN, REFUTED
from omniservo.planning.constraints.constraints import Constraints
from omniservo.planning.search.path_family import Ends, offsets, path_family, unknowns
from omniservo.planning.search.prove_path import prove_path
from omniservo.planning.search.settle import PULL, end_values, power_path, settle


@kernel
def rest_controls(coefficients: FloatArray, w: float, degree: int) -> FloatArray:
    """Return the control points (m, degree+1) of p(w + (1 − w)s), s in [0, 1], of p by powers (m, n+1).

    De Casteljau's right part at w, then its degree raised from n to ``degree`` ≥ n.
    """
    controls, n = bernstein_from_power(coefficients), coefficients.shape[1] - 1
    raised = np.empty((controls.shape[0], degree + 1))
    for r in range(controls.shape[0]):
        for level in range(n):
            for k in range(n - level):
                controls[r, k] += w * (controls[r, k + 1] - controls[r, k])
        for k in range(n + 1):
            raised[r, k] = controls[r, k]
        for m in range(n, degree):
            raised[r, m + 1] = raised[r, m]
            for k in range(m, 0, -1):
                raised[r, k] += k / (m + 1.0) * (raised[r, k - 1] - raised[r, k])
    return raised


@leaf
def turn_back(quaternion: FloatArray, phi: FloatArray) -> None:
    """Replace every φ in the columns (4, k) by ±q* ⊗ φ / ‖φ₀‖; φ₀, the first, gets a scalar part ≥ 0."""
    x, y, z, w = -quaternion[0], -quaternion[1], -quaternion[2], quaternion[3]
    length = 0.0
    for c in range(4):
        length += phi[c, 0] * phi[c, 0]
    first = w * phi[3, 0] - x * phi[0, 0] - y * phi[1, 0] - z * phi[2, 0]
    f = (1.0 if first >= 0.0 else -1.0) / max(math.sqrt(length), 1e-300)
    for k in range(phi.shape[1]):
        a, b, c, d = f * phi[0, k], f * phi[1, k], f * phi[2, k], f * phi[3, k]
        phi[0, k] = w * a + x * d + y * c - z * b
        phi[1, k] = w * b - x * c + y * d + z * a
        phi[2, k] = w * c + x * b - y * a + z * d
        phi[3, k] = w * d - x * a - y * b - z * c


@leaf
def carry_over(t: FloatArray, quaternion: FloatArray, centre: FloatArray) -> None:
    """Replace every t in the columns (3, k) by Λ(q)ᵀ (t − centre) [m], q a unit quaternion."""
    x, y, z, w = -quaternion[0], -quaternion[1], -quaternion[2], quaternion[3]
    for k in range(t.shape[1]):
        a, b, c = t[0, k] - centre[0], t[1, k] - centre[1], t[2, k] - centre[2]
        u, v, s = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
        t[0, k] = a + w * u + y * s - z * v
        t[1, k] = b + w * v + z * u - x * s
        t[2, k] = c + w * s + x * v - y * u


@kernel
def settle_rest(
    constraints: Constraints,
    ends: Ends,
    rotation: FloatArray,
    translation: FloatArray,
    w: float,
    quaternion: FloatArray,
    centre: FloatArray,
    degrees: tuple[int, int],
) -> tuple[int, FloatArray, FloatArray]:
    """Return status, φ and t by powers: the rest of an old path from w on, or a proven one nearby.

    Args:
        constraints: the problem in the present camera frame.
        ends: its ends; φ(1) a unit quaternion, taken with the sign that is nearer to where the old path
            ends. The scalar part of φ′(0) is taken from the old path.
        rotation: the old φ by powers (4, m+1), in the old initial frame.
        translation: the old t by powers (3, n+1) [m].
        w: where on the old path the camera is, 0 ≤ w < 1.
        quaternion: the present orientation in the old initial frame (4,), unit.
        centre: the present centre there (3,) [m].
        degrees: of the new φ, σ ≥ m, and of the new t, τ ≥ n; at least 2 where ``ends`` has a departure.

    Returns:
        PROVEN; else REFUTED: nothing was proven.
    """
    sigma, tau = degrees
    phi, t = rest_controls(rotation, w, sigma), rest_controls(translation, w, tau)
    turn_back(quaternion, phi)
    carry_over(t, quaternion, centre)
    square, same = 0.0, 0.0
    for c in range(4):
        square += phi[c, sigma] * phi[c, sigma]
        same += phi[c, sigma] * ends.quaternion[c]
    goal, departure = np.empty(4), ends.departure.copy()
    for c in range(4):
        goal[c] = math.copysign(math.sqrt(square), same) * ends.quaternion[c]
    if departure.shape[0] > 0:
        departure[3] = sigma * (phi[3, 1] - phi[3, 0])
    constraints, family = (
        held(constraints),
        held(path_family(Ends(goal, ends.translation, departure), sigma, tau)),
    )
    x = np.empty(unknowns(family))
    offsets(family, constraints.ell, phi, t, x)
    rotation, translation = power_path(family, constraints.ell, x)
    status, _ = prove_path(constraints, rotation, translation)
    if status == PROVEN:
        return PROVEN, rotation, translation
    end_least = end_values(constraints, family)
    least = np.empty_like(end_least)
    status, phi, t, _ = settle(constraints, family, end_least, PULL, x, least)
    return PROVEN if status == PROVEN else REFUTED, phi, t
