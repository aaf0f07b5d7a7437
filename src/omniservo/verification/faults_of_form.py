"""The path's form: start at the identity, with the velocity required; end at the goal; degrees allowed."""

from fractions import Fraction
from math import asin

from omniservo.verification.camera_path import CameraPath
from omniservo.verification.fields import Vector, root
from omniservo.verification.plan_file import Problem

_NEAR = Fraction(1, 10**9)
IDENTITY: Vector = (Fraction(0), Fraction(0), Fraction(0), Fraction(1))
ORIGIN: Vector = (Fraction(0), Fraction(0), Fraction(0))


def faults_of_form(path: CameraPath, problem: Problem) -> list[str]:
    """Return what is wrong with the path's ends and degrees, one line each."""
    faults = []
    for what, rows, allowed in zip(
        ("rotation", "translation"), (path.rotation, path.translation), problem.degrees, strict=True
    ):
        if len(rows[0]) - 1 > allowed:
            faults.append(f"path.{what}: degree {len(rows[0]) - 1}; the problem allows {allowed}")
    goal = problem.goal_translation, problem.goal_quaternion
    for w, name, (translation, quaternion) in ((0, "start", (ORIGIN, IDENTITY)), (1, "end", goal)):
        apart = _squared([a - b for a, b in zip(path.position(Fraction(w)), translation, strict=True)])
        if apart > _NEAR**2:
            faults.append(f"path {name} (w = {w}): {root(apart):.6g} m from where it must be; legal: 1e-9")
        turned = _half_angle_sine_squared(path.quaternion(Fraction(w)), quaternion)
        if turned > (_NEAR / 2) ** 2:
            angle = 2 * asin(min(1.0, root(turned)))
            faults.append(
                f"path {name} (w = {w}): turned by {angle:.6g} rad from where it must be; legal: 1e-9"
            )
    return faults + _faults_of_velocity(path, problem.initial_velocity)


def _faults_of_velocity(path: CameraPath, asked: Vector | None) -> list[str]:
    """t′(0) is the linear and 2 vec(φ* ⊗ φ′)/‖φ‖² at 0 the angular velocity required."""
    if asked is None:
        return []
    linear = [Fraction(p[1], path.scale) if len(p) > 1 else Fraction(0) for p in path.translation]
    x, y, z, s = (p[0] for p in path.rotation)
    dx, dy, dz, ds = (p[1] if len(p) > 1 else 0 for p in path.rotation)
    squared = x * x + y * y + z * z + s * s
    if squared == 0:
        return ["path start (w = 0): the quaternion is 0, it has no velocity"]
    turned = (
        s * dx - ds * x - (y * dz - z * dy),
        s * dy - ds * y - (z * dx - x * dz),
        s * dz - ds * z - (x * dy - y * dx),
    )
    faults = []
    angular = [Fraction(2 * a, squared) for a in turned]
    pairs = ("linear", "m", linear, asked[:3]), ("angular", "rad", angular, asked[3:])
    for what, unit, found, wanted in pairs:
        apart = _squared([a - b for a, b in zip(found, wanted, strict=True)])
        if apart > _NEAR**2:
            by = f"{what} velocity {root(apart):.6g} {unit} from initial_velocity"
            faults.append(f"path start (w = 0): {by}; legal: 1e-9")
    return faults


def _half_angle_sine_squared(p: Vector, q: Vector) -> Fraction:
    """Return sin²(θ/2) = 1 − (p·q)²/(‖p‖²‖q‖²), θ between the rotations; length and sign do not matter."""
    lengths = _squared(p) * _squared(q)
    return 1 - sum(a * b for a, b in zip(p, q, strict=True)) ** 2 / lengths if lengths else Fraction(1)


def _squared(vector: Vector | list[Fraction]) -> Fraction:
    return sum((x * x for x in vector), Fraction(0))
