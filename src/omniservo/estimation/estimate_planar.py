"""Motion before a planar target, from four matches on."""

from __future__ import annotations

import math
import time
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from omniservo.estimation.matches import Matches
from omniservo.estimation.minimal_solvers.essential_matrix import linear_structure
from omniservo.estimation.refinement.joint_refinement import write_residuals
from omniservo.estimation.refinement.planar_motion import (
    UNKNOWNS,
    PlanarBlocks,
    PlanarMotion,
    decompose_homography,
    refine_planar_motion,
)
from omniservo.estimation.robust.map_consensus import robust_map
from omniservo.estimation.robust.members import (
    GATE,
    MOTION_PARAMETERS,
    PRIOR_NOISE_PX,
    PRIOR_WEIGHT,
    sampling_threshold,
)
from omniservo.estimation.robust.two_view_fit import EIGHT_POINTS, LEAST_POINTS, fit_two_views
from omniservo.estimation.status.degenerate_motion import (
    HOMOGRAPHY,
    algebraic_map,
    map_distances,
    refine_linear_map,
)
from omniservo.estimation.status.evidence import CONFIDENCE, largest_noise, noise_variance, simpler_model
from omniservo.estimation.status.second_plane import second_plane
from omniservo.estimation.two_view_estimate import Status, TwoViewEstimate
from omniservo.estimation.two_view_request import TwoViewRequest
from omniservo.estimation.uncertainty.joint_uncertainty import JointUncertainty
from omniservo.estimation.uncertainty.planar_law import planar_law
from omniservo.estimation.uncertainty.two_view_uncertainty import Noise, total_covariances
from omniservo.geometry.arrays import BoolArray, FloatArray, owned

LEAST_PLANAR_POINTS = 4
"""of a homography."""

MOST_SAMPLES = 500
LEAST_SHARE = 0.5
"""A plane that fewer of the matches obey is not the target's."""

MEDIAN_DISTANCE = math.sqrt(math.log(4.0))
"""of two coordinates, over σ"""

ROUNDS = 3
MOST_STEPS = 30

STATED = 1.0 - 1e-6
"""Confidence at which parallax overrules the caller, who says that there is a plane."""

APART = 3.0
"""Two motions are distinguished where they differ by so many standard deviations."""


class PlanarSolution(NamedTuple):
    """One motion before the plane, refined."""

    motion: PlanarMotion
    rays: FloatArray
    """(m, 3) where the goal camera sees the members"""
    blocks: PlanarBlocks


def estimate_planar(
    matches: Matches, robust: bool, request: TwoViewRequest, started: float
) -> TwoViewEstimate:
    """Return motion and structure of a target that is known to be a plane.

    A homography of bearings, its (at most two) motions that have all points in front of both cameras, and
    their refinement on pixels with every point held on the plane. Two views of a plane mostly allow two
    motions that no pixel tells apart: "ambiguous"; so are matches of two planes that no motion sees together.
    """
    n = matches.size
    if n < LEAST_PLANAR_POINTS:
        words = f"{n} matches given; at least {LEAST_PLANAR_POINTS} are needed"
        return TwoViewEstimate.without_pose(n, "too_few_points", words, started)
    matrix, inside = fit_homography(matches, robust)
    members = matches.where(inside)
    refused = _refusal(members, matrix)
    if members.size < LEAST_SHARE * n:
        refused = "not_converged", f"only {members.size} of {n} matches are on one plane"
    elif refused is None and (words := second_plane(matches, inside)):
        refused = "ambiguous", words
    if refused is not None:
        return TwoViewEstimate.without_pose(n, *refused, started)
    candidates = decompose_homography(matrix, members.bearings[:, 3:])
    found = [PlanarSolution(*s) for c in candidates if (s := refine_planar_motion(members, c)) is not None]
    if not found:
        words = "no motion has the whole plane in front of both cameras"
        return TwoViewEstimate.without_pose(n, "not_converged", words, started)
    lost = request.rejected(inside)
    if lost is not None:
        words = f"point {lost}, which the scale refers to, was rejected as a wrong match"
        return TwoViewEstimate.without_pose(n, "not_converged", words, started)
    first_order = _law(members, found[0], None, inside, request)
    if first_order is None:
        words = "the matches do not determine the motion"
        return TwoViewEstimate.without_pose(n, "not_converged", words, started)
    others = [solution.motion for solution in found[1:]]
    if others and (words := _ambiguity(found[0].motion, others[0], first_order)):
        both = (_pose(found[0].motion), _pose(others[0]))
        return TwoViewEstimate.without_pose(n, "ambiguous", words, started, both)
    law = _law(members, found[0], others, inside, request) or first_order
    return _answer(matches, inside, found[0], law, request, started)


def fit_homography(matches: Matches, robust: bool) -> tuple[FloatArray, BoolArray]:
    """Return the homography of bearings (3, 3) and the matches (n,) that it rests on.

    Fewer than eight matches cannot be freed of wrong ones.
    """
    n = matches.size
    members = np.ones(n, dtype=np.bool_)
    if not robust or n < EIGHT_POINTS:
        return _refined(matches, algebraic_map(matches.bearings, members, HOMOGRAPHY)), members
    distances, gate = np.empty(n), sampling_threshold(matches.noise_px)
    least = max(float(LEAST_PLANAR_POINTS), LEAST_SHARE * n)
    matrix = robust_map(matches, HOMOGRAPHY, members, gate, least, MOST_SAMPLES, distances)
    near = distances < gate
    if near.sum() <= LEAST_PLANAR_POINTS:
        return _refined(matches, algebraic_map(matches.bearings, members, HOMOGRAPHY)), members
    for _ in range(ROUNDS):
        matrix = _refined(matches.where(near), matrix)
        map_distances(matches, matrix, distances)
        members, near = near, distances < GATE * _noise(distances[near], matches.noise_px)
        if (members == near).all():
            break
    return matrix, members


