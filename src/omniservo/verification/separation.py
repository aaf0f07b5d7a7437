"""Boxes and capsules: the separating planes that the plan states are checked, piece by piece.

On [from, to] the path lies in the hull of its control points there. If n·T ≥ s(n) + d‖n‖ for each of them,
s(n) the greatest n·x over the body's core, the camera centre keeps the distance d from the core; if
n·h ≥ s(n) + d‖n‖ as well, so does every line of sight to h. The n·T − bound are Bernstein coefficients.
"""

from collections.abc import Callable
from fractions import Fraction

from omniservo.verification.bodies import Body, dot
from omniservo.verification.camera_path import CameraPath, CameraPoint
from omniservo.verification.constraint import Constraint
from omniservo.verification.decision import HOLDS, Finding
from omniservo.verification.enclosures import root_above, root_below
from omniservo.verification.fields import Vector
from omniservo.verification.plan_file import Piece, Separators
from omniservo.verification.polynomials import bernstein, combine, integers, on_piece

_LOOKS, _HALVINGS = 16, 60


def body_clearance(index: int, body: Body, separators: Separators) -> Constraint[CameraPath]:
    """The camera centre keeps radius + clearance + margin from the core."""
    name = f"clearance obstacle {index}"
    asked = body.radius + body.clearance

    def left(path: CameraPath, w: Fraction) -> float:
        return body.from_core([float(x) for x in path.position(w)])[0] - float(asked)

    def judge(margin: Fraction, path: CameraPath) -> Finding:
        def short(w: Fraction) -> bool:
            return body.nearer(path.position(w), asked + margin)

        return _judged(body, path, None, asked + margin, separators.get((name, None)), short)

    return Constraint(name, "m", lambda m: lambda path: judge(m, path), left)


def body_occlusion(index: int, body: Body, separators: Separators) -> Constraint[CameraPoint]:
    """Every line of sight keeps radius + margin from the core."""
    name = f"occlusion obstacle {index}"

    def left(point: CameraPoint, w: Fraction) -> float:
        return body.from_core(_nearest(body, point, w)[0])[0] - float(body.radius)

    def judge(margin: Fraction, point: CameraPoint) -> Finding:
        def short(w: Fraction) -> bool:
            share, t = Fraction(_nearest(body, point, w)[1]), point.path.position(w)
            x = tuple(a + share * (b - a) for a, b in zip(t, point.point, strict=True))
            return body.nearer(x, body.radius + margin)

        pieces = separators.get((name, point.index))
        return _judged(body, point.path, point.point, body.radius + margin, pieces, short)

    return Constraint(name, "m", lambda m: lambda point: judge(m, point), left)


def _judged(
    body: Body,
    path: CameraPath,
    end: Vector | None,
    distance: Fraction,
    pieces: tuple[Piece, ...] | None,
    short: Callable[[Fraction], bool],
) -> Finding:
    """Check the planes; where they prove nothing, look for a w that is ``short`` of the distance."""
    gap = _uncovered(pieces) if pieces is not None else None
    failed = next((p for p in pieces or () if not _separates(p, body, path, end, distance)), None)
    if pieces is not None and gap is None and failed is None:
        return HOLDS
    if len(path.translation[0]) == 1:
        return _judged_pose(body, path, end, distance, short(Fraction(0)))
    looks = [Fraction(k, _LOOKS) for k in range(_LOOKS + 1)]
    looks += [w for piece in (failed,) if piece is not None for w in (piece.start, piece.end)]
    w = next((w for w in looks if 0 <= w <= 1 and short(w)), None)
    if w is not None:
        return Finding("violated", w)
    if pieces is None:
        return Finding("undecided", Fraction(0))
    if gap is not None:
        return Finding("violated", gap, f"certificate.separators: no plane at w = {float(gap):.9g}")
    where = "" if failed is None else f"[{float(failed.start):.9g}, {float(failed.end):.9g}]"
    note = f"certificate.separators: the plane on {where} does not separate"
    return Finding("violated", None if failed is None else failed.start, note)


def _judged_pose(
    body: Body, path: CameraPath, end: Vector | None, distance: Fraction, short: bool
) -> Finding:
    """A path of degree 0 needs one plane, which is found here."""
    if short:
        return Finding("violated", Fraction(0))
    t = path.position(Fraction(0))
    x = [float(a) for a in t] if end is None else _lowest(body, t, end)[0]
    piece = Piece(Fraction(0), Fraction(1), tuple(map(Fraction, body.from_core(x)[1])))
    return HOLDS if _separates(piece, body, path, end, distance) else Finding("undecided", Fraction(0))


def _uncovered(pieces: tuple[Piece, ...]) -> Fraction | None:
    """Return where the pieces, in their order, leave a gap in [0, 1]."""
    reached = Fraction(0)
    for piece in pieces:
        if piece.start != reached or piece.end <= reached:
            return reached
        reached = piece.end
    return None if reached == 1 else min(reached, Fraction(1))


def _separates(piece: Piece, body: Body, path: CameraPath, end: Vector | None, distance: Fraction) -> bool:
    """n·T ≥ s(n) + distance‖n‖ for all control points of the piece, and for the other end of the sight."""
    n = piece.normal
    squared = dot(n, n)
    if squared == 0:
        return False
    bound = body.support(n) + distance * (root_above(squared) if distance > 0 else root_below(squared))
    if end is not None and dot(n, end) < bound:
        return False
    *normal, least = integers(*n, bound * path.scale)
    along = combine(*zip(normal, path.translation, strict=True), (-least, [1]))
    return min(bernstein(on_piece(along, piece.start, piece.end))) >= 0


def _nearest(body: Body, point: CameraPoint, w: Fraction) -> tuple[list[float], float]:
    return _lowest(body, point.path.position(w), point.point)


def _lowest(body: Body, t: Vector, h: Vector) -> tuple[list[float], float]:
    """Return the point of the sight nearest to the core, and its share; the distance along it is convex."""
    start, along = [float(a) for a in t], [float(b - a) for a, b in zip(t, h, strict=True)]

    def at(share: float) -> list[float]:
        return [a + share * b for a, b in zip(start, along, strict=True)]

    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        third = (high - low) / 3
        if body.from_core(at(low + third))[0] <= body.from_core(at(high - third))[0]:
            high -= third
        else:
            low += third
    share = min((low, high, (low + high) / 2), key=lambda s: body.from_core(at(s))[0])
    return at(share), share
