"""What of two views' residuals is the camera's error, alike over regions, and what is left for the pixels.

To first order the matches' signed distances d (n,) from the epipolar geometry of the optimum are P(N ε), ε
(4n,) the displacements of the pixels, N their normals and P what the motion does not absorb. Of independent
noise of variance v_j along the normals and of camera errors with rows f, G = N f, follows

    E[Σd²] = tr(P V) + tr(P GᵀG P),        Var[Σd²] = 2 ‖P(V + GᵀG)P‖².
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from omniservo.estimation.matches import Matches
from omniservo.estimation.refinement.epipolar_refinement import tangent_plane
from omniservo.geometry.arrays import FloatArray

LARGEST_EXCESS = 3.1
"""[σ] by which Σd² may exceed what is stated before that is taken to be too small"""

LEAST_SHARE = 0.1
"""of the residuals' variance is noise of single pixels, where the camera's error would explain more of it"""


class PixelNoise(NamedTuple):
    """Noise that each match has for itself, beside the camera's error."""

    shares: FloatArray
    """(n, 2) its σ in either image over that of the whole, by which matches are weighted"""
    raised: float
    """by which factor stated noise and camera error are too small, since residuals contradict them: these do
    not tell which of both; 1: they do not"""


def epipolar_normals(
    members: Matches, rotation: FloatArray, translation: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return N (n, 4), unit, by pixels times their weights, and A (n, 5) = ∂d/∂motion, ‖t‖ = 1."""
    first, second = members.bearings[:, :3], members.bearings[:, 3:] @ rotation.T
    slopes = members.jacobians.reshape(-1, 2, 3, 2)
    cross = np.cross(second, first)
    by_first = np.cross(translation, second)
    by_second = np.cross(first, translation) @ rotation
    pulls = np.concatenate(
        [np.einsum("ni,nik->nk", v, slopes[:, k]) for k, v in enumerate((by_first, by_second))], axis=1
    )
    size = np.linalg.norm(pulls, axis=1, keepdims=True)
    tangents = np.empty((2, 3))
    tangent_plane(translation, tangents)
    turn = np.cross(members.bearings[:, 3:], by_second)
    return pulls / size, np.concatenate((cross @ tangents.T, turn), axis=1) / size


def pixel_noise(
    members: Matches,
    motion: tuple[FloatArray, FloatArray],
    moves: FloatArray,
    noise: FloatArray | None,
    weighted: float,
) -> PixelNoise:
    """Return what the matches' own noise is.

    Args:
        members: the matches of the fit, weighted by their whole noise.
        motion: rotation and translation at the optimum, ‖t‖ = 1.
        moves: (f, n, 4) independent errors of the camera [px].
        noise: (n, 2) stated σ of the pixels alone; None: the residuals tell it.
        weighted: Σ w²r² [px²] at the optimum.
    """
    normals, slopes = epipolar_normals(members, *motion)
    weights = np.repeat(members.weights, 2, axis=1)
    basis = np.linalg.qr(slopes)[0]
    lens = np.einsum("nc,fnc->nf", normals * weights, moves)
    lens -= basis @ (basis.T @ lens)
    of_camera, n = float(np.square(lens).sum()), members.size
    left = 1.0 - np.square(basis).sum(axis=1)
    if noise is None:
        share = math.sqrt(max(1.0 - of_camera / max(weighted, 1e-300), LEAST_SHARE))
        return PixelNoise(np.full((n, 2), share), 1.0)
    shares = noise * members.weights / members.noise_px
    alone = members.noise_px**2 * (np.square(normals.reshape(n, 2, 2)).sum(2) * shares**2).sum(1)
    expected = float(left @ alone) + of_camera
    inner = lens.T @ lens
    spread = 2.0 * (float(alone @ alone) + 2.0 * float(alone @ np.square(lens).sum(1)) + np.sum(inner**2))
    if weighted <= expected + LARGEST_EXCESS * math.sqrt(spread):
        return PixelNoise(shares, 1.0)
    raised = math.sqrt(weighted / expected)
    return PixelNoise(raised * shares, raised)
