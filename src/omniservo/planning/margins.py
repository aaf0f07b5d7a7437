"""How much of every constraint is left along a path: found by looking, then proven (docs/certificate.md).

An entry is a row (kind, index, scale) of floats; a margin is in its unit, beyond what the problem asks for.
"""

import math

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel
from omniservo.geometry.polynomial import PROVEN, REFUTED, UNDECIDED, bernstein_from_power, magnitude
from omniservo.planning.bernstein_path import ROTATION_FLOOR, camera_controls, camera_count, squares
from omniservo.planning.constraints.cloud import cloud_margin, prove_cloud_clear
from omniservo.planning.constraints.cloud_sight import cloud_sight_margin, prove_cloud_sights
from omniservo.planning.constraints.collision import prove_outside_ball
from omniservo.planning.constraints.dead_zone import disc_margin
from omniservo.planning.constraints.demands import Demands
from omniservo.planning.constraints.free_side import free_side_gap, prove_free_side
from omniservo.planning.constraints.image_mask import mask_margin, moved_outward, prove_outside_mask
from omniservo.planning.constraints.least_distance import prove_least_distance
from omniservo.planning.constraints.motion import displacement, point_from_body, seen_from_body
from omniservo.planning.constraints.occlusion import prove_clear_sights, sight_offset
from omniservo.planning.constraints.rotation import prove_rotation
from omniservo.planning.constraints.separation import separate
from omniservo.planning.constraints.solid_gap import hull_of, solid_gap
from omniservo.planning.constraints.visibility import OUTSIDE, prove_visible
from omniservo.planning.constraints.workspace import prove_wall
from omniservo.planning.descent import place
from omniservo.planning.path_family import set_basis

EDGE, CIRCLE, DOMAIN, DISC, MASK, LEAST, SIGHT, BODY_SIGHT, CLOUD_SIGHT = range(9)
"""Kinds of entries about a target point."""

CLEARANCE, WALL, ROTATION, FREE_SIDE, BODY, CLOUD = range(9, 15)
"""Kinds that are not. Index: the limit, wall, or obstacle among its kind; of a MASK its polygon.

Scale: px of one unit of an EDGE's limit at Z + ξρ = 1."""

SLACK_PX = 1e-7
"""Limits in px are proven with so much more than is claimed: it covers the limits' own rounding."""

SLACK_RAD = 1e-12
"""The same for the domain's angle."""

LOOKS = 32
"""The path is looked at so many times, evenly, before every minimum is refined."""

TRIES = 24
"""A margin is proven at most so often, each time a little lower."""

PARABOLAS = 5
"""Parabolas of a refinement; at the last one the places are 1/160 000 of the path apart."""


@kernel
def camera_margin(
    kind: int, limit: FloatArray, scale: float, demands: Demands, optics: FloatArray, c: FloatArray, j: int
) -> float:
    """Return what an EDGE, CIRCLE, DOMAIN, DISC or LEAST entry leaves to camera point j of c (n, 4)."""
    x, y, z, rho = c[j, 0], c[j, 1], c[j, 2], 1.0 / c[j, 3]
    if kind == LEAST:
        return float(rho - demands.numbers[0])
    if kind == DOMAIN:
        return float(optics[4] - math.atan2(math.sqrt(x * x + y * y), z))
    d = z + optics[0] * rho
    if not d > 0.0:
        return OUTSIDE
    if kind == EDGE:
        return float((limit[3] * rho - limit[0] * x - limit[1] * y - limit[2] * z) / d * scale)
    if kind == DISC:
        return disc_margin(demands.disc, x, y, z)
    return float((optics[1] - math.sqrt(x * x + y * y) / d) * optics[2] - optics[3])


@kernel
def centre_margin(kind: int, index: int, demands: Demands, pose: FloatArray) -> float:
    """Return what a CLEARANCE, WALL, ROTATION, FREE_SIDE, BODY or CLOUD entry leaves at a pose (14,)."""
    if kind == ROTATION:
        return float(pose[12] - ROTATION_FLOOR)
    if kind == WALL:
        side, axis = index // 3, index % 3
        gap = float(pose[9 + axis] - demands.box[side, axis])
        return gap if side == 0 else -gap
    if kind == FREE_SIDE:
        x, y, z = centre_from_body(pose, demands.motions, demands.planes[index, 5])
        return free_side_gap(x, y, z, demands.planes[index])
    if kind == BODY:
        body = demands.bodies[index]
        x, y, z = centre_from_body(pose, demands.motions, body[17])
        return float(solid_gap(body, hull_of(body, demands.hulls), x, y, z, x, y, z)[3] - body[16])
    if kind == CLOUD:
        return cloud_margin(demands, index, pose)
    return sphere_margin(demands.obstacles, index, pose)


