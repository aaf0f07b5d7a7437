"""Image mask: target points stay out of convex polygons in pixels.

A pixel is outside a convex polygon exactly when it is beyond one of its edges, n·p ≥ b. Each edge is an image
line, so with D = Z + ξρ > 0 (the domain's limit) a cone n·c ≤ κ‖c‖ (method: image limits are cones). A piece
of the path lies outside when the whole piece is beyond one edge; which one may change from piece to piece.

``edges`` (k, 5) are those of one polygon: unit n, κ, and the px of one unit of κ‖c‖ − n·c at D = 1.
"""

import math

import numpy as np

from omniservo.geometry.arrays import FloatArray, IntArray
from omniservo.geometry.kernel import kernel, late, leaf
from omniservo.geometry.polynomial import TINY
from omniservo.geometry.subdivision import (
    FAILS_AT_END,
    FAILS_AT_START,
    HOLDS,
    MAX_LEVEL,
    MAX_PIECES,
    OPEN,
    PROVEN,
    Bounds,
    Piece,
    first_piece,
    subdivide,
)
from omniservo.geometry.vectors import copy_into
from omniservo.planning.constraints.constraints import Constraints
from omniservo.planning.constraints.path_forms import ViewForms
from omniservo.planning.constraints.push import ASLEEP, Samples, push_camera_point
from omniservo.planning.constraints.visibility import (
    OUTSIDE,
    TEST_COUNT,
    cone_holds,
    cone_value,
    holds_by_tightest,
    sum_of_controls,
)


@leaf
def best_edge(edges: FloatArray, x: float, y: float, z: float) -> tuple[int, float]:
    """Return the edge that a camera point is farthest beyond, and by how much: px times D."""
    rho = math.sqrt(x * x + y * y + z * z)
    best, most = 0, -math.inf
    for i in range(edges.shape[0]):
        edge = edges[i]
        value = float((edge[3] * rho - edge[0] * x - edge[1] * y - edge[2] * z) * edge[4])
        if value > most:
            best, most = i, value
    return best, most


@kernel
def mask_polygon(constraints: Constraints, index: int) -> FloatArray:
    """Return the edges (k, 5) of polygon ``index``."""
    return constraints.mask_edges[constraints.mask_firsts[index] : constraints.mask_firsts[index + 1]]


@late
def mask_margin(constraints: Constraints, index: int, xi: float, c: FloatArray) -> tuple[float, int]:
    """Return how far [px] the camera points c (n, 4) are beyond polygon ``index``, and which the least."""
    polygon = mask_polygon(constraints, index)
    least, about = math.inf, 0
    for j in range(c.shape[0]):
        d = c[j, 2] + xi / c[j, 3]
        value = best_edge(polygon, c[j, 0], c[j, 1], c[j, 2])[1] / d if d > 0.0 else OUTSIDE
        if value < least:
            least, about = value, j
    return least, about


@late
def prove_outside_masks(
    controls: FloatArray, errors: FloatArray, count: float, edges: FloatArray, firsts: IntArray
) -> tuple[int, float, int]:
    """Decide every polygon for every point on [0, 1]: status, w, point.

    Args:
        controls: c(w) of every point (n, 3, d+1), from `camera_controls`; D > 0 is proven elsewhere.
        errors: their error per count (n,).
        count: their count.
        edges: of all polygons (e, 5).
        firsts: the first edge of each polygon, then e (p+1,).
    """
    for i in range(firsts.shape[0] - 1):
        status, w, j = prove_outside_mask(controls, errors, count, edges[firsts[i] : firsts[i + 1]])
        if status != PROVEN:
            return status, w, j
    return PROVEN, 0.0, 0


@kernel
def prove_outside_mask(
    controls: FloatArray, errors: FloatArray, count: float, edges: FloatArray
) -> tuple[int, float, int]:
    """Decide one polygon for every point on [0, 1]; see `prove_outside_masks`."""
    degree = float(controls.shape[2] - 1)
    pieces = first_piece(controls[0], np.empty((3, 0)), 0)
    for j in range(controls.shape[0]):
        copy_into(controls[j], pieces.curve[0])
        bounds = Bounds(count + TEST_COUNT, degree, errors[j], MAX_LEVEL, MAX_PIECES)
        status, w, _ = subdivide(_off_polygon, edges, pieces, bounds)
        if status != PROVEN:
            return status, w, j
    return PROVEN, 0.0, 0


