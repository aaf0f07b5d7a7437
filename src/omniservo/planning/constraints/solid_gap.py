"""Bodies of every shape: how far a segment is from their core, and the core's support.

A body is a row (25,), see `body_gap`. That of a mesh has centre 0, the greatest |coordinates| of its vertices
for half extents, no radius, and behind its motion where its vertices, faces and edges begin and end in the
joined arrays of all meshes. Boxes are no meshes: their own gap takes a tenth of the time.
"""

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel, leaf
from omniservo.planning.constraints.body_gap import (
    CORNERS,
    CUBOID,
    EDGES,
    EXTENT,
    FACES,
    HULL,
    SHAPE,
    in_body_frame,
    segment_gap,
)
from omniservo.planning.constraints.hull_gap import Hull, hull_gap, support
from omniservo.planning.constraints.round_gap import round_gap, round_support


@kernel
def hull_of(body: FloatArray, hulls: Hull) -> Hull:
    """Return the part of the joined arrays that is this body's; without vertices where it is no mesh."""
    return Hull(
        hulls.corners[int(body[CORNERS]) : int(body[CORNERS + 1])],
        hulls.faces[int(body[FACES]) : int(body[FACES + 1])],
        hulls.edges[int(body[EDGES]) : int(body[EDGES + 1])],
    )


@leaf
def solid_gap(
    body: FloatArray, hull: Hull, tx: float, ty: float, tz: float, hx: float, hy: float, hz: float
) -> tuple[float, float, float, float, float]:
    """Return (unit direction n, gap, s) from the core to the segment from t to h: see `segment_gap`."""
    if body[SHAPE] == CUBOID:
        return segment_gap(body, tx, ty, tz, hx, hy, hz)
    if body[SHAPE] == HULL:
        return hull_gap(hull, (tx, ty, tz), (hx, hy, hz))
    return round_gap(body, tx, ty, tz, hx, hy, hz)


@leaf
def core_support(body: FloatArray, hull: Hull, nx: float, ny: float, nz: float) -> float:
    """Return the greatest n·(x − c) over the core, c the row's centre."""
    if body[SHAPE] == HULL:
        return support(hull.corners, nx, ny, nz)[0]
    a, b, c = in_body_frame(body, nx, ny, nz)
    if body[SHAPE] != CUBOID:
        return round_support(body, a, b, c)
    return float(body[EXTENT] * abs(a) + body[EXTENT + 1] * abs(b) + body[EXTENT + 2] * abs(c))
