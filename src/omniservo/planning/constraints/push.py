"""How a family pushes the search at samples of the path.

A constraint with dimensionless value g (≥ 0 where it holds) and target μ has the residual r = max(0, μ − g).
With g ≈ g + a·ξ for a small camera motion ξ = (linear, angular) in the camera frame, active rows add up to
one normal equation a sample: ``systems[s]`` (6, 7) = [Σ a aᵀ, Σ a r], upper triangle. A row's price does not
depend on the degree of the path. ``costs[s]`` is Σ r²/2.

A family is given which of the targets is its first (`Constraints.slots`). A group of constraints whose target
is ASLEEP is not checked.
"""

from typing import NamedTuple

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import leaf
from omniservo.geometry.rotation_row import turned_back

ASLEEP = -1e300
"""Target of a group that has so much left that a descent need not look at it."""


class Samples(NamedTuple):
    """Where the path is checked, what should be left there, and what becomes of it."""

    poses: FloatArray
    """(samples, 14): R row by row, then t, then ‖φ‖², then w"""
    camera_points: FloatArray
    """c and 1/‖c‖ (samples, n, 4)"""
    targets: FloatArray
    """μ of every group of constraints (m,)"""
    least: FloatArray
    """the smallest g of each so far (m,)"""
    systems: FloatArray
    """(samples, 6, 7), see above"""
    costs: FloatArray
    """(samples,), see above"""


@leaf
def push_centre(
    systems: FloatArray, costs: FloatArray, s: int, poses: FloatArray, x: float, y: float, z: float, r: float
) -> None:
    """Add a row that depends on t alone: ∂g/∂t = (x, y, z) in the reference frame."""
    row = turned_back(poses[s], x, y, z)
    for i in range(3):
        a = row[i]
        for j in range(i, 3):
            systems[s, i, j] += a * row[j]
        systems[s, i, 6] += a * r
    costs[s] += 0.5 * r * r


@leaf
def push_centre_often(
    systems: FloatArray,
    costs: FloatArray,
    s: int,
    poses: FloatArray,
    square: tuple[float, float, float, float, float, float],
    side: tuple[float, float, float],
    cost: float,
) -> None:
    """Add many rows of `push_centre` at once, given Σ g gᵀ (xx, xy, xz, yy, yz, zz), Σ g r and Σ r²/2."""
    xx, xy, xz, yy, yz, zz = square
    x, y, z = side
    for i in range(3):
        a, b, c = poses[s, i], poses[s, 3 + i], poses[s, 6 + i]
        u, v, w = xx * a + xy * b + xz * c, xy * a + yy * b + yz * c, xz * a + yz * b + zz * c
        for j in range(i, 3):
            systems[s, i, j] += poses[s, j] * u + poses[s, 3 + j] * v + poses[s, 6 + j] * w
        systems[s, i, 6] += a * x + b * y + c * z
    costs[s] += cost


@leaf
def push_camera_point(
    systems: FloatArray,
    costs: FloatArray,
    s: int,
    c: tuple[float, float, float],
    g: tuple[float, float, float],
    r: float,
) -> None:
    """Add a row that depends on a point c in the camera frame, with g = ∂g/∂c.

    dc = −linear − angular × c, so a = (−∂g/∂c, −c × ∂g/∂c).
    """
    x, y, z = c
    gx, gy, gz = g
    row = (-gx, -gy, -gz, z * gy - y * gz, x * gz - z * gx, y * gx - x * gy)
    for i in range(6):
        a = row[i]
        for j in range(i, 6):
            systems[s, i, j] += a * row[j]
        systems[s, i, 6] += a * r
    costs[s] += 0.5 * r * r