@kernel
def sphere_margin(obstacles: FloatArray, index: int, pose: FloatArray) -> float:
    """Return what the clearance of a sphere leaves at a pose (13,)."""
    x, y, z = pose[9] - obstacles[index, 0], pose[10] - obstacles[index, 1], pose[11] - obstacles[index, 2]
    return float(math.sqrt(x * x + y * y + z * z) - obstacles[index, 4])


@kernel
def centre_from_body(pose: FloatArray, motions: FloatArray, motion: float) -> tuple[float, float, float]:
    """Return t − m of a pose (14,)."""
    x, y, z = displacement(motions, motion, pose[13])
    return pose[9] - x, pose[10] - y, pose[11] - z


@kernel
def smallest_at(
    entry: FloatArray,
    demands: Demands,
    optics: FloatArray,
    pose: FloatArray,
    c: FloatArray,
    points: FloatArray,
) -> tuple[float, int]:
    """Return an entry's smallest margin over ``points`` (n, 3) at a pose (14,), and which point has it.

    ``c`` (n, 4) are these points in the camera frame and 1/distance.
    """
    kind, index, scale = int(entry[0]), int(entry[1]), float(entry[2])
    if kind >= CLEARANCE:
        return centre_margin(kind, index, demands, pose), 0
    least, about = math.inf, 0
    if kind == SIGHT:
        o = demands.obstacles[index]
        for j in range(points.shape[0]):
            value = sight_offset(pose[9], pose[10], pose[11], points[j], o)[3]
            if value < least:
                least, about = value, j
        return least - float(o[3]), about
    if kind == BODY_SIGHT:
        body = demands.bodies[index]
        hull = hull_of(body, demands.hulls)
        mx, my, mz = displacement(demands.motions, body[17], pose[13])
        x, y, z = pose[9] - mx, pose[10] - my, pose[11] - mz
        for j in range(points.shape[0]):
            hx, hy, hz = points[j, 0] - mx, points[j, 1] - my, points[j, 2] - mz
            value = solid_gap(body, hull, x, y, z, hx, hy, hz)[3]
            if value < least:
                least, about = value, j
        return least - float(body[15]), about
    if kind == CLOUD_SIGHT:
        return cloud_sight_margin(demands, index, pose, points)
    if kind == MASK:
        return mask_margin(mask_polygon(demands, index), optics[0], c)
    limit = demands.limits[index]
    for j in range(points.shape[0]):
        value = camera_margin(kind, limit, scale, demands, optics, c, j)
        if value < least:
            least, about = value, j
    return least, about


@kernel
def refine(
    entry: FloatArray, demands: Demands, optics: FloatArray, phi: FloatArray, t: FloatArray, j: int, w: float
) -> tuple[float, float]:
    """Return (margin, w) of the smallest margin of point j near w.

    Three places around the smallest so far give a parabola; its lowest place is looked at next, and the
    places move closer together.
    """
    scratch = np.empty((1, phi.shape[1])), np.empty((1, t.shape[1])), np.empty(14), np.empty((1, 4))
    turn, point = np.empty((3, 4)), demands.points[j : j + 1]
    values, places = np.empty(4), np.empty(4)
    best, at, width = math.inf, w, 0.25 / LOOKS
    for _ in range(PARABOLAS):
        middle = min(max(at, width), 1.0 - width)
        for k in range(4):
            if k < 3:
                places[k] = middle + (k - 1) * width
            else:
                curvature = values[0] - 2.0 * values[1] + values[2]
                shift = 0.5 * (values[0] - values[2]) / curvature if curvature > 0.0 else 0.0
                places[3] = min(max(middle + width * min(max(shift, -8.0), 8.0), 0.0), 1.0)
            set_basis(scratch[0], 0, places[k])
            set_basis(scratch[1], 0, places[k])
            place(phi, t, scratch[0][0], scratch[1][0], point, scratch[2], scratch[3], turn)
            scratch[2][13] = places[k]
            values[k] = smallest_at(entry, demands, optics, scratch[2], scratch[3], point)[0]
            if values[k] < best:
                best, at = values[k], places[k]
        width *= 0.2
    return best, at


