"""Pixels without division: sums a + bρ of two polynomials, where ρ = √q is the point's distance."""

from fractions import Fraction

from omniservo.verification.camera_path import CameraPoint
from omniservo.verification.fields import Vector
from omniservo.verification.plan_file import Camera
from omniservo.verification.polynomials import Polynomial, combine, integers, times

RootSum = tuple[Polynomial, Polynomial]
"""(a, b) stands for a + bρ"""


def combine_sums(*terms: tuple[int, RootSum]) -> RootSum:
    """Return Σ kᵢ (aᵢ + bᵢρ)."""
    return combine(*((k, s[0]) for k, s in terms)), combine(*((k, s[1]) for k, s in terms))


def times_sums(s: RootSum, t: RootSum, q: Polynomial) -> RootSum:
    """Return (a + bρ)(c + dρ) = ac + bdq + (ad + bc)ρ."""
    (a, b), (c, d) = s, t
    constant = times(a, c)
    if any(b) and any(d):
        constant = combine((1, constant), (1, times(times(b, d), q)))
    return constant, combine((1, times(a, d)), (1, times(b, c)))


def distorted(point: CameraPoint, camera: Camera) -> tuple[RootSum, RootSum, RootSum]:
    """Return (x, y, d), the distorted point (x/d, y/d) of the normalised plane; d > 0 inside the domain."""
    xi, one = camera.xi.numerator, camera.xi.denominator
    x, y = (([one * a for a in p], [0]) for p in (point.x, point.y))
    d = ([one * a for a in point.z], [xi])
    return distort(x, y, d, point.q, camera.distortion) if any(camera.distortion) else (x, y, d)


def distort(
    x: RootSum, y: RootSum, d: RootSum, q: Polynomial, coefficients: Vector
) -> tuple[RootSum, RootSum, RootSum]:
    """Return what (x/d, y/d) is distorted to, in the same form, all up to one positive factor.

    With s = x² + y² and r = d⁴ + k₁sd² + k₂s²:
    xr + (2p₁xy + p₂(s + 2x²))d³,  yr + (p₁(s + 2y²) + 2p₂xy)d³,  d⁵.
    """
    unit, k1, k2, p1, p2 = integers(Fraction(1), *coefficients)
    xx, yy, xy = times_sums(x, x, q), times_sums(y, y, q), times_sums(x, y, q)
    s = combine_sums((1, xx), (1, yy))
    dd = times_sums(d, d, q)
    cube, fourth = times_sums(dd, d, q), times_sums(dd, dd, q)
    radial = combine_sums((unit, fourth), (k1, times_sums(s, dd, q)), (k2, times_sums(s, s, q)))
    tangential_x = combine_sums((2 * p1, xy), (p2, s), (2 * p2, xx))
    tangential_y = combine_sums((p1, s), (2 * p1, yy), (2 * p2, xy))
    along_x, along_y = (
        combine_sums((1, times_sums(c, radial, q)), (1, times_sums(t, cube, q)))
        for c, t in ((x, tangential_x), (y, tangential_y))
    )
    return along_x, along_y, combine_sums((unit, times_sums(fourth, d, q)))


def pixel(point: CameraPoint, camera: Camera, w: Fraction) -> tuple[float, float] | None:
    """Return (u, v) at w in floating point, for messages only; None where the formula has no value."""
    x, y, z, rho = point.coordinates(w)
    d = z + float(camera.xi) * rho
    if d <= 0:
        return None
    x, y = x / d, y / d
    k1, k2, p1, p2 = map(float, camera.distortion)
    s = x * x + y * y
    radial = 1 + k1 * s + k2 * s * s
    x, y = (
        x * radial + 2 * p1 * x * y + p2 * (s + 2 * x * x),
        y * radial + p1 * (s + 2 * y * y) + 2 * p2 * x * y,
    )
    return (
        float(camera.fx) * x + float(camera.skew) * y + float(camera.cx),
        float(camera.fy) * y + float(camera.cy),
    )