@leaf
def _off_polygon(piece: Piece, edges: FloatArray) -> tuple[int, int]:
    """Show a piece beyond one edge of a polygon, or an end of it inside all edges."""
    curve, bound = piece.curve, piece.bound
    if _beyond_one_edge(curve, edges, bound):
        return HOLDS, 0
    if _inside(curve, edges, 0, bound):
        return FAILS_AT_START, 0
    return (FAILS_AT_END if _inside(curve, edges, curve.shape[1] - 1, bound) else OPEN), 0


@leaf
def _beyond_one_edge(piece: FloatArray, edges: FloatArray, bound: float) -> bool:
    """Tell whether the control points show the whole piece beyond the edge that faces its mean bearing."""
    x, y, z = sum_of_controls(piece)
    best = best_edge(edges, x, y, z)[0]
    allowed = bound * _edge_size(edges[best]) + TINY
    edge = (edges[best, 0], edges[best, 1], edges[best, 2], edges[best, 3])
    norm = math.sqrt(x * x + y * y + z * z)
    shorter = (1.0 - 1e-15) / norm if norm > 0.0 else 0.0
    if cone_holds(piece, edge, x * shorter, y * shorter, z * shorter, allowed):
        return True
    return holds_by_tightest(piece, edge, allowed)


@leaf
def _inside(piece: FloatArray, edges: FloatArray, k: int, bound: float) -> bool:
    """Tell whether control point k, an end of the piece, is inside every edge beyond rounding."""
    for i in range(edges.shape[0]):
        edge = (edges[i, 0], edges[i, 1], edges[i, 2], edges[i, 3])
        if not cone_value(piece, edge, k) > bound * _edge_size(edges[i]) + TINY:
            return False
    return True


@leaf
def _edge_size(edge: FloatArray) -> float:
    """Return |n|₁ + 3|κ|, for the error bound."""
    return float(abs(edge[0]) + abs(edge[1]) + abs(edge[2]) + 3.0 * abs(edge[3]))


@kernel
def moved_outward(edges: FloatArray, margin: float, xi: float) -> FloatArray:
    """Return the edges of one polygon, each moved outward by ``margin`` px."""
    moved = edges.copy()
    for i in range(edges.shape[0]):
        outward = margin / edges[i, 4]
        moved[i, 2] += outward
        moved[i, 3] -= outward * xi
    return moved


@late
def prove_mask_margin(
    constraints: Constraints, index: int, margin: float, xi: float, view: ViewForms
) -> tuple[int, float, int]:
    """Decide polygon ``index``, moved outward by ``margin`` px, for every point: status, w, point."""
    grown = moved_outward(mask_polygon(constraints, index), margin, xi)
    return prove_outside_mask(view.controls, view.errors, view.roundings, grown)


@late
def push_off_masks(constraints: Constraints, samples: Samples) -> None:
    """Push every point out of every polygon, by the edge it is farthest beyond: g = κ − n·b (see `push`)."""
    edges, firsts, first = constraints.mask_edges, constraints.mask_firsts, constraints.slots.masks
    camera_points, targets, least = samples.camera_points, samples.targets, samples.least
    systems, costs = samples.systems, samples.costs
    for i in range(firsts.shape[0] - 1):
        group, polygon = first + i, edges[firsts[i] : firsts[i + 1]]
        if targets[group] == ASLEEP:
            continue
        for s in range(camera_points.shape[0]):
            for j in range(camera_points.shape[1]):
                x, y, z = camera_points[s, j, 0], camera_points[s, j, 1], camera_points[s, j, 2]
                inverse = camera_points[s, j, 3]
                edge = polygon[best_edge(polygon, x, y, z)[0]]
                along = (edge[0] * x + edge[1] * y + edge[2] * z) * inverse
                g = edge[3] - along
                least[group] = min(least[group], g)
                if g < targets[group]:
                    f = along * inverse
                    gx, gy, gz = (
                        f * x - inverse * edge[0],
                        f * y - inverse * edge[1],
                        f * z - inverse * edge[2],
                    )
                    push_camera_point(systems, costs, s, (x, y, z), (gx, gy, gz), targets[group] - g)