@kernel
def look(
    demands: Demands,
    optics: FloatArray,
    entries: FloatArray,
    phi: FloatArray,
    t: FloatArray,
    table: FloatArray,
) -> None:
    """Write (margin, w, point) of every entry's smallest margin at LOOKS + 1 places into ``table`` (e, 4)."""
    count = entries.shape[0]
    pose, c, turn = np.empty(14), np.empty((demands.points.shape[0], 4)), np.empty((3, 4))
    rotation_basis, translation_basis = np.empty((1, phi.shape[1])), np.empty((1, t.shape[1]))
    for e in range(count):
        table[e, 0] = math.inf
    for step in range(LOOKS + 1):
        w = step / LOOKS
        set_basis(rotation_basis, 0, w)
        set_basis(translation_basis, 0, w)
        place(phi, t, rotation_basis[0], translation_basis[0], demands.points, pose, c, turn)
        pose[13] = w
        for e in range(count):
            if entries[e, 0] == CLEARANCE:  # there may be thousands
                margin, about = sphere_margin(demands.obstacles, int(entries[e, 1]), pose), 0
            else:
                margin, about = smallest_at(entries[e], demands, optics, pose, c, demands.points)
            if not margin >= table[e, 0]:
                table[e, 0], table[e, 1], table[e, 2] = margin, w, about


@kernel
def mask_polygon(demands: Demands, index: int) -> FloatArray:
    """Return the edges (k, 5) of one polygon of the mask."""
    return demands.mask_edges[demands.mask_firsts[index] : demands.mask_firsts[index + 1]]


@kernel
def circle_cosine(xi: float, radius: float) -> float:
    """Return Z/ρ of the bearings at the radius r = ‖m̄‖: (ξ + √(1 + (1−ξ²)r²))/(1 + r²) − ξ."""
    square = radius * radius
    root = math.sqrt(max(0.0, 1.0 + (1.0 - xi) * (1.0 + xi) * square))
    return (xi + root) / (1.0 + square) - xi


@kernel
def prove_view(
    entry: FloatArray,
    margin: float,
    demands: Demands,
    optics: FloatArray,
    controls: FloatArray,
    errors: FloatArray,
    count: float,
) -> tuple[int, float, int]:
    """Decide an EDGE, CIRCLE, DOMAIN, DISC or MASK entry moved inward by ``margin``: status, w, point."""
    kind = int(entry[0])
    if kind == MASK:
        grown = moved_outward(mask_polygon(demands, int(entry[1])), margin + SLACK_PX, optics[0])
        return prove_outside_mask(controls, errors, count, grown)
    limits, disc = np.zeros((0 if kind == DISC else 1, 4)), np.zeros(7 if kind == DISC else 0)
    if kind == DISC:
        for i in range(7):
            disc[i] = demands.disc[i]
        disc[5] += margin + SLACK_PX
        if disc[5] <= 0.0:
            return PROVEN, 0.0, 0
    elif kind == EDGE:
        for i in range(4):
            limits[0, i] = demands.limits[int(entry[1]), i]
        inward = (margin + SLACK_PX) / entry[2]
        limits[0, 2] += inward
        limits[0, 3] -= inward * optics[0]
    else:
        limits[0, 2] = -1.0
        if kind == CIRCLE:
            radius = optics[1] - (optics[3] + margin + SLACK_PX) / optics[2]
            if radius < 0.0:
                return UNDECIDED, 0.0, 0
            if math.isinf(radius):
                return PROVEN, 0.0, 0
            limits[0, 3] = -circle_cosine(optics[0], radius) - 1e-15
        else:
            angle = optics[4] - margin - SLACK_RAD
            if angle < 0.0:
                return UNDECIDED, 0.0, 0
            limits[0, 3] = -math.cos(min(angle, math.pi)) - 1e-15
    status, w, j, _ = prove_visible(controls, errors, count, limits, disc)
    return status, w, j


@kernel
def prove_space(
    entry: FloatArray,
    margin: float,
    demands: Demands,
    rotation: FloatArray,
    centre: FloatArray,
    translation: FloatArray,
    square: FloatArray,
    raised: FloatArray,
    size: float,
) -> tuple[int, float, int]:
    """Decide any entry that is not about the image with ``margin`` to spare: status, w, point."""
    kind, index = int(entry[0]), int(entry[1])
    if kind == CLOUD_SIGHT:
        return prove_cloud_sights(demands, index, margin, translation, centre, size)
    if kind in (FREE_SIDE, BODY, BODY_SIGHT):
        return prove_solid(kind, index, margin, demands, centre, translation, size)
    if kind == LEAST:
        return prove_least_distance(square, raised, size, demands.points, demands.numbers[0] + margin)
    if kind == SIGHT:
        o = demands.obstacles[index]
        return prove_clear_sights(centre, size, demands.points, o, o[3] + margin)
    status, w = PROVEN, 0.0
    if kind == CLOUD:
        status, w = prove_cloud_clear(demands, index, margin, translation, square, raised, size)
    elif kind == CLEARANCE:
        o = demands.obstacles[index]
        if o[4] + margin > 0.0:
            status, w = prove_outside_ball(square, raised, size, o, o[4] + margin)
    elif kind == WALL:
        side, axis = index // 3, index % 3
        bound = demands.box[side, axis] + (margin if side == 0 else -margin)
        status, w = prove_wall(centre, size, side, axis, bound)
    else:
        status, w = prove_rotation(rotation, ROTATION_FLOOR + margin)
    return status, w, 0


