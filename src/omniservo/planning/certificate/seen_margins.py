"""What a constraint leaves at one pose: seen, not proven."""

import math

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import inlined, kernel, leaf
from omniservo.planning.bernstein_path import ROTATION_FLOOR
from omniservo.planning.certificate.margin_kinds import (
    BODY,
    BODY_SIGHT,
    CIRCLE_RADIUS,
    CLEARANCE,
    CLOUD,
    CLOUD_SIGHT,
    DISC,
    DOMAIN,
    DOMAIN_ANGLE,
    EDGE,
    ENTRY_INDEX,
    ENTRY_KIND,
    ENTRY_SCALE,
    FREE_SIDE,
    LEAST,
    MARGIN_PX,
    MASK,
    PX_PER_UNIT,
    ROTATION,
    SIGHT,
    WALL,
    XI,
)
from omniservo.planning.constraints.cloud import cloud_margin
from omniservo.planning.constraints.cloud_sight import cloud_sight_margin
from omniservo.planning.constraints.constraints import SPHERE_REACH, Constraints
from omniservo.planning.constraints.dead_zone import disc_margin
from omniservo.planning.constraints.free_side import free_side_margin
from omniservo.planning.constraints.image_mask import mask_margin
from omniservo.planning.constraints.occlusion import sight_margin
from omniservo.planning.constraints.place import NORM, TX, TY, TZ
from omniservo.planning.constraints.separation import body_margin, body_sight_margin
from omniservo.planning.constraints.visibility import OUTSIDE


@kernel
def camera_margin(
    kind: int,
    limit: FloatArray,
    scale: float,
    constraints: Constraints,
    optics: FloatArray,
    c: FloatArray,
    j: int,
) -> float:
    """Return what an EDGE, CIRCLE, DOMAIN, DISC or LEAST entry leaves to camera point j of c (n, 4)."""
    x, y, z, rho = c[j, 0], c[j, 1], c[j, 2], 1.0 / c[j, 3]
    if kind == LEAST:
        return float(rho - constraints.least_distance)
    if kind == DOMAIN:
        return float(optics[DOMAIN_ANGLE] - math.atan2(math.sqrt(x * x + y * y), z))
    d = z + optics[XI] * rho
    if not d > 0.0:
        return OUTSIDE
    if kind == EDGE:
        return float((limit[3] * rho - limit[0] * x - limit[1] * y - limit[2] * z) / d * scale)
    if kind == DISC:
        return disc_margin(constraints.disc, x, y, z)
    return float(
        (optics[CIRCLE_RADIUS] - math.sqrt(x * x + y * y) / d) * optics[PX_PER_UNIT] - optics[MARGIN_PX]
    )


@inlined
def centre_margin(kind: int, index: int, constraints: Constraints, pose: FloatArray) -> float:
    """Return what a CLEARANCE, WALL, ROTATION, FREE_SIDE, BODY or CLOUD entry leaves at a pose (14,)."""
    if kind == ROTATION:
        return float(pose[NORM] - ROTATION_FLOOR)
    if kind == WALL:
        side, axis = index // 3, index % 3
        gap = float(pose[TX + axis] - constraints.box[side, axis])
        return gap if side == 0 else -gap
    if kind == FREE_SIDE:
        return free_side_margin(constraints, index, pose)
    if kind == BODY:
        return body_margin(constraints, index, pose)
    if kind == CLOUD:
        return cloud_margin(constraints, index, pose)
    return sphere_margin(constraints.obstacles, index, pose)


@leaf
def sphere_margin(obstacles: FloatArray, index: int, pose: FloatArray) -> float:
    """Return what the clearance of a sphere leaves at a pose (13,)."""
    x, y, z = pose[TX] - obstacles[index, 0], pose[TY] - obstacles[index, 1], pose[TZ] - obstacles[index, 2]
    return float(math.sqrt(x * x + y * y + z * z) - obstacles[index, SPHERE_REACH])


@kernel
def smallest_at(
    entry: FloatArray,
    constraints: Constraints,
    optics: FloatArray,
    pose: FloatArray,
    c: FloatArray,
    points: FloatArray,
) -> tuple[float, int]:
    """Return an entry's smallest margin over ``points`` (n, 3) at a pose (14,), and which point has it.

    ``c`` (n, 4) are these points in the camera frame and 1/distance.
    """
    kind, index, scale = int(entry[ENTRY_KIND]), int(entry[ENTRY_INDEX]), float(entry[ENTRY_SCALE])
    if kind >= CLEARANCE:
        return centre_margin(kind, index, constraints, pose), 0
    if kind == SIGHT:
        return sight_margin(constraints, index, pose, points)
    if kind == BODY_SIGHT:
        return body_sight_margin(constraints, index, pose, points)
    if kind == CLOUD_SIGHT:
        return cloud_sight_margin(constraints, index, pose, points)
    if kind == MASK:
        return mask_margin(constraints, index, optics[XI], c)
    least, about = math.inf, 0
    limit = constraints.limits[index]
    for j in range(points.shape[0]):
        value = camera_margin(kind, limit, scale, constraints, optics, c, j)
        if value < least:
            least, about = value, j
    return least, about
