"""Kinds of constraints that have a margin: an entry is a row (kind, index, scale, …) of floats."""

EDGE, CIRCLE, DOMAIN, DISC, MASK, LEAST, SIGHT, BODY_SIGHT, CLOUD_SIGHT = range(9)
"""Kinds of entries about a target point."""

CLEARANCE, WALL, ROTATION, FREE_SIDE, BODY, CLOUD = range(9, 15)
"""Kinds that are not. Index: the limit, wall, or obstacle among its kind; of a MASK its polygon.

Scale: px of one unit of an EDGE's limit at Z + ξρ = 1."""

ENTRY_KIND, ENTRY_INDEX, ENTRY_SCALE, ENTRY_STEP = range(4)
"""The places of an entry."""

XI, CIRCLE_RADIUS, PX_PER_UNIT, MARGIN_PX, DOMAIN_ANGLE = range(5)
"""The places of ``optics``: ξ; the circle's radius on the plane m̄ before any margin; the least singular value
of K's 2×2 block [px]; the visibility margin [px]; the domain's angle [rad]."""
