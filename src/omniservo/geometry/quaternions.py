"""The two rotation parametrisations of the paper: quaternion (17), (20) and Cayley vector (18), (21)."""

import math

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel, leaf

QUATERNION = 0
CAYLEY = 1


@leaf
def matrix_from_quaternion(x: float, y: float, z: float, w: float, matrix: FloatArray) -> None:
    """Write R = Λ(q/‖q‖), (20), of q = (x, y, z, w), scalar last and not zero, into ``matrix`` (3, 3)."""
    s = 2.0 / (x * x + y * y + z * z + w * w)
    matrix[0, 0] = 1.0 - s * (y * y + z * z)
    matrix[0, 1] = s * (x * y - z * w)
    matrix[0, 2] = s * (x * z + y * w)
    matrix[1, 0] = s * (x * y + z * w)
    matrix[1, 1] = 1.0 - s * (x * x + z * z)
    matrix[1, 2] = s * (y * z - x * w)
    matrix[2, 0] = s * (x * z - y * w)
    matrix[2, 1] = s * (y * z + x * w)
    matrix[2, 2] = 1.0 - s * (x * x + y * y)


@kernel
def quaternion_from_matrix(matrix: FloatArray) -> FloatArray:
    """Return the unit quaternion (4,), scalar last and not negative, of the rotation ``matrix`` (3, 3), (17).

    The largest of the four squared components is taken first (Shepperd 1978), so no angle is singular.
    """
    q = np.empty(4)
    trace = matrix[0, 0] + matrix[1, 1] + matrix[2, 2]
    largest = 3
    best = trace
    for i in range(3):
        if matrix[i, i] > best:
            best = matrix[i, i]
            largest = i
    if largest == 3:
        q[0] = matrix[2, 1] - matrix[1, 2]
        q[1] = matrix[0, 2] - matrix[2, 0]
        q[2] = matrix[1, 0] - matrix[0, 1]
        q[3] = 1.0 + trace
    else:
        i, j, k = largest, (largest + 1) % 3, (largest + 2) % 3
        q[i] = 1.0 + 2.0 * matrix[i, i] - trace
        q[j] = matrix[i, j] + matrix[j, i]
        q[k] = matrix[i, k] + matrix[k, i]
        q[3] = matrix[k, j] - matrix[j, k]
    _normalise(q, q[3] < 0.0)
    return q


@leaf
def _normalise(q: FloatArray, negate: bool) -> None:
    """Scale a quaternion (4,) to length 1, with the other sign where required."""
    scale = 1.0 / math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    if negate:
        scale = -scale
    for i in range(4):
        q[i] *= scale


@leaf
def rotation_from_parameters(kind: int, parameters: FloatArray, matrix: FloatArray) -> None:
    """Write the rotation of s_R into ``matrix`` (3, 3): (20) for QUATERNION (4,), (21) for CAYLEY (3,).

    (21) is R = (I − [a]×)⁻¹(I + [a]×), the rotation by θ about v for a = tan(θ/2) v: the quaternion (a, 1).
    """
    w = parameters[3] if kind == QUATERNION else 1.0
    matrix_from_quaternion(parameters[0], parameters[1], parameters[2], w, matrix)


@kernel
def parameters_from_rotation(kind: int, matrix: FloatArray) -> FloatArray:
    """Return s_R of ``matrix`` (3, 3): the quaternion (17) or the Cayley vector (18).

    The Cayley vector is infinite for a rotation by π exactly, as (18) says.
    """
    q = quaternion_from_matrix(matrix)
    if kind == QUATERNION:
        return q
    cayley = np.empty(3)
    for i in range(3):
        cayley[i] = q[i] / q[3]
    return cayley


@leaf
def rotation_differential(kind: int, parameters: FloatArray, differential: FloatArray) -> None:
    """Write D (3, 4 or 3) with δ = D ds_R, where R(s_R + ds_R) = R(s_R) exp([δ]×) to first order.

    Quaternion (v, w): D = (2/‖q‖²) [ w I − [v]×, −v ]. Cayley a: D = 2/(1 + ‖a‖²) (I − [a]×).
    """
    x, y, z = parameters[0], parameters[1], parameters[2]
    w = parameters[3] if kind == QUATERNION else 1.0
    s = 2.0 / (x * x + y * y + z * z + w * w)
    differential[0, 0] = s * w
    differential[0, 1] = s * z
    differential[0, 2] = -s * y
    differential[1, 0] = -s * z
    differential[1, 1] = s * w
    differential[1, 2] = s * x
    differential[2, 0] = s * y
    differential[2, 1] = -s * x
    differential[2, 2] = s * w
    if kind == QUATERNION:
        differential[0, 3] = -s * x
        differential[1, 3] = -s * y
        differential[2, 3] = -s * z


@kernel
def turn_quaternion(quaternion: FloatArray, rx: float, ry: float, rz: float) -> FloatArray:
    """Return the unit quaternion (4,) of R exp([r]×) for the rotation vector r [rad] applied on the right."""
    angle = math.sqrt(rx * rx + ry * ry + rz * rz)
    # sin(angle/2)/angle tends to 1/2; below 1e-6 the next term is under the rounding.
    f = math.sin(0.5 * angle) / angle if angle > 1e-6 else 0.5
    bx, by, bz, bw = f * rx, f * ry, f * rz, math.cos(0.5 * angle)
    ax, ay, az, aw = quaternion[0], quaternion[1], quaternion[2], quaternion[3]
    q = np.empty(4)
    q[0] = aw * bx + ax * bw + ay * bz - az * by
    q[1] = aw * by - ax * bz + ay * bw + az * bx
    q[2] = aw * bz + ax * by - ay * bx + az * bw
    q[3] = aw * bw - ax * bx - ay * by - az * bz
    _normalise(q, False)
    return q