def _refined(members: Matches, matrix: FloatArray) -> FloatArray:
    refined = matrix.copy()
    refine_linear_map(members, HOMOGRAPHY, math.inf, math.inf, MOST_STEPS, refined)
    return refined


def _noise(distances: FloatArray, stated: float) -> float:
    """Return σ [px]: what is stated, or from the members' median distance and the prior."""
    if stated > 0.0:
        return stated
    n = len(distances)
    square = (float(np.median(distances)) / MEDIAN_DISTANCE) ** 2 * n
    return math.sqrt((PRIOR_WEIGHT * PRIOR_NOISE_PX**2 + square) / (PRIOR_WEIGHT + max(n - 4, 1)))


def _refusal(members: Matches, matrix: FloatArray) -> tuple[Status, str] | None:
    """Return why the matches are not a moving camera's view of one plane; None where they can be."""
    n = members.size
    freedom = 2 * n - UNKNOWNS
    cost = refine_linear_map(members, HOMOGRAPHY, math.inf, math.inf, 1, matrix.copy())
    noise = math.sqrt(cost / max(freedom, 1))
    if not noise <= largest_noise(members.noise_px):
        return "not_converged", f"the best plane leaves {noise:.2g} px of noise: the matches are not on one"
    general = 0.0
    if n >= LEAST_POINTS:
        fit = fit_two_views(members, 0, robust=False)
        general = min(cost, math.inf if fit is None else fit.cost)
    variance = noise_variance(general, n - MOTION_PARAMETERS, members.noise_px)
    simple = simpler_model(members, variance, general, {**CONFIDENCE, "planar_points": STATED})
    if simple is None:
        words = (
            f"the points are not on one plane (it leaves {noise:.2g} px of noise): parallax is significant"
        )
        return "not_converged", f'{words}; method "pixel" uses it'
    return None if simple[0] == "planar_points" else simple


def _law(
    members: Matches,
    solution: PlanarSolution,
    others: list[PlanarMotion] | None,
    inside: BoolArray,
    request: TwoViewRequest,
) -> JointUncertainty | None:
    freedom = 2 * members.size - UNKNOWNS
    noise = Noise.of(solution.blocks.cost, freedom, members.noise_px or None)
    windows = request.windows_of(inside)
    return planar_law(members, solution, others, noise, windows, request.length(inside), request.lens)


def _ambiguity(one: PlanarMotion, other: PlanarMotion, law: JointUncertainty) -> str:
    """Return the sentence that names both motions; empty where they are one within the uncertainty."""
    turn = Rotation.from_matrix(one.rotation.T @ other.rotation).as_rotvec()
    covariance, _ = law.covariances()
    apart = turn @ np.linalg.pinv(covariance[3:, 3:]) @ turn
    if apart < APART**2 and float(one.translation @ other.translation) > 0.0:
        return ""
    return (
        f"two motions see the plane alike: {_spelled(one)}, or {_spelled(other)}; a point off the plane, a"
        " third view or a known target tells them apart"
    )


def _pose(motion: PlanarMotion) -> RigidTransform:
    return RigidTransform.from_components(motion.translation, Rotation.from_matrix(motion.rotation))


def _spelled(motion: PlanarMotion) -> str:
    x, y, z = motion.translation
    a, b, c = np.rad2deg(Rotation.from_matrix(motion.rotation).as_rotvec())
    return f"direction ({x:.3f}, {y:.3f}, {z:.3f}) with rotation ({a:.1f}, {b:.1f}, {c:.1f})°"


def _answer(
    matches: Matches,
    inside: BoolArray,
    solution: PlanarSolution,
    law: JointUncertainty,
    request: TwoViewRequest,
    started: float,
) -> TwoViewEstimate:
    """Return the pose with points, residuals and covariance."""
    rotation, translation, _ = solution.motion
    members, structure = matches.where(inside), solution.motion.points(solution.rays)
    points, residuals = np.empty((matches.size, 3)), np.empty_like(matches.pixels)
    linear_structure(matches.bearings, rotation, translation, points)
    points[inside] = structure
    write_residuals(matches.parameters, matches.pixels, rotation, translation, points, residuals)
    metres = request.length(inside).of_translation(structure)
    translation, points = metres * translation, metres * points
    motion, each = total_covariances(law, request.scale_sigma, translation, points, inside)
    freedom = max(2 * members.size - UNKNOWNS, 1)
    return TwoViewEstimate(
        status="ok",
        message="",
        initial_T_goal=RigidTransform.from_components(translation, Rotation.from_matrix(rotation)),
        points=owned(points),
        is_metric=request.metres is not None,
        covariance=owned(motion),
        points_covariance=owned(each),
        inliers=inside,
        rms_px=math.sqrt(float((residuals[inside] ** 2).sum()) / (2 * members.size)),
        noise_px=math.sqrt(solution.blocks.cost / freedom),
        residuals_px=owned(residuals),
        seconds=time.perf_counter() - started,
        scale_sigma=request.scale_sigma,
        uncertainty=law,
    )
