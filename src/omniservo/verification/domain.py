"""Domain: target points lie where the unified model is a camera; its rim does not belong to it."""

from fractions import Fraction
from math import acos

from omniservo.verification.camera_path import CameraPoint
from omniservo.verification.constraint import Constraint, Judge
from omniservo.verification.decision import Finding, root_sum
from omniservo.verification.enclosures import ERROR, cosine_and_sine, root_below, rounded_up
from omniservo.verification.plan_file import Problem

_FAR = Fraction(8, 5)
"""More than π/2 [rad]."""


def domain(problem: Problem) -> list[Constraint[CameraPoint]]:
    """Z > −κρ with κ = ξ (ξ ≤ 1) or 1/ξ; with a margin, Z > cos(acos(−κ) − margin) ρ."""
    xi = problem.camera.xi
    kappa = xi if xi <= 1 else 1 / xi

    def judge(margin: Fraction) -> Judge[CameraPoint]:
        cosine = _tightened(kappa, margin)
        if cosine is None:
            return lambda _: Finding("violated", Fraction(0))
        least = cosine.numerator
        return lambda p: root_sum([cosine.denominator * a for a in p.z], [-least], p.q, strict=True)

    def left(point: CameraPoint, w: Fraction) -> float:
        return acos(-float(kappa)) - acos(max(-1.0, min(1.0, point.coordinates(w)[2])))

    return [Constraint("domain", "rad", judge, left)]


def _tightened(kappa: Fraction, margin: Fraction) -> Fraction | None:
    """Return a number ≥ cos(acos(−κ) − margin), −2 where that angle exceeds π, None where it is negative."""
    if margin == 0:
        return -kappa
    if margin <= -_FAR:
        return Fraction(-2)
    if margin >= 2 * _FAR:
        return None
    cosine, sine = cosine_and_sine(margin)
    rim = root_below(1 - kappa * kappa)
    sine_of_angle = rim * cosine + kappa * sine
    if margin > 0 and sine_of_angle < 3 * ERROR:
        return None
    if margin < 0 and sine_of_angle < -3 * ERROR:
        return Fraction(-2)
    return rounded_up(rim * sine - kappa * cosine + 3 * ERROR)