@kernel
def prove_solid(
    kind: int,
    index: int,
    margin: float,
    demands: Demands,
    centre: FloatArray,
    translation: FloatArray,
    size: float,
) -> tuple[int, float, int]:
    """Decide a FREE_SIDE, BODY or BODY_SIGHT entry with ``margin`` to spare: status, w, point."""
    motions = demands.motions
    if kind == FREE_SIDE:
        plane = demands.planes[index]
        path, largest = seen_from_body(centre, translation, size, motions, plane[5])
        status, w = prove_free_side(path, largest, plane, margin)
        return status, w, 0
    body, hulls, planes = demands.bodies[index], demands.hulls, np.empty((0, 5))
    path, largest = seen_from_body(centre, translation, size, motions, body[17])
    if kind == BODY:
        status, w, _ = separate(path, largest, np.empty((3, 0)), body, hulls, body[16] + margin, planes)
        return status, w, 0
    for j in range(demands.points.shape[0]):
        h = point_from_body(demands.points[j], motions, body[17])
        status, w, _ = separate(path, largest, h, body, hulls, body[15] + margin, planes)
        if status != PROVEN:
            return status, w, j
    return PROVEN, 0.0, 0


@kernel
def path_margins(
    demands: Demands, optics: FloatArray, entries: FloatArray, rotation: FloatArray, translation: FloatArray
) -> FloatArray:
    """Return a row (margin, w, point, status) for every entry (e, 4) on the path given by powers.

    PROVEN: the margin is ≥ 0 and holds for all w. REFUTED: the requirement itself fails at w. Otherwise
    UNDECIDED. Where status is not PROVEN the margin is the smallest one seen.

    Args:
        demands: the problem.
        optics: ξ, the circle's radius on the plane m̄ before any margin, the least singular value of K's 2×2
            block [px], the visibility margin [px], the domain's angle [rad].
        entries: (e, 4): kind, index, scale, first step below the smallest margin seen.
        rotation: (4, σ+1), highest power first.
        translation: (3, τ+1) [m], highest power first.
    """
    table = np.empty((entries.shape[0], 4))
    phi, centre = bernstein_from_power(rotation), bernstein_from_power(translation)
    look(demands, optics, entries, phi, centre, table)
    square, raised = squares(translation)
    size = magnitude(translation)
    controls, errors = camera_controls(rotation, translation, demands.points)
    count = float(camera_count(rotation.shape[1] - 1, translation.shape[1] - 1))
    for e in range(entries.shape[0]):
        entry, row = entries[e], table[e]
        row[3] = UNDECIDED
        if 0.0 < row[1] < 1.0:
            row[0], row[1] = refine(entry, demands, optics, phi, centre, int(row[2]), row[1])
        step, zero_tried = entry[3], False
        for _ in range(TRIES):
            target = row[0] - step
            if target < 0.0 and not zero_tried:
                target, zero_tried = 0.0, True
            else:
                step *= 4.0
            if entry[0] <= MASK:
                status, w, j = prove_view(entry, target, demands, optics, controls, errors, count)
            else:
                status, w, j = prove_space(
                    entry, target, demands, rotation, centre, translation, square, raised, size
                )
            if status == PROVEN:
                row[0], row[3] = target, (PROVEN if target >= 0.0 else row[3])
                break
            if status == REFUTED:
                seen, w = refine(entry, demands, optics, phi, centre, j, w)
                if seen < row[0]:
                    row[0], row[1], row[2] = seen, w, j
                if target == 0.0 and row[0] < (-1e-9 if entry[0] <= MASK else 0.0):
                    row[3] = REFUTED
    return table


@kernel
def pose_margins(
    demands: Demands,
    optics: FloatArray,
    entries: FloatArray,
    quaternion: FloatArray,
    translation: FloatArray,
    w: float,
) -> FloatArray:
    """Return a row (margin, point) for every entry at a pose: unit quaternion (4,), t (3,) [m], w."""
    phi, t, one = np.empty((4, 1)), np.empty((3, 1)), np.ones(1)
    for i in range(4):
        phi[i, 0] = quaternion[i]
    for i in range(3):
        t[i, 0] = translation[i]
    pose, c, turn = np.empty(14), np.empty((demands.points.shape[0], 4)), np.empty((3, 4))
    place(phi, t, one, one, demands.points, pose, c, turn)
    pose[13] = w
    table = np.empty((entries.shape[0], 2))
    for e in range(entries.shape[0]):
        margin, about = smallest_at(entries[e], demands, optics, pose, c, demands.points)
        table[e, 0], table[e, 1] = margin, about
    return table
