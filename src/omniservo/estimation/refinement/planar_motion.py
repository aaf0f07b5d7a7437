"""Motion before a plane: what a homography of bearings holds, and its refinement on pixels.

Points on the plane m·h* = 1 of the goal frame obey h = (R + t mᵀ) h*, so b ∝ G b* with G ∝ R + t mᵀ. Ma,
Soatto, Košecká, Sastry, "An invitation to 3-D vision", 2004, section 5.3.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from omniservo.cameras.unified_kernels import project_points_jacobian
from omniservo.estimation.matches import Matches
from omniservo.geometry.arrays import FloatArray

UNKNOWNS = 8
"""δ, two of t (‖t‖ = 1), m."""

MOST_STEPS = 30
SMALL_GAIN = 1e-12


class PlanarMotion(NamedTuple):
    """{R, t} with ‖t‖ = 1 and the plane."""

    rotation: FloatArray
    """(3, 3) R of initial_T_goal"""
    translation: FloatArray
    """(3,) of length 1"""
    normal: FloatArray
    """m (3,): the plane's normal over its distance, goal frame, over lengths of t"""

    def points(self, rays: FloatArray) -> FloatArray:
        """Return the points (n, 3), initial frame, in lengths of t, on goal rays (n, 3)."""
        return np.asarray((rays @ self.rotation.T) / (rays @ self.normal)[:, None] + self.translation)


