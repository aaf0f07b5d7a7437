"""A planning problem as plain arrays, which every method but ours reads."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from omniservo.geometry.arrays import FloatArray
from omniservo.planning import Box, PlanningProblem, Sphere

SMALLEST_UNIT = 0.05
"""of ℓ: the least length that a constraint in metres is divided by"""


class Neutral(NamedTuple):
    """What a path must keep, in the initial camera frame; kernels take it as it is.

    A camera point is c = R(w)ᵀ(h − t(w)).
    """

    points: FloatArray
    """target points h (n, 3) [m]"""
    limits: FloatArray
    """image limits (k, 4): unit n and κ of n·c ≤ κ‖c‖, moved inward by the visibility margin"""
    disc: FloatArray
    """dead zone (7,): fx, skew, fy, cu − u₀, cv − v₀, radius with margin [px], ξ; (0,) where there is none.
    With D = c_z + ξ‖c‖ and (U, V) = (fx c_x + skew c_y + (cu − u₀) D, fy c_y + (cv − v₀) D) a point is
    outside where ‖(U, V)‖ ≥ radius · D."""
    spheres: FloatArray
    """(m, 5): centre, radius, radius + clearance [m]; radius 0 hides nothing"""
    boxes: FloatArray
    """(b, 16): centre, unit axes a₁ a₂ a₃ row by row, half extents, clearance [m]; they hide nothing"""
    quaternion: FloatArray
    """φ(1) (4,), (x, y, z, w), unit, w ≥ 0; φ(0) is the identity"""
    translation: FloatArray
    """t(1) (3,) [m]; t(0) = 0"""
    least_distance: float
    """camera centre to every target point [m]"""
    occlusion: bool
    """spheres must not hide target points"""
    ell: float
    """ℓ, the mean distance of the target points from the origin [m]: the unit of length"""
    sigma: int
    """highest degree of φ"""
    tau: int
    """highest degree of t"""


def neutral_of(problem: PlanningProblem) -> Neutral:
    """Return the arrays of a problem with spheres and boxes.

    Raises:
        ValueError: the problem has what the benchmark's peers cannot take.
    """
    camera = problem.camera
    if problem.workspace is not None or camera.is_distorted or camera.mask:
        raise ValueError("no peer takes a workspace, a mask or a distorted camera")
    if not all(isinstance(o, Sphere | Box) for o in problem.obstacles):
        raise ValueError("peers take spheres and boxes only")
    boxes = [o for o in problem.obstacles if isinstance(o, Box)]
    if problem.occlusion and boxes:
        raise ValueError("no peer knows boxes that hide target points")
    limits = problem.camera.image_limits(problem.visibility_margin)
    lengths = np.linalg.norm(limits.normals, axis=1, keepdims=True)
    return Neutral(
        points=np.array(problem.points, order="C"),
        limits=np.ascontiguousarray(np.column_stack([limits.normals, limits.kappas]) / lengths),
        disc=_disc(problem),
        spheres=_spheres(problem),
        boxes=_rows([_box_row(o, _clearance(problem, o)) for o in boxes], 16),
        quaternion=np.array(problem.goal_quaternion),
        translation=np.array(problem.goal_translation),
        least_distance=problem.least_distance,
        occlusion=bool(problem.occlusion),
        ell=float(np.linalg.norm(problem.points, axis=1).mean()),
        sigma=problem.degrees.rotation,
        tau=problem.degrees.translation,
    )


def _disc(problem: PlanningProblem) -> FloatArray:
    camera, zone = problem.camera, problem.camera.dead_zone
    if zone is None:
        return np.zeros(0)
    (u, v), radius = zone.center, zone.radius + problem.visibility_margin
    return np.array([camera.fx, camera.skew, camera.fy, camera.cx - u, camera.cy - v, radius, camera.xi])


def _spheres(problem: PlanningProblem) -> FloatArray:
    spheres = [o for o in problem.obstacles if isinstance(o, Sphere)]
    return _rows([[*o.center, o.radius, o.radius + _clearance(problem, o)] for o in spheres], 5)


def _box_row(box: Box, clearance: float) -> list[float]:
    axes = Rotation.from_quat(box.quaternion).as_matrix().T
    return [*box.center, *axes.ravel(), *box.half_extents, clearance]


def _clearance(problem: PlanningProblem, obstacle: Sphere | Box) -> float:
    return problem.clearance if obstacle.clearance is None else obstacle.clearance


def _rows(rows: list[list[float]], size: int) -> FloatArray:
    return np.array(rows, dtype=np.float64).reshape(-1, size)
