"""Do the matches come from the camera that is given, and from one rigid scene?

Images of another camera obey an epipolar geometry in parts: sampling finds a motion with which half of the
matches agree to their noise. Two things betray it.

The matches rejected are not wrong ones. A wrong match lies anywhere; two rejected side by side have Sampson
distances d of one sign, and within a factor of two of each other, with a chance of one half at most (signs
alike, sizes uniform). Of matches on surfaces that a smooth law puts off their
epipolar lines nearly all do.

The members ask for another focal length, f(1 + φ). φ is a sixth parameter of the distances d, and one step of
least squares finds it: (motion, φ) = −(JᵀJ)⁻¹Jᵀd with J = ∂d/∂(motion, φ). What the camera's own errors do
to the pixels, alike over regions, asks for one as well, and where little tells φ, as when a perspective
camera moves ahead, for far more than the matches' noise does: there nothing is said.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial import KDTree
from scipy.special import bdtrc, fdtri

from omniservo.estimation.matches import Matches
from omniservo.estimation.minimal_solvers.essential_matrix import bearings_of_pixels
from omniservo.estimation.refinement.epipolar_refinement import (
    essential_matrix,
    sampson_distance,
    sampson_distances,
    sampson_row,
    tangent_plane,
)
from omniservo.estimation.refinement.motion_search import Minimum
from omniservo.estimation.robust.members import GATE, MOTION_PARAMETERS
from omniservo.estimation.robust.two_view_fit import TwoViewFit
from omniservo.estimation.uncertainty.shared_camera_error import epipolar_normals
from omniservo.estimation.uncertainty.two_view_uncertainty import Lens, Solution
from omniservo.geometry.arrays import BoolArray, FloatArray
from omniservo.geometry.kernel import kernel
from omniservo.geometry.linear_systems import factor_cholesky, solve_factored

LARGEST_BODY = 0.05
"""of the matches may be rejected and alike: a small thing that moved by itself, the rim of a near one.
Rendered pairs of the right camera have up to 4%, real ones 5%, no more than chance brings."""

LARGEST_PATTERN = 0.2
"""likewise where the others agree to the pixels' own noise, of less than the camera's model error: another
camera's do not, but windows taken for the next ones are as many"""

LARGEST_FOCAL_ERROR = 0.03
"""A calibration is better; temperature and focus change less."""

SMALL_STEP = 1e-4
"""of φ; longer, so that every pixel stays in the camera's domain"""

UNKNOWN_FOCAL = 0.2
"""σ of φ by the camera's own errors, beyond which matches tell no focal length: 0.1 and less in most views
of a wide lens, 0.2 to 0.5 where a perspective camera drives ahead"""

CHANCE_ALIKE = 0.01
"""of so many alike among the rejected ones, which are few where the camera is the right one"""

CHANCE_FOCAL = 1e-4
"""Small: errors of natural features have longer tails than a normal law, and neighbours share some."""


def foreign_evidence(fit: TwoViewFit, matches: Matches, sigma: float, lens: Lens) -> str | None:
    """Return the evidence that the matches come from another camera, or not from one rigid scene.

    ``sigma`` is the noise of a coordinate of weight 1 [px], ``lens`` says how far the camera may be off.
    """
    is_sharp = 0.0 < matches.noise_px < lens.sigma_px
    largest = LARGEST_PATTERN if is_sharp else LARGEST_BODY
    return _other_focal(fit, matches, lens) or _alike(fit, matches, GATE * (sigma + lens.sigma_px), largest)


def _other_focal(fit: TwoViewFit, matches: Matches, lens: Lens) -> str | None:
    members, best = matches.where(fit.members), fit.minima[0]
    freedom = members.size - MOTION_PARAMETERS - 1
    if freedom < 1:
        return None
    focal, spread, cost = focal_error(members, best.rotation, best.translation)
    if abs(focal) <= LARGEST_FOCAL_ERROR or not spread < math.inf:
        return None
    deviation = spread * max(math.sqrt(cost / freedom), matches.noise_px)
    limit = float(fdtri(1, freedom, 1.0 - CHANCE_FOCAL)) * deviation**2
    if (abs(focal) - LARGEST_FOCAL_ERROR) ** 2 <= limit or _focal_by_lens(
        members, best, lens
    ) > UNKNOWN_FOCAL:
        return None
    return (
        f"the matches ask for a focal length {abs(focal):.0%} {'longer' if focal > 0.0 else 'shorter'}"
        f" (± {deviation:.1%}): they come from another camera, or another zoom"
    )


