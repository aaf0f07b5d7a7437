"""Other parameters with nearly the same pixels: what the images cannot tell apart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from omniservo.calibration.adjustment.lens import ALPHA, LARGEST_ALPHA, project, project_jacobian, to_physical
from omniservo.geometry.arrays import BoolArray, FloatArray

SAME_PX = 0.1
"""two cameras are equivalent when their pixels differ by less, root mean square over the field [px]"""

_STEPS = (0.0005, 0.001, 0.0025, 0.005, 0.01, 0.02, 0.04, 0.08, 0.16, 0.32)
"""in α = ξ/(1+ξ)"""

_ITERATIONS = 12


@dataclass(frozen=True)
class Equivalent:
    """A camera with another ξ whose pixels, over the field that the corners cover, are nearly the same."""

    xi: float
    fx: float
    """[px]"""
    fy: float
    """[px]"""
    k1: float
    k2: float
    rms_px: float
    """root mean square difference of the pixels over the field [px]"""
    largest_px: float
    """[px]"""


def equivalents(theta: FloatArray, free: BoolArray, rays: FloatArray) -> tuple[Equivalent, ...]:
    """Return cameras with other ξ within `SAME_PX` of θ over ``rays`` (n, 3), by ξ; θ's own among them."""
    found = [_described(theta, np.zeros(len(rays)))]
    for sign in (-1.0, 1.0):
        start = theta
        for step in _STEPS:
            alpha = theta[ALPHA] + sign * step
            if not 0.0 <= alpha <= LARGEST_ALPHA:
                break
            start, differences = same_pixels(theta, start, alpha, free, rays)
            entry = _described(start, differences)
            if not entry.rms_px < SAME_PX:
                break
            found.append(entry)
    return tuple(sorted(found, key=lambda entry: entry.xi))


def same_pixels(
    theta: FloatArray, start: FloatArray, alpha: float, free: BoolArray, rays: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the camera with this α and nearly θ's pixels of ``rays``, and how far they are off (n,) [px].

    All other free parameters and a rotation of the rays (which poses would absorb) are adjusted by
    Levenberg–Marquardt.
    """
    wanted, _ = project(theta, rays)
    others = np.array(free)
    others[ALPHA] = False
    count = int(others.sum())
    now, turn, damping = np.array(start), np.eye(3), 1e-6
    now[ALPHA] = alpha
    error = _difference(now, turn, rays, wanted)
    for _ in range(_ITERATIONS):
        turned = rays @ turn.T
        _, by_theta, by_point, _ = project_jacobian(now, turned)
        J = np.concatenate([by_theta[:, :, others], np.cross(turned[:, None, :], by_point)], 2)
        J = J.reshape(-1, count + 3)
        size = np.sqrt((J * J).sum(0)) + 1e-300
        H = (J / size).T @ (J / size) + damping * np.eye(count + 3)
        step = -np.linalg.solve(H, (J / size).T @ error.ravel()) / size
        moved = np.array(now)
        moved[others] += step[:count]
        tilted = Rotation.from_rotvec(step[count:]).as_matrix() @ turn
        new = _difference(moved, tilted, rays, wanted)
        if (new**2).sum() < (error**2).sum():
            now, turn, error, damping = moved, tilted, new, damping * 0.1
        else:
            damping *= 100.0
    return now, np.hypot(error[:, 0], error[:, 1])


def _difference(theta: FloatArray, turn: FloatArray, rays: FloatArray, wanted: FloatArray) -> FloatArray:
    pixels, ok = project(theta, rays @ turn.T)
    return np.asarray(np.where(ok[:, None], pixels - wanted, 1e6))


def _described(theta: FloatArray, differences: FloatArray) -> Equivalent:
    fx, fy, _, _, xi, k1, k2, *_ = (float(x) for x in to_physical(theta))
    rms = float(np.sqrt((differences**2).mean()))
    return Equivalent(xi, fx, fy, k1, k2, rms, float(differences.max(initial=0.0)))
