"""Whether a constraint holds on the whole path with a margin to spare (docs/certificate.md)."""

import math

import numpy as np

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import inlined, leaf
from omniservo.geometry.subdivision import PROVEN, UNDECIDED
from omniservo.planning.bernstein_path import ROTATION_FLOOR
from omniservo.planning.certificate.margin_kinds import (
    BODY,
    BODY_SIGHT,
    CIRCLE,
    CIRCLE_RADIUS,
    CLEARANCE,
    CLOUD,
    CLOUD_SIGHT,
    DISC,
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
    SIGHT,
    WALL,
    XI,
)
from omniservo.planning.constraints.cloud import prove_cloud_clear
from omniservo.planning.constraints.cloud_sight import prove_cloud_sights
from omniservo.planning.constraints.collision import prove_outside_ball
from omniservo.planning.constraints.constraints import SPHERE_REACH, Constraints
from omniservo.planning.constraints.dead_zone import RADIUS
from omniservo.planning.constraints.free_side import prove_free_side_of
from omniservo.planning.constraints.image_mask import prove_mask_margin
from omniservo.planning.constraints.least_distance import prove_least_distance
from omniservo.planning.constraints.occlusion import prove_sights
from omniservo.planning.constraints.path_forms import PathForms, ViewForms
from omniservo.planning.constraints.rotation import prove_rotation
from omniservo.planning.constraints.separation import prove_body_clear, prove_sights_past_body
from omniservo.planning.constraints.visibility import prove_visible
from omniservo.planning.constraints.workspace import prove_wall

SLACK_PX = 1e-7
"""Limits in px are proven with so much more than is claimed: it covers the limits' own rounding."""

SLACK_RAD = 1e-12
"""The same for the domain's angle."""


@leaf
def circle_cosine(xi: float, radius: float) -> float:
    """Return Z/ρ of the bearings at the radius r = ‖m̄‖: (ξ + √(1 + (1−ξ²)r²))/(1 + r²) − ξ."""
    square = radius * radius
    root = math.sqrt(max(0.0, 1.0 + (1.0 - xi) * (1.0 + xi) * square))
    return (xi + root) / (1.0 + square) - xi


@inlined
def prove_view(
    entry: FloatArray, margin: float, constraints: Constraints, optics: FloatArray, view: ViewForms
) -> tuple[int, float, int]:
    """Decide an EDGE, CIRCLE, DOMAIN, DISC or MASK entry moved inward by ``margin``: status, w, point."""
    kind = int(entry[ENTRY_KIND])
    if kind == MASK:
        return prove_mask_margin(constraints, int(entry[ENTRY_INDEX]), margin + SLACK_PX, optics[XI], view)
    limits, disc = np.zeros((0 if kind == DISC else 1, 4)), np.zeros(7 if kind == DISC else 0)
    if kind == DISC:
        for i in range(7):
            disc[i] = constraints.disc[i]
        disc[RADIUS] += margin + SLACK_PX
        if disc[RADIUS] <= 0.0:
            return PROVEN, 0.0, 0
    elif kind == EDGE:
        for i in range(4):
            limits[0, i] = constraints.limits[int(entry[ENTRY_INDEX]), i]
        inward = (margin + SLACK_PX) / entry[ENTRY_SCALE]
        limits[0, 2] += inward
        limits[0, 3] -= inward * optics[XI]
    else:
        limits[0, 2] = -1.0
        if kind == CIRCLE:
            radius = optics[CIRCLE_RADIUS] - (optics[MARGIN_PX] + margin + SLACK_PX) / optics[PX_PER_UNIT]
            if radius < 0.0:
                return UNDECIDED, 0.0, 0
            if math.isinf(radius):
                return PROVEN, 0.0, 0
            limits[0, 3] = -circle_cosine(optics[XI], radius) - 1e-15
        else:
            angle = optics[DOMAIN_ANGLE] - margin - SLACK_RAD
            if angle < 0.0:
                return UNDECIDED, 0.0, 0
            limits[0, 3] = -math.cos(min(angle, math.pi)) - 1e-15
    status, w, j, _ = prove_visible(view.controls, view.errors, view.roundings, limits, disc)
    return status, w, j


@inlined
def prove_space(
    entry: FloatArray, margin: float, constraints: Constraints, path: PathForms
) -> tuple[int, float, int]:
    """Decide any entry that is not about the image with ``margin`` to spare: status, w, point."""
    kind, index = int(entry[ENTRY_KIND]), int(entry[ENTRY_INDEX])
    if kind == CLOUD_SIGHT:
        return prove_cloud_sights(constraints, index, margin, path)
    if kind == CLOUD:
        return prove_cloud_clear(constraints, index, margin, path)
    if kind == FREE_SIDE:
        return prove_free_side_of(constraints, index, margin, path)
    if kind == BODY:
        return prove_body_clear(constraints, index, margin, path)
    if kind == BODY_SIGHT:
        return prove_sights_past_body(constraints, index, margin, path)
    if kind == SIGHT:
        return prove_sights(constraints, index, margin, path)
    if kind == LEAST:
        least = constraints.least_distance + margin
        return prove_least_distance(path.square, path.raised, path.size, constraints.points, least)
    status, w = PROVEN, 0.0
    if kind == CLEARANCE:
        o = constraints.obstacles[index]
        if o[SPHERE_REACH] + margin > 0.0:
            status, w = prove_outside_ball(path.square, path.raised, path.size, o, o[SPHERE_REACH] + margin)
    elif kind == WALL:
        side, axis = index // 3, index % 3
        bound = constraints.box[side, axis] + (margin if side == 0 else -margin)
        status, w = prove_wall(path.centre, path.size, side, axis, bound)
    else:
        status, w = prove_rotation(path.rotation, ROTATION_FLOOR + margin)
    return status, w, 0