def _focal_by_lens(members: Matches, best: Minimum, lens: Lens) -> float:
    """Return the σ of φ that the camera's own errors bring: φ = −rᵀd/rᵀr, r what motion leaves of ∂d/∂φ."""
    moves = lens.all_moves(members, Solution(best.rotation, best.translation, best.points)).pixels
    if not len(moves):
        return 0.0
    essential, left = np.empty((3, 3)), np.empty(members.size)
    essential_matrix(best.rotation, best.translation, essential)
    sampson_distances(members.bearings, members.jacobians, essential, left)
    normals, slopes = epipolar_normals(members, best.rotation, best.translation)
    pulls = normals * np.repeat(members.weights, 2, axis=1)
    # ∂d/∂φ, d in pixels of the given camera: noise across an epipolar line is in both terms, and cancels.
    left -= (pulls * (members.pixels - np.tile(members.parameters[2:4], 2))).sum(axis=1)
    basis = np.linalg.qr(slopes)[0]
    left -= basis @ (basis.T @ left)
    return float(np.linalg.norm(np.einsum("nc,fnc,n->f", pulls, moves, left)) / (left @ left))


def _alike(fit: TwoViewFit, matches: Matches, gate: float, largest: float) -> str | None:
    best, n = fit.minima[0], matches.size
    if n - np.count_nonzero(fit.members) < largest * n:
        return None
    alike, beyond = count_alike(matches, fit.members, best.rotation, best.translation, gate)
    if alike < LARGEST_BODY * n or float(bdtrc(alike - 1, beyond, 0.5)) >= CHANCE_ALIKE:
        return None
    return (
        f"{alike} of the {n} matches disagree in the same way as the one beside them: they come from"
        " another camera, or not from one rigid scene"
    )


def count_alike(
    matches: Matches, members: BoolArray, rotation: FloatArray, translation: FloatArray, gate: float
) -> tuple[int, int]:
    """Of matches rejected beyond ``gate`` [px] return (how many are like the nearest, how many are)."""
    essential, distances = np.empty((3, 3)), np.empty(members.shape[0])
    essential_matrix(rotation, translation, essential)
    sampson_distances(matches.bearings, matches.jacobians, essential, distances)
    beyond = ~members & (np.abs(distances) > gate)
    places, distances = matches.pixels[beyond, :2], distances[beyond]
    if len(places) < 2:
        return 0, len(places)
    nearest = np.asarray(KDTree(places).query(places, k=2)[1])
    is_itself = nearest[:, 0] == np.arange(len(places))
    ratio = distances / distances[np.where(is_itself, nearest[:, 1], nearest[:, 0])]
    return int(np.count_nonzero((ratio > 0.5) & (ratio < 2.0))), len(places)


@kernel
def focal_error(
    members: Matches, rotation: FloatArray, translation: FloatArray
) -> tuple[float, float, float]:
    """Return (φ, σ_φ by σ of a pixel [1/px], Σd² [px²] that φ leaves); σ_φ is infinite where it is free."""
    size = MOTION_PARAMETERS + 1
    normal, solved, row = np.zeros((size, size)), np.zeros(size), np.empty(size)
    essential, tangents = np.empty((3, 3)), np.empty((2, 3))
    essential_matrix(rotation, translation, essential)
    tangent_plane(translation, tangents)
    # A longer focal length sees what is nearer to the centre c: p → c + (p − c)/(1 + φ).
    nearer, shrink = np.empty_like(members.pixels), 1.0 / (1.0 + SMALL_STEP)
    for j in range(nearer.shape[0]):
        for i in range(4):
            centre = members.parameters[2 + i % 2]
            nearer[j, i] = centre + shrink * (members.pixels[j, i] - centre)
    bearings, jacobians = np.empty_like(members.bearings), np.empty_like(members.jacobians)
    if bearings_of_pixels(members.parameters, nearer, bearings, jacobians) >= 0:
        return 0.0, math.inf, 0.0
    cost = 0.0
    for j in range(members.pixels.shape[0]):
        for i in range(12):
            jacobians[j, i] *= shrink / members.weights[j, i // 6]
        distance = sampson_row(members.bearings, members.jacobians, j, rotation, essential, tangents, row)
        row[size - 1] = (sampson_distance(bearings, jacobians, j, essential) - distance) / SMALL_STEP
        cost += distance * distance
        for i in range(size):
            solved[i] -= row[i] * distance
            for k in range(i + 1):
                normal[i, k] += row[i] * row[k]
    gradient = solved.copy()
    if not factor_cholesky(normal, size, 1e-15):
        return 0.0, math.inf, cost
    solve_factored(normal, size, solved)
    for i in range(size):
        cost -= gradient[i] * solved[i]
    return solved[size - 1], 1.0 / normal[size - 1, size - 1], max(cost, 0.0)
