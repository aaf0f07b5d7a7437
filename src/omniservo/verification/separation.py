"""Boxes, capsules and meshes: the separating planes that the plan states are checked, piece by piece.

On [from, to] the path lies in the hull of its control points there. If n·T ≥ s(n) + d‖n‖ for each of them,
s(n) the greatest n·x over the body's core, the camera centre keeps the distance d from the core; if
n·h ≥ s(n) + d‖n‖ as well, so does every line of sight to h. The n·T − bound are Bernstein coefficients.
For a body that moves by m(w), t − m and h − m take the places of t and h.
"""

from fractions import Fraction

from omniservo.verification.bodies import Body, dot
from omniservo.verification.camera_path import CameraPath, CameraPoint
from omniservo.verification.constraint import Constraint
from omniservo.verification.decision import HOLDS, Finding
from omniservo.verification.enclosures import root_above, root_below
from omniservo.verification.fields import BEYOND_FLOATS, Vector
from omniservo.verification.motion import Relative, relative
from omniservo.verification.plan_file import Piece, Separators
from omniservo.verification.polynomials import bernstein, combine, integers, on_piece
from omniservo.verification.work import spend_on_fractions

_LOOKS = 16


def body_clearance(index: int, body: Body, separators: Separators) -> Constraint[CameraPath]:
    """The camera centre keeps radius + clearance + margin from the core."""
    name = f"clearance obstacle {index}"
    asked = body.radius + body.clearance

    def left(path: CameraPath, w: Fraction) -> float:
        at = relative(path, body.motion).camera_at(w)
        return body.from_core([float(x) for x in at])[0] - float(asked)

    def judge(margin: Fraction, path: CameraPath) -> Finding:
        return _judged(body, relative(path, body.motion), asked + margin, separators.get((name, None)))

    return Constraint(name, "m", lambda m: lambda path: judge(m, path), left)


def body_occlusion(index: int, body: Body, separators: Separators) -> Constraint[CameraPoint]:
    """Every line of sight keeps radius + margin from the core."""
    name = f"occlusion obstacle {index}"

    def left(point: CameraPoint, w: Fraction) -> float:
        seen = relative(point.path, body.motion, target=point.point)
        at = [float(x) for x in _nearest(body, seen, w)]
        return body.from_core(at)[0] - float(body.radius)

    def judge(margin: Fraction, point: CameraPoint) -> Finding:
        seen = relative(point.path, body.motion, target=point.point)
        return _judged(body, seen, body.radius + margin, separators.get((name, point.index)))

    return Constraint(name, "m", lambda m: lambda point: judge(m, point), left)


def _judged(body: Body, seen: Relative, distance: Fraction, pieces: tuple[Piece, ...] | None) -> Finding:
    """Check the planes; where they prove nothing, look for a w that is short of the distance."""
    gap = _uncovered(pieces) if pieces is not None else None
    failed = next((p for p in pieces or () if not _separates(p, body, seen, distance)), None)
    if pieces is not None and gap is None and failed is None:
        return HOLDS
    if all(len(p) == 1 for p in seen.camera + seen.target):
        return _judged_pose(body, seen, distance)
    looks = [Fraction(k, _LOOKS) for k in range(_LOOKS + 1)]
    looks += [w for piece in (failed,) if piece is not None for w in (piece.start, piece.end)]
    w = next((w for w in looks if 0 <= w <= 1 and _short(body, seen, distance, w)), None)
    if w is not None:
        return Finding("violated", w)
    if pieces is None:
        return Finding("undecided", Fraction(0))
    if gap is not None:
        return Finding("violated", gap, f"certificate.separators: no plane at w = {float(gap):.9g}")
    where = "" if failed is None else f"[{float(failed.start):.9g}, {float(failed.end):.9g}]"
    note = f"certificate.separators: the plane on {where} does not separate"
    return Finding("violated", None if failed is None else failed.start, note)


def _judged_pose(body: Body, seen: Relative, distance: Fraction) -> Finding:
    """A path of degree 0 needs one plane, which is found here."""
    start = Fraction(0)
    if _short(body, seen, distance, start):
        return Finding("violated", start)
    try:
        at = [float(x) for x in _nearest(body, seen, start)]
        piece = Piece(start, Fraction(1), tuple(map(Fraction, body.from_core(at)[1])))
    except BEYOND_FLOATS:
        return Finding("undecided", start)
    return HOLDS if _separates(piece, body, seen, distance) else Finding("undecided", start)


def _uncovered(pieces: tuple[Piece, ...]) -> Fraction | None:
    """Return where the pieces, in their order, leave a gap in [0, 1]."""
    reached = Fraction(0)
    for piece in pieces:
        if piece.start != reached or piece.end <= reached:
            return reached
        reached = piece.end
    return None if reached == 1 else min(reached, Fraction(1))


def _separates(piece: Piece, body: Body, seen: Relative, distance: Fraction) -> bool:
    """n·T ≥ s(n) + distance‖n‖ for all control points of the piece, and of the sight's other end there."""
    n = piece.normal
    squared = dot(n, n)
    if squared == 0:
        return False
    bound = body.support(n) + distance * (root_above(squared) if distance > 0 else root_below(squared))
    spend_on_fractions(40, bound, *n)
    *normal, least = integers(*n, bound * seen.scale)
    for end in (seen.camera, seen.target):
        along = combine(*zip(normal, end, strict=True), (-least, [1])) if end else [0]
        if min(bernstein(on_piece(along, piece.start, piece.end))) < 0:
            return False
    return True


def _nearest(body: Body, seen: Relative, w: Fraction) -> Vector:
    """Return a point at w near where the camera centre, or the line of sight, is nearest to the core."""
    t = seen.camera_at(w)
    if not seen.target:
        return t
    h = seen.target_at(w)
    share = body.share_of([float(x) for x in t], [float(x) for x in h])
    return tuple(a + Fraction(share) * (b - a) for a, b in zip(t, h, strict=True))


def _short(body: Body, seen: Relative, distance: Fraction, w: Fraction) -> bool:
    """True where a point of the sight at w shows that it is nearer than the distance."""
    try:
        at = _nearest(body, seen, w)
        spend_on_fractions(40, *at)
        return body.nearer(at, distance)
    except BEYOND_FLOATS:
        return False
