"""The image's limits, moved inward: four edges as lines in pixels, the largest angle as a circle."""

from fractions import Fraction

from omniservo.verification.enclosures import ERROR, cosine_and_sine, root_above, root_below
from omniservo.verification.fields import NotJudged
from omniservo.verification.plan_file import Camera

_HALF = Fraction(1, 2)
Line = tuple[Fraction, Fraction, Fraction]


def edges(camera: Camera, inset: Fraction) -> dict[str, Line]:
    """Return (l₁, l₂, l₃) by name: l₁u + l₂v + l₃ ≥ 0 is ``inset`` px inside −½, W − ½ and −½, H − ½."""
    one, zero = Fraction(1), Fraction(0)
    return {
        "left edge": (one, zero, _HALF - inset),
        "right edge": (-one, zero, camera.width - _HALF - inset),
        "top edge": (zero, one, _HALF - inset),
        "bottom edge": (zero, -one, camera.height - _HALF - inset),
    }


def circle_radius(camera: Camera, inset: Fraction) -> Fraction | None:
    """Return a number ≤ r = sin θ/(cos θ + ξ) − inset/σ_min, σ_min the least singular value of K's 2×2 block.

    θ is at most the domain's angle; where it is that for ξ ≤ 1 there is no circle, and the answer is None.
    """
    angle, xi = camera.max_angle, camera.xi
    if angle is None:
        return None
    cosine, sine = cosine_and_sine(angle)
    if xi > 1 and cosine * xi < -1:
        radius = 1 / root_above(xi * xi - 1) - ERROR
    elif cosine + xi <= 2 * ERROR:
        return None
    else:
        radius = (sine - ERROR) / (cosine + xi + ERROR)
    below, above = least_stretch(camera)
    if below == 0:
        raise NotJudged("problem.camera: focal lengths and skew of such sizes are not judged")
    return radius - inset / (below if inset > 0 else above)


def least_stretch(camera: Camera) -> tuple[Fraction, Fraction]:
    """Return bounds of the least singular value σ of [[f_x, s], [0, f_y]] [px].

    σ² = 2f_x²f_y²/(T + √(T² − 4f_x²f_y²)) with T = f_x² + f_y² + s².
    """
    trace, product = camera.fx**2 + camera.fy**2 + camera.skew**2, (camera.fx * camera.fy) ** 2
    radicand = trace**2 - 4 * product
    below, above = 2 * product / (trace + root_above(radicand)), 2 * product / (trace + root_below(radicand))
    return root_below(below), root_above(above)
