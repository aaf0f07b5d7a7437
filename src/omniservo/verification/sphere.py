"""A ball, and a camera or a line of sight that stays out of it: signs of polynomials."""

from collections.abc import Sequence
from fractions import Fraction
from math import sqrt

from omniservo.verification.decision import Finding, decide, nonnegative
from omniservo.verification.fields import Vector
from omniservo.verification.motion import Relative
from omniservo.verification.polynomials import combine, minus, squares, times


def far_from_ball(seen: Relative, center: Vector, radius: Fraction) -> Finding:
    """Decide ‖t − m − o‖² ≥ radius²."""
    return nonnegative(minus(squares(*seen.camera_from(center)), (radius * seen.scale) ** 2))


def sight_clear_of_ball(seen: Relative, center: Vector, radius: Fraction) -> Finding:
    """Decide ‖p + λ(q − p)‖ ≥ R for λ in [0, 1], with p = t − m − o, q = h − m − o.

    That is a(1−λ)² + 2bλ(1−λ) + cλ² ≥ 0 with a = ‖p‖² − R², b = p·q − R², c = ‖q‖² − R², which holds
    for all λ exactly where a ≥ 0 and c ≥ 0 and (b ≥ 0 or ac ≥ b²).
    """
    bound = (radius * seen.scale) ** 2
    p, q = seen.camera_from(center), seen.target_from(center)
    a, c = minus(squares(*p), bound), minus(squares(*q), bound)
    b = minus(combine(*((1, times(x, y)) for x, y in zip(p, q, strict=True))), bound)
    return decide([a, b, c, combine((1, times(a, c)), (-1, squares(b)))], [(0, 2, 1), (0, 2, 3)])


def to_sight(start: Sequence[float], end: Sequence[float], center: Sequence[float]) -> float:
    """Return the distance of a centre from the segment, in floating point."""
    t = [x - o for x, o in zip(start, center, strict=True)]
    along = [x - y for x, y in zip(end, start, strict=True)]
    length = sum(x * x for x in along)
    share = -sum(x * y for x, y in zip(t, along, strict=True)) / length if length > 0 else 0.0
    share = min(1.0, max(0.0, share))
    apart = [x + share * y for x, y in zip(t, along, strict=True)]
    return sqrt(sum(x * x for x in apart))
