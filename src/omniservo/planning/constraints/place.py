"""Where the camera is at one w, and what it sees there."""

import math

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import leaf
from omniservo.geometry.rotation_row import XX, XY, XZ, YX, YY, YZ, ZX, ZY, ZZ, turned_back

TX, TY, TZ, NORM, AT = range(ZZ + 1, ZZ + 6)
"""A pose is a row (14,): the rotation R row by row, the camera centre t [m], ‖φ‖², and the w it is at."""


@leaf
def place(
    phi: FloatArray,
    t: FloatArray,
    rotation_basis: FloatArray,
    translation_basis: FloatArray,
    points: FloatArray,
    pose: FloatArray,
    camera_points: FloatArray,
    turn: FloatArray,
) -> None:
    """Write pose (14,) but for its w, camera points (n, 4) and ∂angular/∂φ (3, 4) of the path at a sample."""
    x, y, z, w = 0.0, 0.0, 0.0, 0.0
    for k in range(rotation_basis.shape[0]):
        b = rotation_basis[k]
        x, y, z, w = x + b * phi[0, k], y + b * phi[1, k], z + b * phi[2, k], w + b * phi[3, k]
    for c in range(3):
        total = 0.0
        for k in range(translation_basis.shape[0]):
            total += translation_basis[k] * t[c, k]
        pose[TX + c] = total
    pose[NORM] = x * x + y * y + z * z + w * w
    f = 2.0 / max(pose[NORM], 1e-12)
    pose[XX], pose[XY], pose[XZ] = 1.0 - f * (y * y + z * z), f * (x * y - z * w), f * (x * z + y * w)
    pose[YX], pose[YY], pose[YZ] = f * (x * y + z * w), 1.0 - f * (x * x + z * z), f * (y * z - x * w)
    pose[ZX], pose[ZY], pose[ZZ] = f * (x * z - y * w), f * (y * z + x * w), 1.0 - f * (x * x + y * y)
    turn[0, 0], turn[0, 1], turn[0, 2], turn[0, 3] = f * w, f * z, -f * y, -f * x
    turn[1, 0], turn[1, 1], turn[1, 2], turn[1, 3] = -f * z, f * w, f * x, -f * y
    turn[2, 0], turn[2, 1], turn[2, 2], turn[2, 3] = f * y, -f * x, f * w, -f * z
    for j in range(points.shape[0]):
        a, b, c = points[j, 0] - pose[TX], points[j, 1] - pose[TY], points[j, 2] - pose[TZ]
        camera_points[j, 0], camera_points[j, 1], camera_points[j, 2] = turned_back(pose, a, b, c)
        camera_points[j, 3] = 1.0 / max(math.sqrt(a * a + b * b + c * c), 1e-12)