class PlanarBlocks(NamedTuple):
    """Weighted residuals of all matches and their derivatives to the motion and to the goal rays."""

    residuals: FloatArray
    """(n, 4) [px]"""
    to_motion: FloatArray
    """(n, 4, 8), to (δ, τ, dm)"""
    to_ray: FloatArray
    """(n, 4, 2), to a ray's step in its tangent plane"""
    tangents: FloatArray
    """(n, 3, 2) that plane"""
    across: FloatArray
    """(3, 2) the tangent plane of t: dt = across τ"""

    @property
    def cost(self) -> float:
        """Σr² [px²]."""
        return float((self.residuals**2).sum())

    def eliminated(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return V⁻¹ (n, 2, 2) of the rays, K = V⁻¹Wᵀ (n, 2, 8) and the reduced normal matrix (8, 8)."""
        turned = np.swapaxes(self.to_motion, 1, 2)
        inverse = np.linalg.inv(np.swapaxes(self.to_ray, 1, 2) @ self.to_ray)
        follow = inverse @ np.swapaxes(turned @ self.to_ray, 1, 2)
        reduced = (turned @ (self.to_motion - self.to_ray @ follow)).sum(axis=0)
        return np.asarray(inverse), np.asarray(follow), np.asarray(reduced)


def decompose_homography(matrix: FloatArray, rays: FloatArray) -> list[PlanarMotion]:
    """Return the motions, at most two, with all goal rays (n, 3) meeting the plane in front of both cameras.

    ``matrix`` maps goal bearings to positive multiples of initial ones. With a determinant that is not
    positive the cameras would stand on both sides of the plane; equal singular values hold no translation.
    """
    h = matrix / np.linalg.svd(matrix, compute_uv=False)[1]
    values, vectors = np.linalg.eigh(h.T @ h)
    if np.linalg.det(h) <= 0.0 or values[2] - values[0] < 1e-12:
        return []
    least, middle, most = vectors[:, 0], vectors[:, 1], vectors[:, 2]
    low, high = np.sqrt(max(1.0 - values[0], 0.0)), np.sqrt(max(values[2] - 1.0, 0.0))
    found = []
    for sign in (1.0, -1.0):
        u = (low * most + sign * high * least) / np.sqrt(values[2] - values[0])
        frame = np.column_stack((middle, u, np.cross(middle, u)))
        image = np.column_stack((h @ middle, h @ u, np.cross(h @ middle, h @ u)))
        rotation, normal = image @ frame.T, frame[:, 2]
        step = (h - rotation) @ normal
        length = float(np.linalg.norm(step))
        facing = np.sign(rays @ normal)
        if length > 0.0 and abs(facing.sum()) == len(rays):
            found.append(PlanarMotion(rotation, facing[0] * step / length, facing[0] * length * normal))
    return found


def planar_blocks(matches: Matches, motion: PlanarMotion, rays: FloatArray) -> PlanarBlocks | None:
    """Return the residuals' linearisation; None where a point leaves the camera's domain."""
    rotation, translation, normal = motion
    n, heights = len(rays), rays @ normal
    seen = np.concatenate((rays @ rotation.T + heights[:, None] * translation, rays))
    pixels, slopes, valid = np.empty((2 * n, 2)), np.empty((2 * n, 2, 3)), np.empty(2 * n, dtype=np.bool_)
    project_points_jacobian(matches.parameters, seen, pixels, slopes, valid)
    if not valid.all() or not (heights > 0.0).all():
        return None
    slopes = slopes * np.concatenate((matches.weights[:, 0], matches.weights[:, 1]))[:, None, None]
    errors = np.concatenate((pixels[:n], pixels[n:]), axis=1) - matches.pixels
    tangents, across = _tangent_planes(rays), _tangent_planes(translation[None])[0]
    initial = slopes[:n]
    to_motion = np.zeros((n, 4, UNKNOWNS))
    # d(R exp([δ]×) b*) = −R [b*]× δ, row by row b* × (Jᵢ R)
    to_motion[:, :2, :3] = np.cross(rays[:, None, :], initial @ rotation)
    to_motion[:, :2, 3:5] = heights[:, None, None] * (initial @ across)
    to_motion[:, :2, 5:] = (initial @ translation)[:, :, None] * rays[:, None, :]
    to_ray = np.empty((n, 4, 2))
    to_ray[:, :2] = initial @ (rotation + np.outer(translation, normal)) @ tangents
    to_ray[:, 2:] = slopes[n:] @ tangents
    return PlanarBlocks(errors * np.repeat(matches.weights, 2, axis=1), to_motion, to_ray, tangents, across)


def refine_planar_motion(
    matches: Matches, motion: PlanarMotion
) -> tuple[PlanarMotion, FloatArray, PlanarBlocks] | None:
    """Return the motion, goal rays (n, 3) and linearisation at the least reprojection error in both images.

    Every point is held on the plane. Gauss-Newton with halved steps; None where it finds no minimum.
    """
    rays = matches.bearings[:, 3:].copy()
    here = planar_blocks(matches, motion, rays)
    for _ in range(MOST_STEPS):
        if here is None:
            return None
        inverse, follow, reduced = here.eliminated()
        turned = np.swapaxes(here.to_ray, 1, 2) @ here.residuals[:, :, None]
        gradient = np.einsum("nij,ni->j", here.to_motion, here.residuals)
        gradient -= np.einsum("nij,nik->j", follow, turned)
        try:
            step = -np.linalg.solve(reduced, gradient)
        except np.linalg.LinAlgError:
            return None
        turns = -(inverse @ turned)[:, :, 0] - follow @ step
        gain, factor = -float(gradient @ step), 1.0
        while factor > 1e-3:
            moved = _moved(motion, here.across, factor * step)
            trial_rays = rays + factor * (here.tangents @ turns[:, :, None])[:, :, 0]
            trial_rays /= np.linalg.norm(trial_rays, axis=1, keepdims=True)
            there = planar_blocks(matches, moved, trial_rays)
            if there is not None and there.cost <= here.cost * (1.0 + 1e-12) + 1e-24:
                break
            factor *= 0.5
        else:
            return motion, rays, here
        small = here.cost - there.cost <= SMALL_GAIN * here.cost and gain <= 1e-9 * here.cost + 1e-20
        motion, rays, here = moved, trial_rays, there
        if small:
            return motion, rays, here
    return None


def _moved(motion: PlanarMotion, across: FloatArray, step: FloatArray) -> PlanarMotion:
    """Return the motion after a step (δ, τ, dm); its rotation orthonormal to rounding."""
    turn = Rotation.from_rotvec(step[:3]).as_matrix()
    translation = motion.translation + across @ step[3:5]
    length = float(np.linalg.norm(translation))
    # Only the product t mᵀ counts: what t is shortened by, m gains.
    return PlanarMotion(motion.rotation @ turn, translation / length, (motion.normal + step[5:]) * length)


def _tangent_planes(directions: FloatArray) -> FloatArray:
    """Return orthonormal bases (n, 3, 2) across unit vectors (n, 3)."""
    axes = np.eye(3)[np.argmin(np.abs(directions), axis=1)]
    first = np.cross(directions, axes)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack((first, np.cross(directions, first)), axis=2)
