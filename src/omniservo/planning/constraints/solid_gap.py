"""Boxes, capsules and meshes alike: how far a segment is from their core, and the core's support.

A body is a row (24,), see `body_gap`. That of a mesh has centre 0, the greatest |coordinates| of its vertices
for half extents, no radius, and behind its motion where its vertices, faces and edges begin and end in the
joined arrays of all meshes. Boxes are no meshes: their own gap takes a tenth of the time.
"""

from omniservo.geometry.arrays import FloatArray
from omniservo.geometry.kernel import kernel, leaf
from omniservo.planning.constraints.body_gap import CORNERS, EDGES, EXTENT, FACES, segment_gap
from omniservo.planning.constraints.hull_gap import Hull, hull_gap, support


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
    if hull.corners.shape[0] > 0:
        return hull_gap(hull, (tx, ty, tz), (hx, hy, hz))
    return segment_gap(body, tx, ty, tz, hx, hy, hz)


@leaf
def core_support(body: FloatArray, hull: Hull, nx: float, ny: float, nz: float) -> float:
    """Return the greatest n·(x − c) over the core, c the row's centre."""
    if hull.corners.shape[0] > 0:
        return support(hull.corners, nx, ny, nz)[0]
    total = 0.0
    for a in range(3):
        i = 3 + 3 * a
        total += body[EXTENT + a] * abs(nx * body[i] + ny * body[i + 1] + nz * body[i + 2])
    return total
