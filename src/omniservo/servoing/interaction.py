"""Feature values and their interaction matrices, compiled: what the control step runs on every image.

Both features are stored three wide so that one kernel serves both: the third coordinate of a
virtual-plane feature and its row are zero and drop out of every sum.
"""

import math

from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.geometry.kernel import leaf

BEARING = 0
VIRTUAL_PLANE = 1

LEAST_COSINE = 1e-9
"""A point whose direction has a smaller cosine to the optical axis has no virtual-plane image."""


@leaf
def write_feature(kind: int, x: float, y: float, z: float, feature: FloatArray) -> bool:
    """Write the feature (3,) of the camera point (x, y, z); False, with zeros, where it does not exist.

    BEARING: c/‖c‖, for c ≠ 0.  VIRTUAL_PLANE: (x/z, y/z, 0), for z > 1e-9 ‖c‖.
    """
    distance = math.sqrt(x * x + y * y + z * z)
    feature[0] = feature[1] = feature[2] = 0.0
    if not (distance > 0.0 and distance < math.inf):
        return False
    if kind == BEARING:
        feature[0] = x / distance
        feature[1] = y / distance
        feature[2] = z / distance
        return True
    if not z > LEAST_COSINE * distance:
        return False
    feature[0] = x / z
    feature[1] = y / z
    return True


@leaf
def write_rows(kind: int, x: float, y: float, z: float, rows: FloatArray) -> bool:
    """Write ds/dt = rows · (linear, angular), rows (3, 6), of the camera point (x, y, z) that stands still.

    From ċ = −v − ω × c.  BEARING: [−(1/‖c‖)(I − b bᵀ)   [b]×].  VIRTUAL_PLANE: the classical block at
    depth z (Chaumette and Hutchinson 2006), and a zero third row. False, with zeros, where the feature
    does not exist.
    """
    feature = rows[0, :3]
    if not write_feature(kind, x, y, z, feature):
        rows[:, :] = 0.0
        return False
    a, b, c = feature[0], feature[1], feature[2]
    if kind == BEARING:
        nearness = 1.0 / math.sqrt(x * x + y * y + z * z)
        _write_bearing_rows(a, b, c, nearness, rows)
    else:
        _write_plane_rows(a, b, 1.0 / z, rows)
    return True


@leaf
def _write_bearing_rows(a: float, b: float, c: float, nearness: float, rows: FloatArray) -> None:
    """Write the block of the bearing (a, b, c) of a point at distance 1/nearness."""
    rows[0, 0], rows[0, 1], rows[0, 2] = nearness * (a * a - 1.0), nearness * a * b, nearness * a * c
    rows[1, 0], rows[1, 1], rows[1, 2] = nearness * a * b, nearness * (b * b - 1.0), nearness * b * c
    rows[2, 0], rows[2, 1], rows[2, 2] = nearness * a * c, nearness * b * c, nearness * (c * c - 1.0)
    rows[0, 3], rows[0, 4], rows[0, 5] = 0.0, -c, b
    rows[1, 3], rows[1, 4], rows[1, 5] = c, 0.0, -a
    rows[2, 3], rows[2, 4], rows[2, 5] = -b, a, 0.0


@leaf
def _write_plane_rows(a: float, b: float, nearness: float, rows: FloatArray) -> None:
    """Write the block of the virtual-plane point (a, b) of a point at depth 1/nearness."""
    rows[0, 0], rows[0, 1], rows[0, 2] = -nearness, 0.0, a * nearness
    rows[1, 0], rows[1, 1], rows[1, 2] = 0.0, -nearness, b * nearness
    rows[0, 3], rows[0, 4], rows[0, 5] = a * b, -(1.0 + a * a), b
    rows[1, 3], rows[1, 4], rows[1, 5] = 1.0 + b * b, -a * b, -a
    rows[2, :] = 0.0


@leaf
def write_features(kind: int, points: FloatArray, features: FloatArray, valid: BoolArray) -> None:
    """Write the features (n, 3) of camera points (n, 3) and where they exist (n,)."""
    for j in range(points.shape[0]):
        valid[j] = write_feature(kind, points[j, 0], points[j, 1], points[j, 2], features[j])


@leaf
def write_interaction(kind: int, points: FloatArray, rows: FloatArray, valid: BoolArray) -> None:
    """Write the interaction blocks (n, 3, 6) of camera points (n, 3) and where they exist (n,)."""
    for j in range(points.shape[0]):
        valid[j] = write_rows(kind, points[j, 0], points[j, 1], points[j, 2], rows[j])
